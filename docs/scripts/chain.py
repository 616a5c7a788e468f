"""The table of the whole chain (docs/fleet.md): every step run with every vehicle, one cell each.

python docs/scripts/chain.py --out runs/fleet                      # all vehicles of the library, all steps: hours
python docs/scripts/chain.py --out runs/fleet my.yaml nosway.yaml  # your own
python docs/scripts/chain.py --out runs/fleet --steps check,show,calm,current
python docs/scripts/chain.py --out runs/fleet --table              # only print what is there

Each cell is written to runs/fleet/cells.json as soon as it is known; what is there is not run again (--again).
A cell is "yes", "refused" (before anything moved, with the reason), "ended" (flown, not completed, with the reason),
or "FAILED": a traceback, or no reason in words.
"""

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

NEVER = 9e3  # [s]
CURRENT_SHARE = 1 / 3  # of the top speed ahead
STATION = 240  # [s]
FAIL_SAFES = {
    "leak": ["faults=[{fault: leak, at: 20}]"],
    "link lost": ["faults=[{fault: link_lost, at: 20}]"],
    "operator silent": ["faults=[{fault: operator_silent, at: 20}]", "autopilot.supervisor.operator_silent=10"],
    "positions lost": ["faults=[{sensor: position, fault: silent, at: 10}]", "autopilot.supervisor.positions_lost=10"],
    "time out": ["autopilot.supervisor.time_out=20"],
}
"""Rule by rule: what brings it about in a flight of the square."""


class Bench:
    """Runs steps for one vehicle in a folder of its own."""

    def __init__(self, vehicle: str, folder: Path, seeds: str):
        self.vehicle, self.folder, self.seeds = vehicle, folder, seeds
        folder.mkdir(parents=True, exist_ok=True)

    def run(self, *arguments: str, limit: float = 3600.0) -> tuple[int, dict, str]:
        """Exit code, the JSON object and standard error of a rovtwin command."""
        command = [sys.executable, "-m", "rovtwin.cli", *arguments]
        done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=limit, check=False)
        try:
            data = json.loads(done.stdout) if done.stdout.strip() else {}
        except json.JSONDecodeError:
            data = {}
        return done.returncode, data, done.stderr.strip()

    def shown(self) -> dict:
        """What `vehicle show` says, kept in the folder."""
        kept = self.folder / "show.json"
        if not kept.exists():
            code, data, message = self.run("vehicle", "show", self.vehicle, "--json")
            if code:
                raise RuntimeError(message)
            kept.write_text(json.dumps(data))
        return json.loads(kept.read_text())

    def top_speed(self) -> float:
        return float(self.shown()["performance"]["surge"]["ahead"]["top_speed_ms"])

    def tank(self) -> str:
        """A tank in which the vehicle can be tested: the thesis's, or larger in proportion to its stopping distance."""
        stop = float(self.shown()["performance"]["surge"]["ahead"]["stopping_distance_m"])
        length = max(6.0, 12.0 * stop)
        return f"{length:.0f}x{max(3.0, length / 2):.0f}x{max(1.5, length / 4):.1f}"

    def flown(self, code: int, data: dict, message: str) -> tuple[str, str]:
        """Verdict of a flight."""
        if "Traceback" in message or code not in (0, 1, 2):
            return "FAILED", _last(message)
        if code == 2:
            return "refused", _last(message)
        if data.get("completed"):
            rms, duration = data.get("cross_track_rms_m"), data.get("duration_s")
            return "yes", f"{duration:.0f} s" + (f", {rms:.2f} m" if rms is not None else "")
        reason = data.get("reason") or ""
        bad = not reason or re.fullmatch(r"not finished after \d+ s", reason)
        return ("FAILED" if bad else "ended"), reason or "no reason given"

    def scored(self, code: int, data: dict, message: str) -> tuple[str, str]:
        """Verdict of several seeds."""
        if "Traceback" in message or code not in (0, 1, 2):
            return "FAILED", _last(message)
        if code == 2:
            return "refused", _last(message)
        (runs,) = data["scenarios"].values()
        done = sum(run["completed"] for run in runs)
        reasons = {run["reason"] for run in runs if not run["completed"]}
        if done == len(runs):
            worst = max(run["cross_track_max_m"] or 0.0 for run in runs)
            return "yes", f"{done}/{len(runs)}, {runs[0]['duration_s']:.0f} s, at most {worst:.2f} m off"
        bad = any(not r or re.fullmatch(r"not finished after \d+ s", r) for r in reasons)
        return ("FAILED" if bad else "ended"), f"{done}/{len(runs)}; " + "; ".join(sorted(reasons))[:400]


def check(bench: Bench) -> tuple[str, str]:
    """Read and judged."""
    code, data, message = bench.run("vehicle", "check", bench.vehicle, "--json")
    return ("yes", data["verdict"]) if code == 0 else ("FAILED", _last(message))


def show(bench: Bench) -> tuple[str, str]:
    """Shown: mass and top speed."""
    return "yes", f"{bench.shown()['mass_kg']:g} kg, {bench.top_speed():.2f} m/s"


def ballast(bench: Bench) -> tuple[str, str]:
    """Trimmed level, 2 N of buoyancy."""
    code, data, message = bench.run("vehicle", "ballast", bench.vehicle, "--level", "--buoyancy", "2N", "--json")
    if code == 0:
        return "yes", f"{len(data.get('pieces', []))} pieces"
    bad = "Traceback" in message or code not in (1, 2)
    return "FAILED" if bad else ("ended", "refused")[code - 1], _last(message) or str(data.get("reason", ""))


def sea(bench: Bench) -> tuple[str, str]:
    """Whether it holds a place in a current of a third of its top speed."""
    current = f"world.current=[0,{bench.top_speed() * CURRENT_SHARE:.3f},0]"
    code, _, message = bench.run("sea", "station_keeping", *_set(f"vehicle={bench.vehicle}", current), "--json")
    warned = "Warning" in message
    return ("yes", "") if code in (0, 1) and not warned else ("FAILED", _last(message))


def plan(bench: Bench) -> tuple[str, str]:
    """Four minutes of tests in a tank."""
    options = ["--minutes", "4", "--tank", bench.tank(), "-o", "planned.yaml", "--json"]
    code, _, message = bench.run("plan-tests", bench.vehicle, *options)
    return ("yes", bench.tank()) if code == 0 else ("FAILED" if "Traceback" in message else "refused", _last(message))


def test(bench: Bench) -> tuple[str, str]:
    """The plan flown in the twin."""
    return bench.flown(*bench.run("fly", "planned.yaml", "--out", "test", "--no-report", "--json"))


def identify(bench: Bench) -> tuple[str, str]:
    """Identified from that log."""
    options = ["-o", "identified.yaml", "--no-report", "--json"]
    code, data, message = bench.run("identify", bench.vehicle, "test/log.mcap", *options)
    if code == 0:
        return "yes", f"{len(data['parameters'])} parameters"
    doubts = "; ".join(data.get("doubts", []))
    return "ended" if code == 1 and doubts else "FAILED", doubts or _last(message)


def compare(bench: Bench) -> tuple[str, str]:
    """What was identified against the description."""
    if not (bench.folder / "identified.yaml").exists():
        return "ended", "there is no identified file"
    code, _, message = bench.run("compare", bench.vehicle, "identified.yaml", "--json")
    return ("yes", "") if code == 0 else ("FAILED", _last(message))


def tune(bench: Bench) -> tuple[str, str]:
    """Six evaluations, to see that it runs."""
    few = ["--budget-s", "90", "--evaluations", "6", "--plants", "2", "--held-out", "2"]
    code, _, message = bench.run("tune", "square", *_set(f"vehicle={bench.vehicle}"), *few, "--out", "tune", "--json")
    return ("yes", "better" if code == 0 else "not better") if code in (0, 1) else ("FAILED", _last(message))


def calm(bench: Bench) -> tuple[str, str]:
    """`square` in calm water."""
    options = ["--vehicle", bench.vehicle, "--seeds", bench.seeds, "--batch", "--json"]
    return bench.scored(*bench.run("score", "square", *options))


def current(bench: Bench) -> tuple[str, str]:
    """`square` in a current of a third of its top speed."""
    speed = f"world.current=[0,{bench.top_speed() * CURRENT_SHARE:.3f},0]"
    options = ["--vehicle", bench.vehicle, "--seeds", bench.seeds, "--batch", *_set(speed), "--json"]
    return bench.scored(*bench.run("score", "square", *options))


def station(bench: Bench) -> tuple[str, str]:
    """A place kept in that current."""
    speed = f"world.current=[0,{bench.top_speed() * CURRENT_SHARE:.3f},0]"
    place = f"mission.waypoints=[{{position: [0, 0, 3], hold_time: {STATION}}}]"
    options = ["--vehicle", bench.vehicle, "--seeds", bench.seeds, "--batch", *_set(speed, place), "--json"]
    return bench.scored(*bench.run("score", "square", *options))


def fail_safes(bench: Bench) -> tuple[str, str]:
    """Every rule brought about in a flight."""
    wrong = []
    for rule, changes in FAIL_SAFES.items():
        settings = _set(f"vehicle={bench.vehicle}", "duration=150", "world.surface=true", *changes)
        folder = "safe-" + rule.replace(" ", "-")
        code, data, message = bench.run("fly", "square", *settings, "--out", folder, "--no-report", "--json")
        causes = [one["cause"] for one in data.get("decisions", [])]
        if code not in (0, 1) or rule not in causes:
            wrong.append(f"{rule}: {_last(message) or causes}")
    return ("FAILED", "; ".join(wrong)) if wrong else ("yes", ", ".join(FAIL_SAFES))


def campaign(bench: Bench) -> tuple[str, str]:
    """Three flights with currents and mismatch."""
    (bench.folder / "campaign.yaml").write_text(
        f"scenario: square\nsamples: 3\nset: {{vehicle: '{bench.vehicle}', world.mismatch: true}}\n"
        "vary:\n  world.current.velocity[1]: {distribution: uniform, low: 0, high: 0.05}\n"
    )
    options = ["--out", "campaign", "--workers", "1", "--no-report", "--json"]
    code, _, message = bench.run("campaign", "campaign.yaml", *options)
    return ("yes", "") if code == 0 else ("FAILED", _last(message))


def console(bench: Bench) -> tuple[str, str]:
    """The console starts, its engine is ready to fly, and it ends."""
    from urllib.request import urlopen

    from rovtwin.console.launch import end
    from rovtwin.console.wire import Place

    port, log = 18800, bench.folder / "console.log"
    options = ["square", *_set(f"vehicle={bench.vehicle}"), "--no-browser", "--port", str(port)]
    with log.open("wb") as out:
        started = subprocess.Popen(
            [sys.executable, "-m", "rovtwin.cli", "console", *options], cwd=bench.folder, stdout=out, stderr=out
        )
    try:
        for _ in range(240):
            time.sleep(1.0)
            if started.poll() is not None:
                return "FAILED", _last(log.read_text())
            try:
                with urlopen(f"http://127.0.0.1:{port}/", timeout=2) as page:
                    return ("yes", "") if page.status == 200 else ("FAILED", str(page.status))
            except OSError:
                continue
        return "FAILED", "no page after 240 s"
    finally:
        started.send_signal(signal.SIGINT)
        try:
            started.wait(30)
        except subprocess.TimeoutExpired:
            started.kill()
        end(Place.of(port))


STEPS = {
    step.__name__: step
    for step in (
        *(check, show, ballast, sea, plan, test, identify, compare, tune, calm, current, station),
        *(fail_safes, campaign, console),
    )
}


def _set(*changes: str) -> list[str]:
    return [word for change in changes for word in ("--set", change)]


def _last(message: str) -> str:
    """The last line that says something."""
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    return lines[-1][:400] if lines else ""


def library() -> list[str]:
    """All vehicles of the library; devices have no thrusters."""
    from rovtwin.vehicle import load_vehicle
    from rovtwin.vehicle.description.files import list_library

    return [name for name in list_library() if load_vehicle(name).thruster_names]


def table(cells: dict) -> str:
    """Markdown: a row for each vehicle, then every reason."""
    steps = [step for step in STEPS if any(step in row for row in cells.values())]
    lines = ["| vehicle | " + " | ".join(s.replace("_", " ") for s in steps) + " |", "|---" * (len(steps) + 1) + "|"]
    notes = []
    for vehicle, row in cells.items():
        marks = [row[s]["verdict"] if s in row else "–" for s in steps]
        lines.append(f"| `{Path(vehicle).stem}` | " + " | ".join(marks) + " |")
        notes += [
            f"- `{Path(vehicle).stem}`, {s}: {row[s]['message']}" for s in steps if s in row and row[s]["message"]
        ]
    return "\n".join([*lines, "", *notes])


def main() -> None:
    """Runs the steps and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vehicles", nargs="*", help="files or library names; default the whole library")
    parser.add_argument("--out", type=Path, default=Path("runs/fleet"))
    parser.add_argument("--steps", default=",".join(STEPS))
    parser.add_argument("--seeds", default="1-10")
    parser.add_argument("--again", action="store_true", help="run cells that are known once more")
    parser.add_argument("--table", action="store_true", help="run nothing, print the table")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    kept = given.out / "cells.json"
    cells = json.loads(kept.read_text()) if kept.exists() else {}
    os.environ.setdefault("COLUMNS", "400")
    for vehicle in [] if given.table else given.vehicles or library():
        name = str(Path(vehicle).resolve()) if vehicle.endswith((".yaml", ".yml")) else vehicle
        bench = Bench(name, given.out.resolve() / Path(vehicle).stem, given.seeds)
        row = cells.setdefault(name, {})
        for step in given.steps.split(","):
            if step in row and not given.again:
                continue
            began = time.monotonic()
            try:
                verdict, message = STEPS[step](bench)
            except (RuntimeError, KeyError, subprocess.TimeoutExpired, ValueError) as error:
                verdict, message = "FAILED", f"{type(error).__name__}: {error}"[:400]
            row[step] = {"verdict": verdict, "message": message, "seconds": round(time.monotonic() - began, 1)}
            kept.write_text(json.dumps(cells, indent=1))
            print(f"{Path(vehicle).stem:24} {step:10} {verdict:8} {row[step]['seconds']:6.1f} s  {message}", flush=True)
    print(table(cells))


if __name__ == "__main__":
    main()
