"""Vendors' clients against the served twin, example by example: what runs, and what is refused with which reason.

python docs/scripts/vendor_clients.py OUT.md --python PYTHON [--FOLDER DIR ..]

It serves one Blueye with an Underwater GPS, a DVL and motion capture, runs what the folders of the fetched clients hold
(names of the folders: `--help`), each in a process that is ended after its time, and writes a table of client, example
and result. PYTHON is an interpreter with the packages that the clients need. Nothing of a client is changed but
addresses and ports; C++ clients are built in a temporary folder.
"""

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from http.server import ThreadingHTTPServer
from pathlib import Path

from vendor_beginnings import DRONE_AT, DVL_EXTENSION, READ_A50, UGPS_EXTENSION, UGPS_EXTERNAL, StandIn

DRONE, STAND_IN = "127.0.0.64", 8199
UGPS, PAGES = "http://127.0.0.1:8080", "127.0.0.1:8171"
WORLD = ("world.floor=6", "sensors.altimeter=true", "datum.latitude=63.4415", "datum.longitude=10.4174")
SERVE = ("blueye_pioneer", "--speed", "3", "--address", f"blueye={DRONE}")
REFUSED_CALIBRATION = "its request is refused (the twin's cameras are calibrated), which it writes to its log"
NO_DISCOVERY = "it finds no QTM to choose: discovery is a broadcast, which does not reach the loopback"
FOLDERS = {
    "blueye": "github.com/BluEye-Robotics/blueye.sdk",
    "qualisys": "github.com/qualisys/qualisys_python_sdk",
    "dvl-extension": "github.com/bluerobotics/BlueOS-Water-Linked-DVL",
    "ugps-extension": "github.com/waterlinked/blueos-ugps-extension",
    "ugps-external": "github.com/clydemcqueen/wl_ugps_external_extension",
    "ugps-examples": "github.com/waterlinked/examples",
    "dvl-python": "github.com/waterlinked/dvl-python",
    "libwaterlinked": "github.com/Robotic-Decision-Making-Lab/waterlinked_dvl",
    "dvl-a50": "github.com/ndahn/dvl-a50",
}


@dataclass(frozen=True)
class Try:
    """One example: how it is run, for how long at most [s], and what its output must hold to count.

    `typed` is what the user types, `note` what a reader of the table has to know.
    """

    client: str
    example: str
    command: list[str]
    good: str = ""
    refusal: str = ""
    seconds: float = 20.0
    environment: dict[str, str] = field(default_factory=dict)
    terminal: bool = False
    typed: str = ""
    note: str = ""


def result_of(one: Try, folder: Path) -> str:
    """Run it, and say what came of it; it is ended when it has shown what it must, or after its time."""
    command = ["script", "-qefc", " ".join(one.command), "/dev/null"] if one.terminal else one.command
    output = folder / "output.txt"
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", "TERM": "xterm", **one.environment}
    with output.open("wb") as sink:
        process = subprocess.Popen(
            command, stdout=sink, stderr=subprocess.STDOUT, stdin=subprocess.PIPE, cwd=folder, env=environment,
            start_new_session=True,
        )  # fmt: skip
        assert process.stdin is not None
        process.stdin.write(one.typed.encode())
        process.stdin.close()
        end = time.monotonic() + one.seconds
        while process.poll() is None and time.monotonic() < end and not _found(one.good, output):
            time.sleep(0.2)
        ended = process.poll()
        if ended is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    note = f"; {one.note}" if one.note else ""
    if one.good and (seen := _found(one.good, output)):
        return f"runs: {seen}{note}"
    if one.refusal and (seen := _found(one.refusal, output)):
        return f"refused: {seen}{note}"
    if not one.good and ended == 0:
        return f"runs to its end{note}"
    last = [line for line in output.read_text("utf-8", "replace").splitlines() if line.strip()][-1:]
    how = "ended after its time" if ended is None else f"exit {ended}"
    return f"**fails** ({how}): {''.join(last)[:160].replace('|', '/')}{note}"


def _found(pattern: str, output: Path) -> str:
    found = re.search(pattern, output.read_text("utf-8", "replace")) if pattern else None
    text = "" if found is None else (found.group(1) if found.groups() else found.group(0))
    return " ".join(text.split())[:110].replace("|", "/")


def copied(source: Path, folder: Path, **changes: str) -> Path:
    """An example with other addresses."""
    text = source.read_text()
    for before, after in changes.items():
        text = text.replace(before, after)
    copy = folder / source.name
    copy.write_text(text)
    return copy


def of_blueye(root: Path, python: str, folder: Path) -> Iterator[Try]:
    """The SDK's examples, in an order in which the log that some of them read has something in it."""
    examples, start = root / "examples", folder / "drone_at.py"
    start.write_text(DRONE_AT.format(drone=DRONE))

    def example(name: str, good: str, seconds: float = 25.0, *arguments: str, terminal: bool = False) -> Try:
        path = copied(examples / f"{name}.py", folder, **{"192.168.1.255": "127.0.0.1", "COM2": port})
        command = [python, str(start), str(path), *arguments]
        return Try("blueye.sdk 2.8.0", f"{name}.py", command, good, "", seconds, terminal=terminal)

    master, slave = os.openpty()
    port = os.ttyname(slave)
    complete = r"Mission completed successfully"
    yield example("print_depth", r"DepthTel message with depth: [\d.-]+")
    yield example("print_imu", r"CalibratedImuTel[^:]*:\s+imu \{")
    yield example("print_status", r"Depth:[^\n]{0,12}?(\d+\.\d+)", terminal=True)
    yield example("profiler", r"DepthTel +unique/all: +\d+ / +\d+ +[\d.]+ Hz")
    yield example("nmea_publisher", r"\$GPGLL,63\d\d\.\d+,N,010\d\d\.\d+,E,[\d.]+,A")
    yield example("nmea_heading_publisher", r"Sent: (\$--HDT,[\d.]+,T)")
    yield example("publish_odometer_to_831l", r"Sent: (\{,#CABLE,[\d.]+,mm,\})")
    yield example("mission_tilt", complete, 60)
    yield example("mission_seabed", complete, 150)
    yield example("mission_go_to_waypoint", complete, 500)
    yield example("parse_log_to_dataframe", "", 150)
    yield example(
        "foxglove_bez_to_mcap", r"Total of messages written: \d+", 25, "/tmp/logfile.bez", str(folder / "dive.mcap")
    )
    yield example("foxglove_bridge_ws", r"(?i)server (?:listening|started)|Waiting for data", 10)
    yield example("gamepad_controller", "", 10)
    os.close(master)
    os.close(slave)


def of_qualisys(root: Path, python: str, folder: Path) -> Iterator[Try]:
    """The SDK's seven examples, one of them also with its own switch turned."""
    examples, reason = root / "examples", r"QRTCommandException: (b['\"].*['\"])"

    def example(name: str, good: str, seconds: float, *arguments: str, note: str = "", **changes: str) -> Try:
        path = copied(examples / f"{name}.py", folder, **changes) if changes else examples / f"{name}.py"
        shown = f"{name}.py" + "".join(f", `{after}`" for after in changes.values())
        command = [python, str(path), *arguments]
        return Try("qtm-rt 3.1.0", shown, command, good, reason, seconds, typed="1\n", note=note)

    yield example("basic_example", r"Component info: RT3DComponent\(marker_count=4", 20)
    yield example("advanced_example", "", 60, note="30 s of 2D of no camera")
    yield example("calibration_example", "", 20, note=REFUSED_CALIBRATION)
    yield example("control_example", "saved to Demo", 40, note="after new, start, 10 s and stop")
    yield example("stream_6dof_example", "1 of 1 6DoF bodies enabled", 20)
    yield example("stream_6dof_example", "1 of 1 6DoF bodies enabled", 20, **{"realtime = False": "realtime = True"})
    yield example("asyncio_everything", "", 20, note=NO_DISCOVERY)
    given = {"qtm_ip = await choose_qtm_instance(interface)": 'qtm_ip = "127.0.0.1"'}
    yield example("asyncio_everything", "", 20, note="after getting state and control", **given)
    yield example("image_example", "Writing", 20, "-o", str(folder / "x.png"), "-c", "1", "-p", "password")


def of_extensions(args: argparse.Namespace, folder: Path) -> Iterator[Try]:
    """BlueOS' extensions, with a stand-in for BlueOS' own services."""
    here = {"pages": PAGES, "ugps": UGPS, "stand_in": f"http://127.0.0.1:{STAND_IN}"}
    proxy = {"http_proxy": f"http://127.0.0.1:{STAND_IN}", "no_proxy": "127.0.0.1", "HOME": str(folder)}
    all_of_them = r"((\d+) of \2 requests answered[^\n]*)"
    if args.dvl_extension:
        start = folder / "dvl_extension.py"
        start.write_text(DVL_EXTENSION.format(**here))
        command = [args.python, str(start), str(args.dvl_extension / "dvl-a50")]
        yield Try("BlueOS-Water-Linked-DVL 1.0.10", "its driver", command, all_of_them, "", 40, proxy)
    if args.ugps_extension:
        start = folder / "ugps_extension.py"
        start.write_text(UGPS_EXTENSION.format(**here))
        command = [args.python, str(start), str(args.ugps_extension / "app")]
        yield Try("blueos-ugps-extension", "its main loop", command, all_of_them, "", 30)
    if args.ugps_external:
        start = folder / "ugps_external.py"
        start.write_text(UGPS_EXTERNAL.format(**here))
        command = [args.python, str(start), str(args.ugps_external / "app")]
        yield Try("wl_ugps_external_extension", "its threads", command, r"sending True polling True", "", 30)


def of_water_linked(args: argparse.Namespace) -> Iterator[Try]:
    """The vendor's own scripts."""
    if args.ugps_examples:
        for name, more, good in (
            ("getposition", [], r"X: [^\n]+"),
            ("externaldepth", ["-d", "2", "-t", "8"], ""),
            ("externalgps", ["-l", "63.4415", "-g", "10.4174"], ""),  # gives -h twice, which Python's argparse refuses
            ("nmeaoutput", ["-v", "-i", "127.0.0.1"], r"\$GPGGA[^\s]*"),
            ("olexoutput", ["-v", "-i", "127.0.0.1"], r"\$[A-Z]{5}[^\s]*"),
            ("tracklog", [], r"Global: Latitude: [^\n]+|Master: Latitude: [^\n]+"),
        ):
            command = [args.python, str(args.ugps_examples / f"{name}.py"), "-u", UGPS, *more]
            yield Try("waterlinked/examples", f"{name}.py", command, good, "", 15)
    if args.dvl_python:
        for kind in ("velocity", "dead_reckoning"):
            command = [args.python, str(args.dvl_python / "tcp" / "dvl_tcp_parser.py"), kind, "--ip", "127.0.0.1"]
            yield Try("waterlinked/dvl-python", f"dvl_tcp_parser.py {kind}", command, r"[^\n]*\d\.\d+,[^\n]*", "", 15)


def of_cpp(args: argparse.Namespace, folder: Path) -> Iterator[Try]:
    """Built here: g++, Eigen and nlohmann's JSON are needed."""
    if args.libwaterlinked:
        library = args.libwaterlinked / "libwaterlinked"
        for name, good in (
            ("subscribe_to_reports", r"Received velocity report:\s+Time: \d+\s+Velocity: [^\n]+"),
            ("send_command", r"Current configuration:\s+Speed of sound: \d+"),
        ):
            source = copied(library / "examples" / f"{name}.cpp", folder, **{"192.168.194.95": "127.0.0.1"})
            sources = [source, library / "src" / "client.cpp", library / "src" / "protocol.cpp"]
            failure = built(folder / name, sources, [library / "include", "/usr/include/eigen3"])
            yield Try("libwaterlinked (C++)", f"{name}.cpp", failure or ["stdbuf", "-oL", f"./{name}"], good)
    if args.dvl_a50:
        include = folder / "include" / "dvl_a50"
        (include / "json" / "single_include").mkdir(parents=True)
        (include / "json" / "single_include" / "nlohmann").symlink_to("/usr/include/nlohmann")
        for header in (args.dvl_a50 / "include" / "dvl_a50").glob("*.hpp"):
            shutil.copy(header, include)
        source = folder / "read_a50.cpp"
        source.write_text(READ_A50)
        needed = [flag for header in ("unistd.h", "iostream", "functional") for flag in ("-include", header)]
        sources = [source, args.dvl_a50 / "src" / "dvl_a50.cpp"]
        failure = built(folder / "read_a50", sources, [folder / "include"], needed)
        command = failure or ["./read_a50"]
        yield Try(
            "dvl-a50 (C++)", "its class, read by a main of ours", command, r"\d\d velocities, [1-9] answers", "", 40
        )


def built(program: Path, sources: list[Path], includes: Sequence[Path | str], more: Sequence[str] = ()) -> list[str]:
    """Build a program; empty, or a command that says why it could not be."""
    flags = [f"-I{include}" for include in includes]
    command = ["g++", "-std=c++20", *more, *flags, *map(str, sources), "-o", str(program), "-lpthread"]
    done = subprocess.run(command, capture_output=True, text=True)
    return [] if done.returncode == 0 else ["echo", f"not built: {done.stderr.splitlines()[0][:120]}"]


def served(log: Path) -> subprocess.Popen:
    """The twin, once it speaks."""
    protocols = [word for name in ("blueye", "ugps", "dvl", "qtm") for word in ("--protocol", name)]
    world = [word for change in WORLD for word in ("--set", change)]
    for _ in range(3):  # a busy machine may be too slow at first
        with log.open("w") as sink:
            command = [sys.executable, "-m", "rovtwin.cli", "serve", *SERVE, *protocols, *world]
            process = subprocess.Popen(command, stdout=sink, stderr=subprocess.STDOUT)
        while process.poll() is None:
            time.sleep(0.5)
            if "Ctrl-C ends it" in log.read_text():
                return process
    raise SystemExit(log.read_text())


def main() -> None:
    """Serve, try, write."""
    parser = argparse.ArgumentParser(description="Vendors' clients against the served twin")
    parser.add_argument("out", type=Path, help="Markdown file of the table")
    parser.add_argument("--python", default=sys.executable, help="interpreter with the clients' packages")
    parser.add_argument("--only", default="", help="regular expression of client and example")
    for name, where in FOLDERS.items():
        parser.add_argument(f"--{name}", type=lambda text: Path(text).resolve(), help=f"folder of {where}")
    args = parser.parse_args()
    rows = ["| client | example | result |", "|---|---|---|"]
    threading.Thread(target=ThreadingHTTPServer(("127.0.0.1", STAND_IN), StandIn).serve_forever, daemon=True).start()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        twin = served(folder / "serve.log")
        try:
            for one in tries(args, folder):
                if not re.search(args.only, f"{one.client} {one.example}"):
                    continue
                rows.append(f"| {one.client} | {one.example} | {result_of(one, folder)} |")
                print(rows[-1], flush=True)
        finally:
            twin.send_signal(signal.SIGINT)
            twin.wait(30)
    args.out.write_text("\n".join(rows) + "\n")


def tries(args: argparse.Namespace, folder: Path) -> Iterator[Try]:
    """All that the given folders hold."""
    if args.qualisys:
        yield from of_qualisys(args.qualisys, args.python, folder)
    yield from of_extensions(args, folder)
    yield from of_water_linked(args)
    yield from of_cpp(args, folder)
    if args.blueye:
        yield from of_blueye(args.blueye, args.python, folder)


if __name__ == "__main__":
    main()
