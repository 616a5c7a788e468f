"""The lawn-mower by the autopilot through the Blueye protocol, beside the same flight computed in one process.

python docs/scripts/lawnmower_over_blueye.py OUT --seeds 1 2 3 --speed 1

It serves the twin in a process of its own, flies it over its protocol with positions from its Underwater GPS, and
judges both flights by the truth; writes OUT.json and OUT.png.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.log import Log
from rovtwin.live.connect import connect, source
from rovtwin.live.flight import fly_live
from rovtwin.report.parts.style import BLACK, BLUE
from rovtwin.runs.fly import fly
from rovtwin.runs.pace import Clock
from rovtwin.runs.scoring.scores import distance_to_leg
from rovtwin.scenario.files import load_scenario

HOSTS, UGPS, DVL = ("127.0.0.62", "127.0.0.63"), 8081, 16172


class Serving:
    """`rovtwin serve double_blueye` in a process of its own."""

    def __init__(self, log: Path, speed: float, seed: int, dvl: bool):
        protocols = ["--protocol", "blueye", "--protocol", "ugps", *(["--protocol", "dvl"] if dvl else [])]
        addresses = [f"blueye={h}" for h in HOSTS] + [f"ugps=127.0.0.1:{UGPS}"]
        addresses += [f"dvl=127.0.0.1:{DVL}"] if dvl else []
        command = [sys.executable, "-m", "rovtwin.cli", "serve", "double_blueye", *protocols, "--log", str(log)]
        command += [word for address in addresses for word in ("--address", address)]
        command += ["--speed", str(speed), "--seed", str(seed)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        for line in self.process.stdout or ():
            if line.startswith("blueye:"):
                break

    def end(self) -> None:
        self.process.send_signal(signal.SIGINT)
        self.process.wait(30)


def over_the_wire(seed: int, speed: float, dvl: bool, folder: Path) -> dict:
    """One flight over the protocol, judged by the truth."""
    scenario = load_scenario("lawnmower_calm_dvl" if dvl else "lawnmower_calm", ["autopilot=model_based"], seed)
    serving = Serving(folder / f"truth{seed}.mcap", speed, seed, dvl)
    try:
        clock = Clock(speed)
        sources = [source(f"ugps://127.0.0.1:{UGPS}", clock)]
        sources += [source(f"dvl://127.0.0.1:{DVL}", clock)] if dvl else []
        link = connect(f"blueye://{','.join(HOSTS)}", scenario, clock)
        flight = fly_live(scenario, link, sources, clock, folder / f"live{seed}", arm=lambda readiness: True)
        for one in sources:
            one.close()
    finally:
        serving.end()
    return judged(Log.read(folder / f"truth{seed}.mcap"), flight.log) | {
        "completed": flight.completed,
        "late_ms_p99": flight.figures["late_ms_p99"],
        "late_ms_max": flight.figures["late_ms_max"],
        "duration_s": flight.figures["duration_s"],
    }


def judged(truth: Log, flown: Log) -> dict:
    """Cross-track and estimate's error by the truth; the two clocks are brought together by depth and place."""
    eta, estimate, leg, mode = truth["truth/eta"], *(flown[f"autopilot/{n}"] for n in ("eta", "leg", "mode"))

    def at(offset: float) -> np.ndarray:
        return np.stack([np.interp(estimate.t + offset, eta.t, eta.values[:, i]) for i in range(3)], axis=1)

    def misfit(offset: float) -> float:
        return float(np.mean(((at(offset) - estimate.values[:, :3]) / (0.2, 0.2, 0.01)) ** 2))

    offsets = np.arange(0.0, max(eta.t[-1] - estimate.t[-1], 0.1), 0.05)
    true = at(min(offsets, key=misfit))
    on = mode.values[:, 3] > 0.5
    error = true - estimate.values[:, :3]
    return {
        "cross_track_rms_m": rms(distance_to_leg(true[on], leg.values[on])),
        "error_rms_m": [rms(error[:, 0]), rms(error[:, 1])],
        "depth_error_rms_m": rms(error[:, 2]),
        "path": true[:, :2].tolist(),
        "link_age_max_s": float(flown["host/timing"].values[:, 1].max()),
    }


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def in_one_process(seed: int, dvl: bool) -> dict:
    """The same flight computed."""
    name = "lawnmower_calm_dvl" if dvl else "lawnmower_calm"
    flight = fly(load_scenario(name, ["autopilot=model_based"], seed))
    path = flight.log["truth/eta"].values[:, :2]
    keys = ("completed", "duration_s", "cross_track_rms_m")
    return {key: flight.figures[key] for key in keys} | {
        "error_rms_m": flight.figures["position_error_rms_m"],
        "path": path.tolist(),
    }


def drawn(rows: list[dict], legs: np.ndarray, path: Path) -> None:
    """Both paths of all seeds beside each other."""
    figure, both = plt.subplots(1, 2, figsize=(9, 4), sharex=True, sharey=True, layout="constrained")
    for axes, key, title, colour in zip(
        both, ("computed", "wire"), ("in one process", "over the Blueye protocol"), (BLUE, BLACK), strict=True
    ):
        axes.plot(legs[:, 1], legs[:, 0], color="0.7", linewidth=4, solid_capstyle="round", label="mission")
        for i, row in enumerate(rows):
            way = np.array(row[key]["path"])
            axes.plot(way[:, 1], way[:, 0], color=colour, linewidth=1, alpha=0.8, label="true path" if i == 0 else None)
        errors = ", ".join(f"{row[key]['cross_track_rms_m']:.2f}" for row in rows)
        axes.set_title(f"{title}\ncross-track rms {errors} m", fontsize=10)
        axes.set_xlabel("east [m]")
        axes.set_aspect("equal")
        axes.grid(alpha=0.3)
    both[0].set_ylabel("north [m]")
    both[0].legend(loc="center", fontsize=8)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Fly all seeds, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="without ending")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--dvl", action="store_true", help="with a DVL, too")
    asked = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in asked.seeds:
            row = {
                "seed": seed,
                "wire": over_the_wire(seed, asked.speed, asked.dvl, Path(folder)),
                "computed": in_one_process(seed, asked.dvl),
            }
            rows.append(row)
            short = {k: {n: v for n, v in row[k].items() if n != "path"} for k in ("wire", "computed")}
            print(json.dumps({"seed": seed} | short), flush=True)
            time.sleep(1.0)
    legs = np.array([w.position[:2] for w in load_scenario("lawnmower_calm").waypoints])
    legs = np.vstack([[0.0, 0.0], legs])
    asked.out.with_suffix(".json").write_text(json.dumps(rows))
    drawn(rows, legs, asked.out.with_suffix(".png"))


if __name__ == "__main__":
    main()
