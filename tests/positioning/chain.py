"""Chapter 8.1 again: `python -m tests.positioning.chain [surge|sway] [--keep FOLDER]`.

The thesis's vehicle is flown and filmed (scenarios `free_running_surge`, `_sway`), tracked by markers and identified
from the track: the thrust given, all else of that axis guessed wrong. Prints the tables of docs/positioning.md.
Rendering takes minutes; runs are kept in --keep and used again.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import nnls

from rovtwin.core.log import Log
from rovtwin.identification.identify import Identification, identify
from rovtwin.identification.logs.readers import read_records
from rovtwin.positioning.track import Method
from rovtwin.runs.fly import fly
from rovtwin.runs.track import TrackOptions, track_run
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema.experiment import AXES
from rovtwin.vehicle import Vehicle, load_vehicle, vehicle_from_dict

TRUTH = "double_blueye_thesis"
FAMILIES = ("added_mass", "linear_damping", "quadratic_damping")
WRONG = {"added_mass": 0.6, "linear_damping": 2.0, "quadratic_damping": 0.6}  # the guess over the truth
NOT_NOUGHT = 15.0  # guessed for what is zero in truth [N s2/m2]
FORCE = {"surge": 20.0, "sway": 10.0}  # of a full command, thesis table 5.3 [N]
# Thesis table 8.1, surge: speeds from its ArUco positions, and those that it calls ground truth [m/s].
TABLE_8_1 = np.array([[0.062, 0.109, 0.188, 0.248, 0.306], [0.057, 0.115, 0.169, 0.223, 0.262]])
TABLE_8_2 = {"added_mass": 23.03, "linear_damping": 65.28, "quadratic_damping": 0.0}
STEADY = 0.5  # last share of a pull, in which the speed counts as steady


@dataclass(frozen=True)
class Result:
    """Steady speeds [m/s] and forces [N], shape (pulls,), ahead and astern averaged, and the parameters found."""

    force: np.ndarray
    speed: np.ndarray
    rms: np.ndarray
    parameters: dict[str, float]
    identified: Identification | None


def run(axis: str, folder: Path, overrides: tuple[str, ...] = ()) -> Path:
    """The log of a filmed run, flown if it is not there."""
    if not (folder / "log.mcap").is_file():
        fly(load_scenario(f"free_running_{axis}", overrides), folder, camera=True)
    return folder / "log.mcap"


def chain(axis: str, log: Path, known: bool = True) -> Result:
    """Track by the smoother and identification from it; known: whether the places of the markers are."""
    found, track = _track(axis, log, "smoother", known)
    path = log.with_name("track.mcap" if known else "track_unknown.mcap")
    track.write(path, overwrite=True)
    guess = guessed(load_vehicle(TRUTH), axis)
    free = [f"{family}.{axis}" for family in FAMILIES]
    result = identify(guess, read_records(path, guess), free=free)
    values = {family: result.values[f"{family}.{axis}"] for family in FAMILIES}
    speed = steady_speeds(axis, found.t, found.position, Log.read(log))
    return Result(*speed, rms(found, log), values, result)


def thesis_way(axis: str, log: Path) -> Result:
    """Plain differences of the mended Luenberger's positions, damping by least squares of non-negative coefficients."""
    found, _ = _track(axis, log, "luenberger", known=False)
    force, speed = steady_speeds(axis, found.t, found.position, Log.read(log))
    coefficients, _ = nnls(np.stack([speed, speed**2], axis=1), force)
    values: dict[str, float] = dict(zip(FAMILIES[1:], coefficients.tolist(), strict=True))
    return Result(force, speed, rms(found, log), values, None)


def _track(axis: str, log: Path, method: Method, known: bool) -> Any:
    start = load_scenario(f"free_running_{axis}").start.position
    return track_run(log, load_vehicle(TRUTH), method, TrackOptions(cameras=["port"], known_layout=known, start=start))


def guessed(vehicle: Vehicle, axis: str) -> Vehicle:
    """The vehicle as somebody believes it to be who has never tested it along an axis."""
    data, at = vehicle.to_dict(), AXES.index(axis)
    water = dict(data["hydrodynamics"])
    for name in [name for name in water if name.removesuffix("_astern") in WRONG]:
        values = list(water[name])
        if values[at] is not None:
            values[at] = values[at] * WRONG[name.removesuffix("_astern")] or NOT_NOUGHT
        water[name] = values
    data["hydrodynamics"] = water
    return vehicle_from_dict(data, "guess.yaml")


def steady_speeds(axis: str, t: np.ndarray, position: np.ndarray, log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Forces and speeds of the pulls, from a straight line through positions of their last part, shapes (pulls,)."""
    speeds: dict[float, list[float]] = {}
    for span in json.loads(log.metadata["test"]):
        if not span["what"].startswith("steps"):
            continue
        share = abs(float(span["what"].split()[-1]))
        begin = span["end"] - STEADY * (span["end"] - span["start"])
        rows = (t >= begin) & (t <= span["end"])
        slope = np.polyfit(t[rows], position[rows, AXES.index(axis)], 1)[0]
        speeds.setdefault(share, []).append(abs(slope))
    force = FORCE[axis] * np.array(list(speeds))
    return force, np.array([np.mean(both) for both in speeds.values()])


def true_speeds(axis: str, log: Path) -> tuple[np.ndarray, np.ndarray]:
    """The same from the truth."""
    truth = Log.read(log)["truth/eta"]
    return steady_speeds(axis, truth.t, np.stack([truth[name] for name in "xyz"], axis=1), Log.read(log))


def rms(found: Any, log: Path) -> np.ndarray:
    """Error of a track, north, east, down [m], shape (3,)."""
    truth = Log.read(log)["truth/eta"]
    error = found.position - np.stack([np.interp(found.t, truth.t, truth[name]) for name in "xyz"], axis=1)
    return np.sqrt(np.mean(error**2, axis=0))


def true_values(axis: str) -> dict[str, float]:
    """What the flown vehicle has."""
    water = load_vehicle(TRUTH).to_dict()["hydrodynamics"]
    return {family: water[family][AXES.index(axis)] for family in FAMILIES}


def damping(values: dict[str, float], speed: np.ndarray) -> np.ndarray:
    """Force at speeds [N]."""
    return values["linear_damping"] * speed + values["quadratic_damping"] * speed**2


def terminal(values: dict[str, float], force: np.ndarray) -> np.ndarray:
    """Speeds at which the damping takes a force [m/s]."""
    linear, quadratic = values["linear_damping"], values["quadratic_damping"]
    return 2.0 * force / (linear + np.sqrt(linear**2 + 4.0 * quadratic * force))


def damping_error(values: dict[str, float], truth: dict[str, float], speed: np.ndarray) -> float:
    """Largest relative error of the damping force over speeds, with its sign."""
    relative = damping(values, speed) / damping(truth, speed) - 1.0
    return float(relative[np.argmax(np.abs(relative))])


def report(axis: str, log: Path) -> dict[str, Any]:
    """Prints the tables; gives forces, speeds and parameters by method, kept as `chain.json` beside the log."""
    truth = true_values(axis)
    force, speed = true_speeds(axis, log)
    data: dict[str, Any] = {"force": force.tolist(), "flown": speed.tolist(), "truth": truth, "methods": {}}
    print(f"{axis}, force {force} N; speeds of the model {terminal(truth, force).round(4)}, flown {speed.round(4)} m/s")
    ways = {
        "markers known": lambda: chain(axis, log),
        "markers unknown": lambda: chain(axis, log, known=False),
        "Luenberger, differences": lambda: thesis_way(axis, log),
    }
    for name, way in ways.items():
        result = way()
        data["methods"][name] = {"speed": result.speed.tolist(), "parameters": result.parameters}
        log.with_name("chain.json").write_text(json.dumps(data), encoding="utf-8")
        print(f"{name}: speeds {result.speed.round(4)}, track rms north, east, down {(1e3 * result.rms).round(1)} mm")
        _print(name, result.parameters, truth, force)
        if result.identified is not None:
            ends = {f: np.round(result.identified.interval(f"{f}.{axis}"), 2).tolist() for f in FAMILIES}
            print(f"  95 % intervals: {ends}; {result.identified.seconds:.0f} s", flush=True)
    if axis == "surge":
        print(f"thesis table 8.1: ArUco {TABLE_8_1[0]}, 'ground truth' {TABLE_8_1[1]}")
        _print("thesis table 8.2", TABLE_8_2, truth, force)
    return data


def _print(name: str, values: dict[str, float], truth: dict[str, float], force: np.ndarray) -> None:
    mass = values.get("added_mass", np.nan)
    error = 100 * damping_error(values, truth, terminal(truth, force))
    print(
        f"  {name}: added mass {mass:.2f} kg ({100 * (mass / truth['added_mass'] - 1):+.1f} %), damping "
        f"{values['linear_damping']:.2f}, {values['quadratic_damping']:.2f}: force {error:+.1f} % at most",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("axis", choices=sorted(FORCE), nargs="*", default=["surge", "sway"])
    parser.add_argument("--keep", type=Path, default=Path("runs/chain"))
    given = parser.parse_args()
    for axis in given.axis:
        report(axis, run(axis, given.keep / axis))


if __name__ == "__main__":
    main()
