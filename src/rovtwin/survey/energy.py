"""What a survey takes out of a vehicle's batteries: thrust against drag in still water, weight, and the hotel load.

Thrusters share a wrench by least squares, and draw P = c |F|^1.5 for a force F (`vehicle.description.power`). Counted
are drag in surge while going, the force that keeps a vehicle which is not neutral at its depth, and the load of
everything else. Not counted: current, waves, tether, the autopilot's corrections and turns, payload and lamps that the
vehicle's file does not name, and cold.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.survey.pace import drag_ahead
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.physics.model import Model

JOULES = 3600.0  # in a watt-hour


@dataclass(frozen=True)
class Budget:
    """Energy of a survey, battery by battery.

    Attributes:
        names: Of the batteries; none where the vehicle's file has none.
        capacity_wh: Of each [Wh].
        used_wh: By the whole survey [Wh].
        propulsion_w: Of all thrusters while it goes [W].
        hotel_w: Of everything else [W].
    """

    names: list[str]
    capacity_wh: Float[np.ndarray, " b"]
    used_wh: Float[np.ndarray, " b"]
    propulsion_w: float
    hotel_w: float

    @property
    def share(self) -> float | None:
        """Of the battery that is emptied most; None without batteries."""
        return float((self.used_wh / self.capacity_wh).max()) if self.names else None


def budget(vehicle: Vehicle, model: Model, speed: float, going: float, waiting: float) -> Budget:
    """Energy of a survey.

    Args:
        vehicle: Its batteries and what its thrusters draw.
        model: Of the same vehicle.
        speed: Along the legs [m/s].
        going: Time on legs [s].
        waiting: Time in which it turns and settles [s].
    """
    net = float(model.weight) - float(model.buoyancy)
    on_leg = thruster_powers(vehicle, model, np.array([drag_ahead(model, speed), 0, -net, 0, 0, 0]))
    at_rest = thruster_powers(vehicle, model, np.array([0, 0, -net, 0, 0, 0]))
    sources = vehicle.power_sources
    used = [
        source.hotel_load * (going + waiting)
        + on_leg[list(source.feeds)].sum() * going
        + at_rest[list(source.feeds)].sum() * waiting
        for source in sources
    ]
    return Budget(
        [source.name for source in sources],
        np.array([source.capacity_wh for source in sources]),
        np.array(used) / JOULES,
        float(on_leg.sum()),
        float(sum(source.hotel_load for source in sources)),
    )


def thruster_powers(vehicle: Vehicle, model: Model, wrench: Float[np.ndarray, "6"]) -> Float[np.ndarray, " n"]:
    """Electrical power of each thruster [W], when together they make a wrench, b at CO."""
    force = np.linalg.pinv(np.asarray(model.thrusters.configuration)) @ wrench
    ahead, astern = np.reshape(vehicle.specific_power(), (-1, 2)).T
    return np.where(force >= 0, ahead, astern) * np.abs(force) ** 1.5
