"""The demonstration's payload: a Doppler log and a sonar are bolted on, the vehicle is tested, identified and flown."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.user_files.config import parse
from rovtwin.core.user_files.files import write_text
from rovtwin.identification.identify import Identification, identify
from rovtwin.identification.joint.result.overlay import to_yaml
from rovtwin.identification.logs.readers import read_records
from rovtwin.report.parts.tables import Table
from rovtwin.runs.fly import fly
from rovtwin.runs.vehicle_figures import compared
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model, Vehicle, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.outfitting.refit import add, trimming, with_ballast

VEHICLE = "double_blueye"
# Device, name of the part, place of its origin in b [m].
PAYLOAD = (("dvl_a50", "dvl", (-0.2, 0.0, 0.16)), ("imaging_sonar", "sonar", (0.28, 0.0, 0.12)))
FREE = ("added_mass.surge", "linear_damping*.surge", "quadratic_damping*.surge")
# The vehicle that swims: neither the old figures nor the formulas for the devices are exact.
OFF = {"added_mass": 1.1, "linear_damping": 1.5, "quadratic_damping": 1.3,
       "linear_damping_astern": 1.5, "quadratic_damping_astern": 1.2}  # fmt: skip
TEST = {
    "name": "payload_test",
    "description": "Free running in surge with a Doppler log and a sonar bolted on.",
    "duration": 60,
    "start": {"position": [0.0, 0.0, 1.5]},
    "test": {
        "name": "free running",
        "manoeuvres": [{"manoeuvre": "steps", "axis": "surge", "levels": [0.4, 0.9], "duration": 8, "alternate": True}],
    },
}


@dataclass(frozen=True)
class Refitted:
    """What came of it.

    Attributes:
        changes: What the devices change, by the parts list.
        learnt: Parameters: predicted, found with 95 % interval, truth.
        truth: The vehicle that swims.
        file: Of the identified vehicle.
        summary: For `--json`.
    """

    changes: Table
    learnt: Table
    truth: Model
    file: Path
    summary: dict[str, Any]


def refit_and_identify(folder: Path, say: Callable[[str], None] = lambda what: None) -> Refitted:
    """Bolt the payload on, trim, test and identify the vehicle; files and log are written into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    say("payload: bolting a Doppler log and a sonar on")
    before, after = load_vehicle(VEHICLE), bolted_on(folder)
    vehicle = load_vehicle(after)
    swims = _off(vehicle)
    truth = swims.model()
    say("payload: flying a test of a minute")
    fly(parse(Scenario, TEST | {"vehicle": swims.to_dict()}, "demo"), folder / "test")
    say("payload: identifying")
    result = identify(vehicle, read_records(folder / "test" / "log.mcap", vehicle), free=FREE)
    file = folder / "identified.yaml"
    write_text(file, to_yaml(result.file(), "rovtwin demo"))
    names = result.parameters.names
    rows = [_row(name, result, vehicle.model(), truth) for name in names]
    inside = sum(low <= _of(truth, name) <= high for name in names for low, high in [result.interval(name)])
    return Refitted(
        Table("", ["", "Before", "After"], _changes(before, vehicle), "By the parts list; ballast trims it again."),
        Table("", ["Parameter", "Predicted", "Found (95 % interval)", "Truth"], rows, NOTE),
        truth,
        file,
        {"parameters": result.values, "inside": inside, "of": len(names), "identified": str(file)},
    )


NOTE = (
    "Surge only, to be quick. Predicted: the vehicle's figures of before plus the devices by formula. The plant "
    "has 10 % more added mass and 20 to 50 % more drag; a test of a minute with its new Doppler log shows it. "
    "Thrust is given."
)


def _off(vehicle: Vehicle) -> Vehicle:
    """The same parts with more added mass and drag in surge than anybody thinks."""
    model, water = vehicle.model(), {}
    for family, factor in OFF.items():
        matrix = np.array(getattr(model, _field(family)))
        matrix[0, :] *= np.sqrt(factor)  # its couplings grow with it
        matrix[:, 0] *= np.sqrt(factor)
        water[family] = matrix.tolist()
    return vehicle_from_dict(vehicle.to_dict() | {"name": "payload_truth", "hydrodynamics": water}, "demo")


def bolted_on(folder: Path) -> Path:
    """The file of the vehicle with the payload and the ballast that trims it."""
    path, source = folder / "with_payload.yaml", VEHICLE
    for device, name, place in PAYLOAD:
        change = add(source, device, place, name=name, out=path)
        write_text(path, change.text)
        source = str(path)
    pieces = trimming(load_vehicle(VEHICLE), change.after)
    write_text(path, with_ballast(change, pieces, path).text)
    return path


def _changes(before: Vehicle, after: Vehicle) -> list[list[str]]:
    shown = ("mass", "net_buoyancy", "trim", "added_mass_surge", "top_speed_surge_ahead", "hotel_load", "endurance",
             "position_bound_surge", "position_bound_sway")  # fmt: skip
    chosen = [row for row in compared(before, after) if row["key"] in shown]
    return [[f"{row['label']} [{row['unit']}]", _number(row["before"]), _number(row["after"])] for row in chosen]


def _number(value: float | None) -> str:
    return "–" if value is None else f"{round(value, 6) + 0.0:.3g}"


def _row(name: str, result: Identification, predicted: Model, truth: Model) -> list[str]:
    low, high = result.interval(name)
    family = name.partition(".")[0]
    unit = next(p.unit for p in result.parameters.free if p.name == name)
    guess, true = (f"{_of(model, name):.3g}" for model in (predicted, truth))
    found = f"{result.values[name]:.3g} ({low:.3g} to {high:.3g})"
    return [f"{family.replace('_', ' ')}, surge [{unit}]", guess, found, true]


def _of(model: Model, name: str) -> float:
    """The entry of surge of a matrix of the model."""
    return float(getattr(model, _field(name.partition(".")[0]))[0, 0])


def _field(family: str) -> str:
    return family if family == "added_mass" or family.endswith("_astern") else f"{family}_ahead"
