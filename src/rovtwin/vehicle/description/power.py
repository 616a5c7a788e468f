"""Batteries of a vehicle file, and what its thrusters draw from them.

A T200 at 16 V in Blue Robotics' bollard test (2019) draws P = c |F|^1.5 with c = 1.00 W/N^1.5 ahead (1.1 % rms of full
power) and 1.45 astern (2.0 %); exponents fitted freely are 1.56 and 1.61, momentum theory says 1.5
(tests/vehicle/test_power.py). It stands for thrusters of which the file says nothing.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.description.schema import Body, Thruster
from rovtwin.vehicle.description.thruster_arrays import thrust_limits
from rovtwin.vehicle.description.totals.assembly import Mounted, bodies

T200_POWER = (1.00, 1.45)  # ahead, astern [W/N^1.5]


@dataclass(frozen=True)
class PowerSource:
    """A battery and what hangs on it.

    Attributes:
        name: Of the part it sits in, `port`; `vehicle` where it is the whole's.
        capacity_wh: With those wired beside it [Wh].
        hotel_load: Of all but the thrusters, with the `power` of the parts that hang on it [W].
        feeds: Numbers of its thrusters, in the order of the commands.
    """

    name: str
    capacity_wh: float
    hotel_load: float
    feeds: tuple[int, ...]


def power_sources(body: Body, thrusters: Sequence[Mounted]) -> list[PowerSource]:
    """The batteries of a vehicle, and what each of them feeds.

    A thruster hangs on the battery of the nearest part around it. So do the `power` of a part and a battery that is
    wired in parallel. With no battery around them, such as thrusters of a frame whose battery is a tube bolted to it,
    or a device on two ROVs, they hang on the largest one (the first of equals).

    Args:
        body: The vehicle, all parts in place.
        thrusters: Of its assembly, in the order of the commands.
    """
    tree = list(bodies(body, ""))
    batteries = {path: part.battery for path, part in tree if part.battery is not None}
    main = {path: battery for path, battery in batteries.items() if not battery.parallel} or batteries
    capacity = {path: battery.capacity_wh for path, battery in main.items()}
    hotel = {path: battery.hotel_load for path, battery in main.items()}

    def owner(path: str) -> str:
        around = _around(path, main)
        return max(main, key=lambda one: main[one].capacity_wh) if around is None else around

    for path, battery in batteries.items():
        if path not in main:
            capacity[owner(path)] += battery.capacity_wh
            hotel[owner(path)] += battery.hotel_load
    for path, part in tree:
        if part.power and main:
            hotel[owner(path)] += part.power
    owners = [owner("".join(f".{part}" for part in mounted.path)) for mounted in thrusters] if main else []
    names = _names(body, list(main))
    return [
        PowerSource(
            names[path],
            capacity[path],
            hotel[path],
            tuple(i for i, of in enumerate(owners) if of == path),
        )
        for path in main
    ]


def _names(body: Body, paths: Sequence[str]) -> dict[str, str]:
    """Of parts, by path: as those of their thrusters (`assembly`), whole where two would be the same."""
    short = {path: _short(body, path.split(".")[1:]) for path in paths}
    return {
        path: (name if list(short.values()).count(name) == 1 else path.removeprefix(".")) or "vehicle"
        for path, name in short.items()
    }


def _short(body: Body, path: Sequence[str]) -> str:
    """A path without the names of parts that keep theirs."""
    if not path:
        return ""
    part = next(part for part in body.parts if part.name == path[0])
    rest = _short(part, path[1:])
    return rest if part.keeps_names else ".".join(filter(None, (part.name, rest)))


def _around(path: str, batteries: Collection[str]) -> str | None:
    """Which of the parts with a battery is the nearest around a part or thruster; None where none is."""
    return max((owner for owner in batteries if f"{path}.".startswith(f"{owner}.")), key=len, default=None)


def specific_power(thrusters: Sequence[Mounted], supply_voltage: float | None = None) -> Float[np.ndarray, "n 2"]:
    """c of each thruster, ahead and astern [W/N^1.5], from its power at full force or as a T200's.

    Args:
        thrusters: Of an assembly.
        supply_voltage: At which thrust tables are read [V]; None: each at that of its part.
    """
    return np.array([_coefficients(mounted, supply_voltage) for mounted in thrusters]).reshape(-1, 2)


def _coefficients(mounted: Mounted, supply_voltage: float | None) -> tuple[float, float]:
    assert isinstance(mounted.item, Thruster)
    if mounted.item.power is None:
        return T200_POWER
    most = max(thrust_limits(mounted, supply_voltage))
    return (mounted.item.power / most**1.5,) * 2 if most > 0 else (0.0, 0.0)
