"""A test that was written for one vehicle, as another one flies it: its own times, only axes that it can push."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.experiment import pieces_of
from rovtwin.runs.compose.experiment_scales import ExperimentScales
from rovtwin.runs.vehicle_defaults import vehicle_of
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.schema.experiment import AXES, ExperimentSection
from rovtwin.vehicle import Vehicle, load_vehicle
from rovtwin.vehicle.description.identified import fingerprint

LIMITS = (0.2, 5.0)  # of a time over what it was written as: a pull must be read, and a battery last


@dataclass(frozen=True)
class _Ratios:
    """Of the vehicle's own scales over those of the vehicle that a test was written for."""

    rise: Float[np.ndarray, "6"]
    home: float
    swing: float

    @classmethod
    def of(cls, own: ExperimentScales, written: ExperimentScales) -> "_Ratios":
        swing = own.swing / written.swing if own.swing and written.swing else 1.0
        home, swing = (float(np.clip(one, *LIMITS)) for one in (own.home / written.home, swing))
        return cls(np.clip(own.rise / written.rise, *LIMITS), home, swing)


def fitted_test(scenario: Scenario, vehicle: Vehicle | None = None) -> Scenario:
    """The scenario with the test that its vehicle flies; as it is where the test is written for no other vehicle.

    Args:
        scenario: With a mission or a test; what was fitted before stays as it is.
        vehicle: In place of the scenario's.

    Raises:
        ConfigError: Nothing of the test is left that the vehicle can do.
    """
    test = scenario.test
    if test is None or test.written_for is None:
        return scenario
    own = vehicle or vehicle_of(scenario)
    written = load_vehicle(test.written_for)
    if fingerprint(own.file) == fingerprint(written.file):
        return scenario.model_copy(update={"test": test.model_copy(update={"written_for": None})})
    scales, reference = ExperimentScales.of(own.model()), ExperimentScales.of(written.model())
    ratios = _Ratios.of(scales, reference)
    left, missing = [], {}
    for one in test.manoeuvres:
        data = one.model_dump(mode="json")
        without = _without(data, scales, missing)
        if without is not None:
            left.append(_timed(without, ratios))
    if not left:
        raise ConfigError(
            f"{scenario.name}: nothing of this test is left for {own.name}: {'; '.join(_in_words(missing))}. "
            "`rovtwin plan-tests` lays out a test of what it can do"
        )
    cameras = _cameras(scenario, own, missing)
    notes = [*_in_words(missing), _times_note(ratios, own, written)]
    changed = ExperimentSection(name=test.name, description=test.description, manoeuvres=left, notes=notes)
    start = _deeper(scenario, scales.length / reference.length)
    whole = scenario.model_copy(update={"test": changed, "start": start, "cameras": cameras})
    spare = scenario.duration / (_seconds(scenario) or 1.0)
    return whole.model_copy(update={"duration": float(math.ceil(spare * _seconds(whole)))})


def _seconds(scenario: Scenario) -> float:
    return sum(len(piece.share) for piece in pieces_of(scenario)) * scenario.control_dt


def _deeper(scenario: Scenario, larger: float) -> Any:
    """A larger vehicle starts as many lengths under the surface; where cameras look, the place stays."""
    north, east, depth = scenario.start.position
    if scenario.cameras or scenario.world.floor is not None or larger <= 1.0:
        return scenario.start
    return scenario.start.model_copy(update={"position": [north, east, depth * larger]})


def _cameras(scenario: Scenario, own: Vehicle, missing: dict[str, str]) -> list[Any]:
    """The test's cameras on the vehicle: of the same name, else its first; none where it carries none."""
    names = [one.name for one in own.cameras]
    if not names:
        missing |= {"the camera": "the vehicle carries none"} if scenario.cameras else {}
        return []
    return [one if one.camera in names else one.model_copy(update={"camera": names[0]}) for one in scenario.cameras]


def _without(data: dict[str, Any], scales: ExperimentScales, missing: dict[str, str]) -> dict[str, Any] | None:
    """A manoeuvre without what the vehicle cannot do, None where nothing is left; `missing` gets the reasons."""
    lacking = [axis for axis, can in zip(AXES, scales.able, strict=True) if not can]
    if data["manoeuvre"] == "multisine":
        missing |= {axis: "no thruster pushes there" for axis in data["axes"] if axis in lacking}
        axes = {axis: sines for axis, sines in data["axes"].items() if axis not in lacking}
        return data | {"axes": axes} if axes else None
    if data["manoeuvre"] == "release":
        return _held_by_hand(data, scales, missing)
    if data.get("axis") in lacking:
        missing[data["axis"]] = "no thruster pushes there"
        return None
    return data


def _held_by_hand(data: dict[str, Any], scales: ExperimentScales, missing: dict[str, str]) -> dict[str, Any] | None:
    if scales.swing is None:
        missing["the release"] = "nothing rights the vehicle, so that it would not swing back"
        return None
    most = np.degrees(scales.tilt)
    angles = [float(np.clip(angle, -top, top)) for angle, top in zip(data["attitude_deg"], most, strict=True)]
    return data | {"attitude_deg": [round(angle, 2) for angle in angles]}


def _timed(data: dict[str, Any], ratios: _Ratios) -> dict[str, Any]:
    """A manoeuvre with the vehicle's own times; a hand takes as long as it takes."""

    def scaled(value: float, ratio: float) -> float:
        return round(value * ratio, 2)

    data = dict(data)
    for name in ("home", "between", "settle"):
        if data.get(name):
            data[name] = scaled(data[name], ratios.home)
    match data["manoeuvre"]:
        case "steps":
            data["duration"] = scaled(data["duration"], ratios.rise[AXES.index(data["axis"])])
        case "doublets":
            data["half"] = scaled(data["half"], ratios.rise[AXES.index(data["axis"])])
        case "multisine":
            slowest = max(ratios.rise[AXES.index(axis)] for axis in data["axes"])
            data["duration"] = scaled(data["duration"], slowest)
            data["axes"] = {
                axis: sines
                | {
                    "frequencies_hz": [
                        round(float(f / ratios.rise[AXES.index(axis)]), 4) for f in sines["frequencies_hz"]
                    ]
                }
                for axis, sines in data["axes"].items()
            }
        case "release":
            data["duration"] = scaled(data["duration"], ratios.swing)
        case _:
            data["duration"] = scaled(data["duration"], ratios.home)
    return data


def _in_words(missing: dict[str, str]) -> list[str]:
    return [f"{what} is left out: {why}" for what, why in missing.items()]


def _times_note(ratios: _Ratios, own: Vehicle, written: Vehicle) -> str:
    low, high = float(ratios.rise.min()), float(ratios.rise.max())
    return (
        f"written for {written.name}: pulls of {own.name} take {low:.2g} to {high:.2g} times as long, "
        f"ways home {ratios.home:.2g}, decays {ratios.swing:.2g}"
    )
