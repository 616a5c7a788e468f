"""Whether a planned test has the room that it needs: refusals and warnings with the numbers."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.errors import ConfigError
from rovtwin.planning.candidates import in_words
from rovtwin.planning.rehearsal import Rehearsed
from rovtwin.planning.tank import Tank
from rovtwin.runs.compose.experiment_scales import ExperimentScales
from rovtwin.scenario.schema.experiment import AXES
from rovtwin.vehicle import Vehicle

MARGIN = 0.5  # between hull and wall on the predicted path of a candidate, in lengths of the vehicle
SLOW = 0.5  # of the top speed: a test that stays slower hardly tells linear from quadratic drag
NOTHING = 0.05  # of the top speed: what stays slower is not excited at all


def require_possible(vehicle: Vehicle, scales: ExperimentScales, tank: Tank, some: bool) -> None:
    """ConfigError where no manoeuvre exists for a vehicle, or where it cannot even turn round in the tank."""
    if not some:
        raise ConfigError(
            f"{vehicle.name}: found no thruster that pushes and nothing that rights it: no test can move it. "
            "Expected thrusters, or its centre of gravity below that of buoyancy"
        )
    corners = np.asarray(vehicle.model().hull.corners)
    away, margin = np.abs(corners).max(axis=0), MARGIN * scales.length
    round_about = 2.0 * (float(np.hypot(*corners[:, :2].T).max()) + margin)
    own = (round_about, round_about, 2.0 * (float(away[2]) + margin))
    if any(size < need for size, need in zip(tank.sizes, own, strict=True)):
        least = Tank(
            *(float(np.ceil(10.0 * max(size, need)) / 10.0) for size, need in zip(tank.sizes, own, strict=True))
        )
        hull = " x ".join(f"{2.0 * size:.2g}" for size in away)
        raise ConfigError(
            f"--tank: found {tank}, but {vehicle.name} is {hull} m: it only turns on the spot, {margin:.2g} m clear of "
            f"the walls, in a tank of {least}, and needs room to pull besides"
        )


def too_small(
    vehicle: Vehicle, tank: Tank, margin: float, manoeuvres: list[dict[str, Any]], flown: list[Rehearsed]
) -> str:
    """No manoeuvre fits: how large a tank the least demanding one needs, and one on every axis."""
    sizes = {i: tank.needed(vehicle, one, margin) for i, one in enumerate(flown[: len(manoeuvres)]) if not one.aborted}
    if not sizes:
        return (
            f"{vehicle.name}: the twin leaves its limits (attitude) in every one of {len(manoeuvres)} manoeuvres: it "
            "is not stable enough to be tested; `rovtwin vehicle check` says why"
        )
    least = min(sizes, key=lambda i: sum(np.log(sizes[i].sizes)))
    return (
        f"--tank: every manoeuvre of {vehicle.name} comes nearer than {margin:.2g} m to a wall, the surface or the "
        f"floor of {tank}: it needs a larger tank, {sizes[least]} for the least demanding one "
        f"({in_words(manoeuvres[least])})"
    )


def axes_left_out(scales: ExperimentScales) -> list[str]:
    """What the vehicle does not let any test do, in words."""
    lacking = [axis for axis, can in zip(AXES, scales.able, strict=True) if not can]
    notes = [f"{', '.join(lacking)} left out: no thruster pushes there"] if lacking else []
    return notes if scales.swing else [*notes, "releases left out: nothing rights the vehicle"]


def excitation(
    vehicle: Vehicle,
    tank: Tank,
    top: Float[np.ndarray, " axes"],
    able: Bool[np.ndarray, "6"],
    pulls: Sequence[tuple[str | None, Rehearsed]],
    reached: Float[np.ndarray, "6"],
) -> list[str]:
    """Directions in which a plan stays well below the top speed, and the tank in which a pull would reach it.

    Args:
        vehicle: That is tested.
        tank: It has.
        top: Its top speeds [m/s].
        able: Which axes thrusters push.
        pulls: The axis of each candidate, None for several, and how the twin flies it in open water.
        reached: Largest speeds of the plan [m/s].

    Raises:
        ConfigError: A direction is not excited at all: what the plan reaches on each axis, what it takes, the tank.
    """
    margin = MARGIN * float(np.cbrt(vehicle.assembly.volume))
    lines, refused = [], False
    for i in np.flatnonzero(able[:3]):
        if reached[i] >= SLOW * top[i]:
            continue
        fast = [
            tank.needed(vehicle, one, margin)
            for axis, one in pulls
            if axis == AXES[i] and not one.aborted and np.abs(one.nu[:, i]).max() >= SLOW * top[i]
        ]
        least = min(fast, key=lambda t: sum(np.log(t.sizes))) if fast else None
        if least is None:
            room = "a larger tank or more time"
        elif all(need <= size for need, size in zip(least.sizes, tank.sizes, strict=True)):
            room = "more time"  # this tank has room for the pull, and other manoeuvres told more in the time given
        else:
            room = f"a tank of {least}"
        lines.append(
            f"{AXES[i]} reaches {reached[i]:.2g} of {top[i]:.2g} m/s, and {SLOW * top[i]:.2g} m/s are needed to tell "
            f"linear from quadratic drag: {room} would do it"
        )
        refused |= bool(reached[i] < NOTHING * top[i])
    if refused:
        raise ConfigError(f"--tank: {tank} is too small to identify {vehicle.name}: {'; '.join(lines)}")
    return lines
