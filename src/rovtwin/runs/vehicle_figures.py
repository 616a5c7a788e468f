"""What a vehicle comes to in a few figures, beside another's: weight, balance, speed, power, what a filter can know."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import load_scenario
from rovtwin.survey.energy import budget
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.analysis.hydrostatics import floating_of
from rovtwin.vehicle.analysis.lint import uncontrollable
from rovtwin.vehicle.analysis.performance import AxisPerformance, performance
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.description.totals.assembly import bodies

HOUR = 3600.0  # [s]
CRUISE = 0.5  # share of its top speed at which a vehicle is taken to travel


@dataclass(frozen=True)
class Figure:
    """One figure of a vehicle, or a list of names; None where there is none, such as endurance without a battery.

    `why` says for what reason there is none, where that is not plain.
    """

    key: str
    label: str
    unit: str
    value: float | list[str] | None
    why: str = ""


def key_figures(vehicle: Vehicle, speed: float | None = None) -> list[Figure]:
    """The figures, in reading order; the same keys for every vehicle.

    Args:
        vehicle: What to describe.
        speed: At which it travels [m/s], inf where nothing drags; None: at half its top speed.
    """
    model = vehicle.model()
    able = performance(model)
    if speed is None:
        speed = CRUISE * able["surge"]["ahead"].top_speed
    return [
        *_balance(vehicle),
        *(
            Figure(
                f"added_mass_{axis}", f"added mass {axis}", "kg" if i < 3 else "kg m2", float(model.added_mass[i, i])
            )
            for i, axis in enumerate(AXES)
        ),
        *_speeds(able),
        Figure("uncontrollable", "no thruster reaches", "", _uncontrollable(model)),
        *_power(vehicle, model, speed),
        Figure("sensors", "sensors", "", [s.name for s in vehicle.sensors if not s.spare]),
        *_bounds(vehicle, speed),
    ]


def compared(before: Vehicle, after: Vehicle) -> list[dict[str, Any]]:
    """The figures of two vehicles side by side, both at the first's speed.

    Each has key, label, unit, before, after, change, and why there is none after, or "".
    The change of a number is a number, of a list of names those that came and went, `+dvl` and `-lamp`.
    """
    rows, speed = [], CRUISE * performance(before.model())["surge"]["ahead"].top_speed
    for old, new in zip(key_figures(before, speed), key_figures(after, speed), strict=True):
        change: float | list[str] | None = None
        if isinstance(old.value, float) and isinstance(new.value, float):
            change = new.value - old.value
        elif isinstance(old.value, list) and isinstance(new.value, list):
            change = [f"+{name}" for name in new.value if name not in old.value]
            change += [f"-{name}" for name in old.value if name not in new.value]
        row = {"key": old.key, "label": old.label, "unit": old.unit, "before": old.value, "after": new.value}
        rows.append(row | {"change": change, "why": new.why})
    return rows


def _balance(vehicle: Vehicle) -> list[Figure]:
    rest = floating_of(vehicle.assembly)
    roll, pitch = (float(angle) if np.isfinite(angle) else None for angle in np.degrees(rest.trim))
    return [
        Figure("mass", "mass", "kg", float(vehicle.assembly.solid.mass)),
        Figure("net_buoyancy", "net buoyancy", "N", float(rest.net_buoyancy)),
        Figure("list", "list (roll at rest)", "deg", roll),
        Figure("trim", "trim (pitch at rest)", "deg", pitch),
        Figure("metacentric_height", "metacentric height BG", "mm", 1000.0 * float(rest.metacentric_height)),
        Figure("righting_stiffness", "righting stiffness", "N m/rad", float(rest.stiffness[0])),
    ]


def _speeds(able: dict[str, dict[str, AxisPerformance]]) -> list[Figure]:
    """Of each axis alone, where drag balances the largest thrust; None where nothing drags."""
    figures = []
    for axis, directions in able.items():
        for direction, one in directions.items():
            turns = axis == "yaw"
            speed = float(np.degrees(one.top_speed)) if turns else float(one.top_speed)
            value = speed if np.isfinite(speed) else None
            figures.append(
                Figure(
                    f"top_speed_{axis}_{direction}", f"top speed {axis} {direction}", "deg/s" if turns else "m/s", value
                )
            )
    return figures


def _uncontrollable(model: Model) -> list[str]:
    return uncontrollable(np.asarray(model.thrusters.configuration)) if model.thrusters.count else ["anything"]


def devices_load(vehicle: Vehicle) -> float:
    """What all parts draw by their `power`, whether there is a battery or not [W]."""
    return float(sum(part.power for _, part in bodies(vehicle.file, "") if part.power))


def _power(vehicle: Vehicle, model: Model, speed: float) -> list[Figure]:
    """Without the corrections of an autopilot, current and waves."""
    moves = bool(np.isfinite(speed))
    at = f"at {speed:.2g} m/s" if moves else "under way"
    going = budget(vehicle, model, speed if moves else 0.0, going=HOUR, waiting=0.0)
    resting = budget(vehicle, model, speed, going=0.0, waiting=HOUR)

    def hours(share: float | None) -> float | None:
        return 1.0 / share if share else None

    return [
        Figure(
            "hotel_load",
            "power of all but thrusters",
            "W",
            going.hotel_w if going.names else devices_load(vehicle) or None,
        ),
        Figure("propulsion", f"power of thrusters {at}", "W", going.propulsion_w if moves else None),
        Figure("capacity", "batteries", "Wh", float(going.capacity_wh.sum()) if going.names else None),
        Figure("endurance_at_rest", "endurance at rest", "h", hours(resting.share)),
        Figure("endurance", f"endurance {at}", "h", hours(going.share) if moves else None),
    ]


def _bounds(vehicle: Vehicle, speed: float) -> list[Figure]:
    """The least error of position that any filter can have in calm water with the sensors on board."""
    surge = sway = None
    why = "nothing drags it (no part has a shape or damping), so that it has no top speed"
    if np.isfinite(speed):
        try:
            scenario = load_scenario("lawnmower_calm").model_copy(update={"vehicle": vehicle.to_dict()})
            (surge, sway), why = compose(scenario, vehicle=vehicle).bound(speed), ""
        except ConfigError as error:  # it cannot fly, or nothing on board tells positions
            why = str(error)
    return [
        Figure("position_bound_surge", "position bound along", "m", surge, why),
        Figure("position_bound_sway", "position bound across", "m", sway, why),
    ]
