"""MAVSDK-Python's examples against the served twin: which run, which are refused, and with what reason.

`python -m tests.links.mavlink.mavsdk_examples FOLDER --python PYTHON [--named VERSION] [--write docs/links_mavlink.md]`
runs every example of FOLDER in PYTHON, an interpreter that has their package (`pip install 'mavsdk<4'`), one after the
other against one served BlueROV2 Heavy. Examples run as they are but for the address: copies in a temporary folder
listen where this twin calls. The table is printed, or written between the marks of a page.
"""

import argparse
import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

VEHICLE = "bluerov2_heavy"
MARKS = "<!-- examples: begin -->", "<!-- examples: end -->"
RESULTS = ("runs", "refused", "not applicable", "broken", "hangs")
PATIENCE = 8.0  # others than the endless ones have so many times as long: MAVSDK tries again what is not answered
MAVSDK_SERVER = 50051  # port of the program that the package starts
STARTING = 180.0  # on a busy machine the protocols' process takes longer than a user would wait [s]
SETTLE = 7.0  # between two examples: the fail-safe for a lost ground station disarms after 5 s [s]

# Examples that never end by themselves, and what shows that they do what they are for.
ENDLESS = {
    "goto": r"Staying connected",
    "gripper": r"Staying connected",
    "highres_imu": r"X Acceleration",
    "manual_control": r"Starting manual control",
    "mavlink_direct_receive": r"ATTITUDE from 1/1",
    "show_debug_output": r".",
    "telemetry": r"(?s)(?=.*Battery: )(?=.*GPS info: )(?=.*latitude_deg)",
    "telemetry_flight_mode": r"FlightMode",
    "telemetry_is_armed_is_in_air": r"(?s)Is_armed",
    "telemetry_status_text": r"Statustext",
    "winch": r"Staying connected",
}
# Examples that have no meaning for a vehicle under water, or do not speak to a vehicle; they are tried all the same.
NOT_APPLICABLE = {
    "camera_params": "asks at a keyboard; there is no camera",
    "ftp_download_file": "wants a Pixhawk at a serial port",
    "ftp_list_dir": "wants a Pixhawk at a serial port",
    "px4_ev_automation": "sets parameters of PX4",
    "px4_ev_automation_keyboard": "sets parameters of PX4, asks at a keyboard",
    "rtk_base_ublox": "wants a receiver at a serial port",
    "show_debug_output": "speaks to no vehicle",
    "transponder": "other aircraft: there are none",
    "upload_params": "wants a file of parameters",
}
REFUSAL = re.compile(r"^.* failed\s+with\s+error code:?\s*\w*|^Couldn't .*|^Timeout: .*", re.MULTILINE)
RAISED = re.compile(r"^(?:[\w.]+\.)?\w+(?:Error|Exception)\b.*", re.MULTILINE)
# Faults of an example that does not fit the package, or wants what it finds nowhere: nothing that a vehicle answers.
OWN_FAULTS = ("TypeError", "AttributeError", "ModuleNotFoundError", "ImportError", "PermissionError")
COMPLAINS, SERVERS = re.compile(r"^ERROR:mavsdk_server:(.*?)(?: \([\w.]+:\d+\))?$", re.MULTILINE), "MAVSDK: {}"
LOGGED = re.compile(r"(?:ERROR|WARNING|INFO|DEBUG):mavsdk_server:")
MOST_REASONS = 3  # that are reported of one example
AFTERWARDS = ("Arming", "Disarming", "MYGCS", "Lost manual")  # what it says whoever steers
STATUS_TEXT = re.compile(r"mavlink: (?!tcp|udp|\d)(.*)")  # what the vehicle tells its clients, not who comes and goes


@dataclass(frozen=True)
class Tried:
    """One example: its name, its result (one of RESULTS) and what was seen."""

    name: str
    result: str
    seen: str


def adapted(text: str, address: str) -> str:
    """An example's text with the address of this twin instead of PX4's."""
    text = re.sub(r"udpin?://[0-9.]*:14540", address, text)
    return text.replace(".connect()", f'.connect(system_address="{address}")')


def run_example(python: str, folder: Path, name: str, address: str, seconds: float) -> tuple[int | None, str]:
    """Exit status (None: it was still running after so long) and output of one example."""
    with tempfile.TemporaryDirectory() as place:
        copy = Path(place) / "examples"
        shutil.copytree(folder, copy)
        script = copy / f"{name}.py"
        script.write_text(adapted(script.read_text(encoding="utf-8"), address), encoding="utf-8")
        arguments = [address, "example-mission.plan"] if name == "upload_params" else []
        with (copy / "output").open("w+", encoding="utf-8") as output:
            process = subprocess.Popen(
                [python, script.name, *arguments],
                cwd=script.parent,
                env={**os.environ, "PYTHONUNBUFFERED": "1", "PYTHONPATH": ""},
                stdin=subprocess.PIPE,  # nobody types, and nobody closes it
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # with the server that it starts
            )
            try:
                status: int | None = process.wait(seconds)
            except subprocess.TimeoutExpired:
                status = None
            finally:  # also at Ctrl-C: what is left of it would answer the next example
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            output.seek(0)
            return status, output.read()


def judged(name: str, status: int | None, output: str, texts: list[str]) -> Tried:
    """What an example's end means."""
    output = LOGGED.sub(r"\n\g<0>", output)  # its server's lines come between those of the example
    reasons = [found[1] for line in texts if (found := STATUS_TEXT.match(line))]
    reasons = [SERVERS.format(line) for line in COMPLAINS.findall(output)] + reasons
    kept = list(dict.fromkeys(r for r in reasons if not r.startswith(AFTERWARDS)))
    why = "; ".join(kept[:MOST_REASONS])
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    last = lines[-1] if lines else "no output"
    if name in NOT_APPLICABLE:
        return Tried(name, "not applicable", NOT_APPLICABLE[name])
    refusal = REFUSAL.search(output)
    if refusal or "Traceback" in output:  # some do not exit after it: MAVSDK-Python waits for its own threads
        found = refusal or RAISED.search(output)
        words = " ".join((found[0] if found else last).split())
        kind = "broken" if words.startswith(OWN_FAULTS) else "refused"
        return Tried(name, kind, "; ".join(filter(None, (_shortened(words), why))))
    if status is None and not (name in ENDLESS and re.search(ENDLESS[name], output)):
        return Tried(name, "hangs", last)
    return Tried(name, "runs", "; ".join(filter(None, ("until stopped" if status is None else "to its end", why))))


def _shortened(words: str) -> str:
    """A MAVSDK error without the arguments of the call."""
    return re.sub(r"; params: .*", "", words)


def try_all(folder: Path, python: str, seconds: float, only: list[str], say=print) -> list[Tried]:
    """Run the examples of a folder against a served twin."""
    from tests.links.mavlink.vehicle import free_port
    from tests.links.twins import twin_served

    from rovtwin.links.servers import protocol_process as apart

    apart.STARTING = STARTING
    names = sorted(path.stem for path in folder.glob("*.py") if not only or path.stem in only)
    names += [f"{path.name}/{path.name}" for path in sorted(folder.iterdir()) if (path / f"{path.name}.py").exists()]
    port, own = free_port(), free_port()
    found = []
    with twin_served(VEHICLE, [], more=[_server(port, own)]) as twin:
        time.sleep(3.0)
        for name in names:
            if only and name not in only:
                continue
            found.append(_try(twin, python, folder, name, port, own, seconds))
            say(f"{found[-1].name}: {found[-1].result}: {found[-1].seen}", flush=True)
            time.sleep(SETTLE)
    return found


def _try(twin: Any, python: str, folder: Path, name: str, port: int, own: int, seconds: float) -> Tried:
    before = len(twin.messages)
    provoked = threading.Timer(seconds / 2.0, _provoke, [own])
    if name == "telemetry_status_text":  # an ArduPilot that nobody asks for anything has nothing to say
        provoked.start()
    longest = seconds if name in ENDLESS else PATIENCE * seconds
    status, output = run_example(python, folder, name, f"udpin://0.0.0.0:{port}", longest)
    return judged(name, status, output, twin.messages[before:])


def _provoke(own: int) -> None:
    """Arm and disarm from elsewhere: the vehicle says so to all."""
    from pymavlink import mavutil

    line = mavutil.mavlink_connection(f"udpout:127.0.0.1:{own}", source_system=254)
    for armed in (1, 0):
        line.mav.command_long_send(1, 1, 400, 0, armed, *[0] * 6)
        time.sleep(1.0)
    line.close()


def _server(port: int, own: int) -> Any:
    from rovtwin.links.mavlink.mixing import mixer
    from rovtwin.links.mavlink.server import MavlinkServer
    from rovtwin.live.serving.protocols import world_for
    from rovtwin.runs.compose.composition import vehicle_of

    scenario = world_for(VEHICLE, (), None)
    thrusters = vehicle_of(scenario).model().thrusters
    return MavlinkServer(
        ground_station=f"127.0.0.1:{port}",
        udp_port=own,
        tcp_port=None,
        datum=scenario.origin,
        mixer=mixer(thrusters),
    )


def table(found: list[Tried], version: str) -> str:
    """The results as Markdown."""
    counts = ", ".join(f"{sum(one.result == result for one in found)} {result}" for result in RESULTS)
    rows = [f"| `{one.name}` | {one.result} | {one.seen.replace('|', '/')} |" for one in found]
    head = [f"{version}; {counts}.", "", "| example | result | what was seen |", "|---|---|---|"]
    return "\n".join([*head, *rows])


def write(page: Path, text: str) -> None:
    """Put the table between the marks of a page."""
    before, found, rest = page.read_text(encoding="utf-8").partition(MARKS[0])
    _, closed, after = rest.partition(MARKS[1])
    if not (found and closed):
        raise SystemExit(f"{page}: found no {MARKS[0]} .. {MARKS[1]}, expected both; add them where the table shall be")
    page.write_text(f"{before}{MARKS[0]}\n{text}\n{MARKS[1]}{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--python", default=sys.executable)
    parser.add_argument("--named", default="", help="the version of the examples, such as a commit")
    parser.add_argument("--seconds", type=float, default=30.0, help="of an endless example; others may take longer")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--write", type=Path, help="a page with the marks")
    options = parser.parse_args()
    ask = "import importlib.metadata as m; print(m.version('mavsdk'))"
    version = subprocess.run([options.python, "-c", ask], capture_output=True, text=True, check=True).stdout.strip()
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", MAVSDK_SERVER)) == 0:
            raise SystemExit(f"port {MAVSDK_SERVER}: another mavsdk_server is there and would answer; end it first")
    found = try_all(options.folder, options.python, options.seconds, options.only)
    named = f"MAVSDK-Python {version}" + (f", examples of {options.named}" if options.named else "")
    text = table(found, named)
    write(options.write, text) if options.write else print(text)


if __name__ == "__main__":
    main()
