"""The manoeuvres that a planned test is chosen from, and the thesis's steady steps that it is held against."""

from typing import Any

import numpy as np

from rovtwin.gnc.trial import mixing
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema.trial import AXES

PULL, HOME, HAND, DECAY = 30.0, 10.0, 8.0, 20.0  # excitation, way home; hand, decay [s]
THESIS = "test_steps_thesis"


def thesis_pulls() -> list[dict[str, Any]]:
    """The thesis's steady steps and releases, one level each."""
    test = load_scenario(THESIS).test
    assert test is not None
    pulls = []
    for one in test.manoeuvres:
        data = one.model_dump(mode="json")
        pulls += [data | {"levels": [level]} for level in data["levels"]] if "levels" in data else [data]
    return pulls


def candidates(configuration: np.ndarray, seed: int) -> list[dict[str, Any]]:
    """Manoeuvres to choose from, each with its way home.

    Args:
        configuration: T of the thrusters, shape (6, n): excited are axes that they push.
        seed: Of multi-sines.
    """
    able = np.abs(mixing(configuration)).max(axis=0, initial=0.0) > 0
    axes = [axis for axis, can in zip(AXES, able, strict=True) if can]
    home = {"home": HOME}
    found: list[dict[str, Any]] = []
    for axis in axes:
        for level in (0.3, 0.6, 1.0):
            for time in (2.5, 5.0, 7.5):
                repeat = max(1, round(PULL / (2 * time)))
                found.append(
                    home | {"manoeuvre": "doublets", "axis": axis, "level": level, "half": time, "repeat": repeat}
                )
    rng = np.random.default_rng(seed)
    found += [home | _multisine(axes, rng) for _ in range(60)]
    # Long pulls, which tell linear from quadratic drag: as far as the tank lets them go.
    for axis in axes[:2]:
        for level in (0.2, 0.4, 0.6, 0.8, 1.0):
            steps = {"manoeuvre": "steps", "axis": axis, "levels": [level], "duration": PULL / 2, "alternate": True}
            found.append(home | steps)
    release = home | {"manoeuvre": "release", "by_hand": HAND, "duration": DECAY}
    for angle in (15.0, 30.0, 45.0):
        for tilt in ([angle, 0.0], [-angle, 0.0], [0.0, angle], [0.0, -angle], [0.7 * angle, 0.7 * angle]):
            found.append(release | {"attitude_deg": tilt})
    return found


def _multisine(axes: list[str], rng: np.random.Generator) -> dict[str, Any]:
    """Three sines on some axes, full commands at most, frequencies from those of drag to those of inertia."""
    some = rng.choice(axes, size=rng.integers(1, len(axes) + 1), replace=False)
    sines = {}
    for axis in sorted(some.tolist(), key=AXES.index):
        frequencies = np.sort(np.exp(rng.uniform(np.log(0.04), np.log(0.6), 3)))
        amplitudes = rng.dirichlet(np.ones(3)) * rng.uniform(0.4, 1.0)
        sines[axis] = {
            "frequencies_hz": [round(float(f), 3) for f in frequencies],
            "amplitudes": [round(float(max(a, 0.01)), 3) for a in amplitudes],
            "phases_deg": [round(float(p), 1) for p in rng.uniform(-180, 180, 3)],
        }
    return {"manoeuvre": "multisine", "duration": PULL, "axes": sines}


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
