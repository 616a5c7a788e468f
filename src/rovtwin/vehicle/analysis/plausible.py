"""Figures of a vehicle file that are possible and that hardly any vehicle has: thrust, top speed, noise of sensors.

Most of them are in another unit. Some may be true: nothing is refused.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rovtwin.core.sensors import PLAUSIBLE, SENSORS
from rovtwin.core.user_files.quantity import plain
from rovtwin.vehicle.analysis.stability import reach, steady_speed
from rovtwin.vehicle.constants import AXES, GRAVITY
from rovtwin.vehicle.description.instruments import instruments
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.actuation import size
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import force_limits

# Force of one thruster over the vehicle's weight: 0.026 to 0.77 in the library and examples. Of all along the axis that
# has most: 0.06 at least.
_STRONG, _WEAK = 3.0, 0.005
# Top speed over sqrt(g L), L the size: 1.7 at most in the library, a torpedo of the navy some 6 to 8.
_FAST = 4.0
_GRAM = GRAVITY / 1000.0  # weight of a gram [N]


class Slip(NamedTuple):
    """What is doubted, in a word or two, and the line about it."""

    what: str
    line: str


def implausible(vehicle: Vehicle, model: Model) -> Iterator[Slip]:
    """Thrust, speed and noise that hardly any vehicle of this size has, with the usual range and the usual cause."""
    thrust = list(_about_thrust(vehicle, model))
    yield from thrust or _about_top_speed(model)
    yield from _about_noise(vehicle)


def _about_thrust(vehicle: Vehicle, model: Model) -> Iterator[Slip]:
    if model.thrusters.count == 0:
        return
    weight = float(model.weight)
    force = np.max(np.abs(np.asarray(force_limits(model.thrusters))), axis=0)
    worst = int(np.argmax(force))
    if force[worst] > _STRONG * weight:
        others = int(np.sum(force > _STRONG * weight)) - 1
        name = f"thruster '{vehicle.thruster_names[worst]}'" + (f" and {others} more" if others else "")
        push = f"{'push up to' if others else 'pushes'} {_force(force[worst])}"
        yield Slip(
            f"thruster '{vehicle.thruster_names[worst]}'",
            f"{name} {push}, {force[worst] / weight:.0f} times the vehicle's weight, expected 0.03 to {_STRONG:g} times"
            f"{_implied(model)}: is the force in N? As grams it would be {_force(_GRAM * force[worst])}",
        )
    most = float(np.abs(reach(model)[:3]).max())
    if 0.0 < most < _WEAK * weight:
        yield Slip(
            "forces of thrusters",
            f"all thrusters together push {_force(most)}, {100 * most / weight:.2g} % of the vehicle's weight, "
            f"expected 3 % and more: is the force in N? As kgf it would be {_force(GRAVITY * most)}",
        )


def _force(newtons: float) -> str:
    return f"{plain(newtons, 3)} N"


def _implied(model: Model) -> str:
    """The speed ahead that the thrust implies, where anything drags."""
    _, top = _fastest(model)
    return f" (it implies {plain(top, 2)} m/s)" if top > 0.0 else ""


def _fastest(model: Model) -> tuple[int, float]:
    """The direction along which the vehicle is fastest, of those that have drag, and that speed [m/s]."""
    alone = np.abs(reach(model)[:3]).max(axis=1)
    speeds = [steady_speed(model, i, float(most)) if most > 0.0 else 0.0 for i, most in enumerate(alone)]
    known = np.where(np.isfinite(speeds), speeds, 0.0)
    return int(np.argmax(known)), float(known.max())


def _about_top_speed(model: Model) -> Iterator[Slip]:
    if model.thrusters.count == 0:
        return
    usual = _FAST * float(np.sqrt(GRAVITY * size(model)))
    axis, top = _fastest(model)
    if top > usual:
        yield Slip(
            "top speed",
            f"top speed in {AXES[axis]} comes to {plain(top, 3)} m/s, expected less than {plain(usual, 2)} for a "
            f"vehicle of some {plain(size(model), 2)} m: is a drag missing, or quadratic_damping not in N s2/m2, or a "
            "force not in N?",
        )


def _about_noise(vehicle: Vehicle) -> Iterator[Slip]:
    for one in instruments(vehicle):
        usual = PLAUSIBLE.get(one.kind)
        if usual is None:
            continue
        for key, most in (("noise", usual.noise), ("bias", usual.bias)):
            found = float(np.max(np.abs(one.figures[key])))
            if found > most:
                what = one.part if one.kind in one.part else f"{one.part}.{one.kind}"
                typical = f" ({usual.typical})" if key == "noise" else ""
                yield Slip(
                    f"{key} of {what}",
                    f"sensor {what}: found {key} {plain(found, 3)} {SENSORS[one.kind].units[0]}, expected up to "
                    f"{plain(most, 2)}{typical}: is it in {usual.slip}?",
                )
