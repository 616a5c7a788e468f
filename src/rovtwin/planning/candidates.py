"""The manoeuvres that a planned test is chosen from, and the thesis's steady steps that it is held against."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.runs.compose.experiment_scales import ExperimentScales
from rovtwin.runs.compose.fit_experiment import fitted_test
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema.experiment import AXES

# Shares of the vehicle's own times: of the rise of a pull, of the way home's time constant, of a period of roll, pitch.
PULL, HALVES, HOME, DECAY = 17.5, (1.45, 2.9, 4.35), 5.0, 3.8
SLOWEST, FASTEST = 0.07, 1.0  # frequencies of multi-sines, over one by the rise
SHORTEST, LONGEST = 5.0, 90.0  # of a manoeuvre: readings come at 15 Hz, and time is dear [s]
HAND = 8.0  # a person tilts a vehicle in this, of whatever size [s]
THESIS = "test_steps_thesis"


@dataclass(frozen=True)
class _Times:
    """Of one vehicle's manoeuvres [s], frequencies [Hz]."""

    pull: float
    halves: list[float]
    home: float
    decay: float
    frequencies: tuple[float, float]

    @classmethod
    def of(cls, scales: ExperimentScales) -> "_Times":
        def bounded(value: float) -> float:
            return round(float(np.clip(value, SHORTEST, LONGEST)), 1)

        pull = bounded(PULL * scales.unit)
        slowest = max(SLOWEST / scales.unit, 1.0 / pull)
        return cls(
            pull=pull,
            halves=[round(float(np.clip(share * scales.unit, 0.3, pull)), 2) for share in HALVES],
            home=bounded(HOME * scales.home),
            decay=bounded(DECAY * (scales.swing or 0.0)),
            frequencies=(slowest, max(FASTEST / scales.unit, 2.0 * slowest)),
        )


def thesis_pulls(reference: str) -> list[dict[str, Any]]:
    """The thesis's steady steps and releases, one level each, as a vehicle can fly them; none where it can do nothing.

    Args:
        reference: The vehicle's name or file.
    """
    test = fitted_test(load_scenario(THESIS, [f"vehicle={json.dumps(reference)}"])).test
    assert test is not None
    pulls = []
    for one in test.manoeuvres:
        data = one.model_dump(mode="json")
        pulls += [data | {"levels": [level]} for level in data["levels"]] if "levels" in data else [data]
    return pulls


def candidates(scales: ExperimentScales, seed: int, by_hand: bool = True) -> list[dict[str, Any]]:
    """Manoeuvres to choose from, each with its way home.

    Args:
        scales: Of the vehicle: excited are axes that it pushes, in its own times.
        seed: Of multi-sines.
        by_hand: Whether somebody tilts the vehicle for releases.
    """
    axes = [axis for axis, can in zip(AXES, scales.able, strict=True) if can]
    times = _Times.of(scales)
    home = {"home": times.home}
    found: list[dict[str, Any]] = []
    for axis in axes:
        for level in (0.3, 0.6, 1.0):
            for half in times.halves:
                repeat = max(1, round(times.pull / (2 * half)))
                found.append(
                    home | {"manoeuvre": "doublets", "axis": axis, "level": level, "half": half, "repeat": repeat}
                )
    rng = np.random.default_rng(seed)
    found += [home | _multisine(axes, times, rng) for _ in range(60 if axes else 0)]
    # Long pulls, which tell linear from quadratic drag: as far as the tank lets them go.
    for axis in axes:
        for level in (0.2, 0.4, 0.6, 0.8, 1.0) if axis in ("surge", "sway") else ():
            steps = {"manoeuvre": "steps", "axis": axis, "levels": [level], "duration": 0.5 * times.pull}
            found.append(home | steps | {"alternate": True})
    return found + [home | one for one in (_releases(scales, times) if by_hand else ())]


def _releases(scales: ExperimentScales, times: _Times) -> list[dict[str, Any]]:
    """Decays from a third, two thirds and all of the angle that two hands can hold; none where nothing swings back."""
    roll, pitch = np.degrees(scales.tilt)
    found = []
    for share in (1.0 / 3.0, 2.0 / 3.0, 1.0) if scales.swing else ():
        for side, bow in ((1, 0), (-1, 0), (0, 1), (0, -1), (0.7, 0.7)):
            tilt = [round(float(share * side * roll), 2), round(float(share * bow * pitch), 2)]
            found.append({"manoeuvre": "release", "by_hand": HAND, "duration": times.decay, "attitude_deg": tilt})
    return found


def _multisine(axes: list[str], times: _Times, rng: np.random.Generator) -> dict[str, Any]:
    """Three sines on some axes, full commands at most, frequencies from those of drag to those of inertia."""
    some = rng.choice(axes, size=rng.integers(1, len(axes) + 1), replace=False)
    low, high = np.log(times.frequencies)
    sines = {}
    for axis in sorted(some.tolist(), key=AXES.index):
        frequencies = np.sort(np.exp(rng.uniform(low, high, 3)))
        amplitudes = rng.dirichlet(np.ones(3)) * rng.uniform(0.4, 1.0)
        sines[axis] = {
            "frequencies_hz": [round(float(f), 4) for f in frequencies],
            "amplitudes": [round(float(max(a, 0.01)), 3) for a in amplitudes],
            "phases_deg": [round(float(p), 1) for p in rng.uniform(-180, 180, 3)],
        }
    return {"manoeuvre": "multisine", "duration": times.pull, "axes": sines}


def in_words(manoeuvre: dict[str, Any]) -> str:
    """A manoeuvre in a few words."""
    match manoeuvre["manoeuvre"]:
        case "doublets":
            return f"{manoeuvre['axis']} doublets, level {manoeuvre['level']:g}, {manoeuvre['half']:g} s each way"
        case "steps":
            return f"{manoeuvre['axis']} steps, level {manoeuvre['levels'][0]:g}, ahead and astern"
        case "multisine":
            return f"multi-sine on {', '.join(manoeuvre['axes'])}"
        case _:
            roll, pitch = manoeuvre["attitude_deg"]
            return f"released at roll {roll:g}, pitch {pitch:g} deg"
