"""How weight and buoyancy balance in still water: net buoyancy, trim, BG, righting stiffness. Plain NumPy."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.physics.dynamics import restoring_lever

if TYPE_CHECKING:
    from rovtwin.vehicle.description.totals.assembly import Assembly


@dataclass(frozen=True)
class Floating:
    """Weight against buoyancy, thrusters off.

    Attributes:
        net_buoyancy: B - W, positive floats [N].
        metacentric_height: BG, how far CB is above CG along z [m].
        stiffness: Righting moment per angle about level, roll and pitch [N m/rad].
        trim: Roll and pitch at which no moment about CO is left [rad]; NaN where there is none anyway.
    """

    net_buoyancy: float
    metacentric_height: float
    stiffness: Float[np.ndarray, "2"]
    trim: Float[np.ndarray, "2"]


def floating(weight: float, buoyancy: float, r_g: Float[np.ndarray, "3"], r_b: Float[np.ndarray, "3"]) -> Floating:
    """Of weight W and buoyancy B [N] at r_g and r_b [m], seen from CO."""
    lever = restoring_lever(weight, buoyancy, r_g, r_b)
    size = float(np.linalg.norm(lever))
    # At rest the lever points down, as a plumb line does.
    down = lever / size if size > 1e-9 * weight else np.full(3, np.nan)
    trim = np.array([np.arctan2(down[1], down[2]), -np.arcsin(down[0])]) + 0.0  # no -0.0
    return Floating(buoyancy - weight, float(r_g[2] - r_b[2]), np.full(2, lever[2]), trim)


def floating_of(total: "Assembly") -> Floating:
    """Of the totals of a vehicle, in the water they are given for."""
    weight, buoyancy = total.solid.mass * GRAVITY, total.density * GRAVITY * total.volume
    return floating(weight, buoyancy, total.solid.center_of_gravity, total.center_of_buoyancy)
