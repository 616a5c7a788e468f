"""Commission a vehicle whose truth nobody in the commissioning knows, over its protocol, and score what comes out.

python benchmarks/commissioning.py double_blueye --seed 3 --minutes 8 -o build/commissioning
python benchmarks/commissioning.py my.yaml --protocol mavlink --tank 6x4x1.5 -o build/mine
python benchmarks/commissioning.py double_blueye --seed 3 --kill -o build/killed      # kill -9 once in each stage

The truth is drawn from what the file leaves open, and served by `rovtwin serve` in another process, in real time: half
an hour of a machine with nothing else to do. The one reading of a scale is what the served vehicle pulls at full
command. `scores.json` in the folder has the figures.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.commission.dossier import INDEX, OUTCOME

ROOT = Path(__file__).parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from tests.commission.truths import hidden_truth  # noqa: E402  (the path above comes first)

LINKS = {"blueye": "blueye://127.0.0.2,127.0.0.3", "mavlink": "mavlink://udpin:127.0.0.1:14550", "twin": "twin://"}
MOCAP = "qtm://127.0.0.1/rov"
GAIN = "JS_GAIN_DEFAULT"  # which ArduSub ships at 0.5: no commissioning goes on before it is 1
CARRY = "carry"  # file of a vehicle that waits to be carried to the tank's middle
KILLED_AFTER = 12.0  # of a stage's first attempt [s]; those that end sooner are not killed


def begin(arguments: argparse.Namespace) -> None:
    """Draw and serve the truth, commission in a child process, kill that where asked, score."""
    folder: Path = arguments.out
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "truth.yaml"
    truth = hidden_truth(arguments.vehicle, arguments.seed, path)
    reading = full_pull(truth.model(), arguments.protocol)
    begun = time.monotonic()
    (folder / CARRY).unlink(missing_ok=True)
    served = Served(path, arguments.protocol, folder)
    try:
        kills = commission(arguments, reading, folder, served)
    finally:
        served.end()
    found = scores(folder / "commissioned", truth) | {
        "wall_s": time.monotonic() - begun,
        "kills": kills,
        "carried": served.carried,
    }
    found |= {"vehicle": arguments.vehicle, "seed": arguments.seed, "scale_reading_n": reading}
    (folder / "scores.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))


def full_pull(model: Any, protocol: str) -> float:
    """What a scale reads when the served vehicle gets full command ahead at full command [N].

    A drone's firmware gives ahead no more than its thrusters give astern, see `simulation.vehicle_firmware`.
    """
    from rovtwin.commission.scale import pull_of
    from rovtwin.vehicle.physics.thrusters import force_limits

    if protocol != "blueye":
        return pull_of(model, "surge", 1.0).expected
    surge = np.abs(np.asarray(model.thrusters.configuration)[0])
    low, high = (np.asarray(limit) for limit in force_limits(model.thrusters))
    return float(np.where(surge > 0.05 * surge.max(), surge, 0.0) @ np.minimum(-low, high))


class Served:
    """The truth behind its protocol. To carry it to the tank's middle is to begin it anew."""

    def __init__(self, path: Path, protocol: str, folder: Path):
        self._path, self._protocol, self._folder = path, protocol, folder
        self._process, self.carried = serve(path, protocol, folder), 0

    def carry(self) -> None:
        """If it waits for it."""
        if not (self._folder / CARRY).exists():
            return
        self.end()
        self._process = serve(self._path, self._protocol, self._folder)
        self.carried += 1
        (self._folder / CARRY).unlink()

    def end(self) -> None:
        self._process.send_signal(signal.SIGINT)
        self._process.wait(30)


def serve(path: Path, protocol: str, folder: Path) -> subprocess.Popen[bytes]:
    """The truth behind its protocol, and a motion-capture lab beside it, once both answer."""
    command = [sys.executable, "-m", "rovtwin.cli", "serve", str(path), "--protocol", protocol, "--protocol", "qtm"]
    with (folder / "server.txt").open("wb") as out:
        server = subprocess.Popen(command, stdout=out, stderr=out)
    for _ in range(240):
        if server.poll() is not None:
            raise SystemExit((folder / "server.txt").read_text())
        if "to fly it" in (folder / "server.txt").read_text():
            time.sleep(2.0)
            if protocol == "mavlink":
                raise_gain()
            return server
        time.sleep(0.5)
    raise SystemExit("the server did not come up in 120 s")


def raise_gain() -> None:
    """As a ground station does: the pilot's gain to 1."""
    from pymavlink import mavutil

    line: Any = mavutil.mavlink_connection("udpin:127.0.0.1:14550")
    line.wait_heartbeat(timeout=20)
    for _ in range(20):
        line.param_set_send(GAIN, 1.0)
        answer = line.recv_match(type="PARAM_VALUE", blocking=True, timeout=1.0)
        if answer is not None and answer.param_id == GAIN and answer.param_value == 1.0:
            break
    else:
        raise SystemExit(f"the vehicle did not take {GAIN} 1")
    line.close()


def commission(arguments: argparse.Namespace, reading: float, folder: Path, served: Served) -> int:
    """Begin and, where it was killed, go on, until it ends by itself; how many times it was killed."""
    killed: set[str] = set()
    while True:
        child = subprocess.Popen([sys.executable, __file__, *sys.argv[1:], "--child", repr(reading)])
        stage, since = "", time.monotonic()
        while child.poll() is None:
            time.sleep(0.2)
            served.carry()
            if (now := running(folder / "commissioned")) != stage:
                stage, since = now, time.monotonic()
            if arguments.kill and stage and stage not in killed and time.monotonic() - since > KILLED_AFTER:
                killed.add(stage)
                os.kill(child.pid, signal.SIGKILL)
        if child.returncode != -signal.SIGKILL:
            return len(killed)


def running(folder: Path) -> str:
    """The stage whose newest attempt has no page yet, "" where none runs."""
    try:
        last = json.loads((folder / INDEX).read_text(encoding="utf-8"))["attempts"][-1]
    except (OSError, ValueError, IndexError):
        return ""
    return "" if (folder / last["folder"] / OUTCOME).exists() else str(last["stage"])


class Script:
    """The person: yes to all, one reading of the scale, carries the vehicle to the middle when asked to."""

    def __init__(self, reading: float, folder: Path):
        self._numbers, self._begun, self._carry = [2.0 * reading, reading], time.monotonic(), folder / CARRY

    def confirm(self, question: str) -> bool:
        self.say(f"? {question}")
        if "Is it there now?" in question:
            self._carry.touch()
            while self._carry.exists():
                time.sleep(0.2)
        return "One more pull" not in question

    def number(self, question: str, unit: str) -> float | None:
        return self._numbers.pop(0) if self._numbers else None

    def say(self, line: str) -> None:
        print(f"{time.monotonic() - self._begun:7.1f} {line}", flush=True)

    def progress(self, what: str, share: float | None = None) -> None:
        pass


def child(arguments: argparse.Namespace) -> None:
    """The commissioning itself."""
    from rovtwin.commission.request import Request
    from rovtwin.commission.run import commission as run
    from rovtwin.commission.stages import STAGES

    sensors = () if arguments.protocol == "twin" else (MOCAP,)
    request = Request(
        arguments.vehicle, LINKS[arguments.protocol], sensors, arguments.tank, None, minutes=arguments.minutes
    )
    person = Script(float(arguments.child), arguments.out)
    run(request, arguments.out / "commissioned", STAGES, person, shown=lambda stage, attempt: show(person, attempt))


def show(person: Script, attempt: Any) -> None:
    """The page of a stage that has just ended."""
    person.say(f"== {attempt.stage}: {'go' if attempt.outcome.go else 'NO-GO'}, {attempt.outcome.seconds:.0f} s")
    for check in attempt.outcome.checks:
        person.say(f"   {check}")


def scores(folder: Path, truth: Any) -> dict[str, Any]:
    """What was found, against the truth."""
    from rovtwin.commission.dossier import Dossier, status
    from rovtwin.commission.stages import STAGES

    dossier = Dossier.open(folder)
    attempts = [one.outcome for stage in STAGES for one in dossier.attempts(stage.name)]
    seconds = [outcome.seconds for outcome in attempts if outcome is not None]
    made: dict[str, Any] = {
        "stages": {stage.name: words for stage, words, _ in status(dossier, STAGES)},
        "vehicle_minutes": sum(seconds) / 60.0,
    }
    if dossier.passed("identify") is not None:
        made |= identified(dossier.measured("identify"), truth)
    return made | {"four_corners": dossier.measured("predict")}


def identified(measured: dict[str, Any], truth: Any) -> dict[str, Any]:
    """Damping forces at the tested speeds, and all parameters, against the truth."""
    from rovtwin.core.numerics import as_array
    from rovtwin.vehicle.constants import AXES
    from rovtwin.vehicle.physics.dynamics import damping_wrench

    model, rows = truth.model(), []
    for row in measured["damping"]:
        axis, at = AXES.index(row["axis"]), np.zeros(6)
        at[axis] = row["speed"]
        force, (low, high) = float(damping_wrench(model, as_array(at))[axis]), row["interval_95"]
        error = row["force"] / force - 1.0
        rows.append(
            {
                "axis": row["axis"],
                "speed": row["speed"],
                "inside": low <= force <= high,
                "error": error,
                "half_width": row["half_width_share"],
            }
        )
    values = dict(zip(truth.parameters.names, truth.parameters.values(truth.theta), strict=True))
    outside, known = [], 0
    for row in measured["parameters"]:
        if row["name"] in values:
            known += 1
            low, high = row["interval_95"]
            if not low <= values[row["name"]] <= high:
                outside.append({"name": row["name"], "truth": float(values[row["name"]]), "interval_95": [low, high]})
    return {"damping": rows, "parameters": known, "outside": outside}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vehicle", help="file or library name")
    parser.add_argument("--protocol", choices=[*LINKS], default="blueye")
    parser.add_argument("--tank", default="6x3x1.5")
    parser.add_argument("--minutes", type=float, default=8.0)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--kill", action="store_true", help="kill -9 once in each stage, and go on")
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    (begin if arguments.child is None else child)(arguments)


if __name__ == "__main__":
    main()
