"""What ArduSub makes of its six axes: commands of the thrusters, and what our commands are as axes.

ArduSub adds up, for each motor, axis times factor, with factors of -1, 0 and 1 (AP_Motors6DOF, frame VECTORED_6DOF for
the BlueROV2 Heavy), and sends the sum as pulse width: it is linear in the command, not in the force. Where a motor
would have to do more than it can, its group (horizontal or vertical) is scaled down. Here the factors come from the
vehicle's own configuration T: the sign of the wrench that a thruster gives. For the BlueROV2 Heavy that is ArduSub's
table, with the sign of each motor turned to that of the thruster in our vehicle file.

Axes are surge, sway, heave, roll, pitch, yaw in FRD (heave down), each -1 to 1; `sticks` turns them to the wire.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import as_array
from rovtwin.vehicle.physics.thrusters import Thrusters, static_force

SMALL = 0.3  # of the largest entry of a row of T: a lever below counts as none, as ArduSub's factors have it
GRID = np.linspace(-1.0, 1.0, 401)  # commands at which the force curves are tabulated


@dataclass(frozen=True)
class Mixer:
    """A vehicle's mixing. Picklable.

    Attributes:
        configuration: T: wrench of unit forces, b at CO.
        factors: Command of each thruster per unit of each axis, of -1, 0 and 1.
        curves: Force of each thruster at the commands of GRID [N], shape (n, len(GRID)).
    """

    configuration: Float[np.ndarray, "6 n"]
    factors: Float[np.ndarray, "n 6"]
    curves: Float[np.ndarray, "n points"]

    def axes(self, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, "6"]:
        """Axes whose mixing comes closest (least squares) to commands u, within +-1.

        A vehicle of more than six thrusters cannot be given every u through six axes; all that a symmetric allocation
        asks for along one axis is met exactly. What does not fit is scaled down as a whole.
        """
        desired = np.linalg.pinv(self.factors) @ np.asarray(u, dtype=float)
        return desired / max(1.0, float(np.abs(desired).max()))

    def commands(self, axes: Float[np.ndarray, "6"]) -> Float[np.ndarray, " n"]:
        """Commands u that ArduSub gives the thrusters for axes, within +-1."""
        u = self.factors @ np.asarray(axes, dtype=float)
        upright = np.any(self.factors[:, 2:5] != 0.0, axis=1)
        for group in (upright, ~upright):
            if group.any():
                u[group] /= max(1.0, float(np.abs(u[group]).max()))
        return u

    def wrench(self, u: Float[np.ndarray, " n"]) -> Float[np.ndarray, "6"]:
        """tau = T f(u) at rest [N, N m], b at CO."""
        return self.configuration @ [
            np.interp(command, GRID, curve) for command, curve in zip(u, self.curves, strict=True)
        ]

    @property
    def largest(self) -> Float[np.ndarray, "6"]:
        """Force or moment along each axis with that axis alone at 1 [N, N m]; 1 where there is none."""
        full = np.array([self.wrench(self.commands(axis))[i] for i, axis in enumerate(np.eye(6))])
        return np.where(full > 1e-9, full, 1.0)

    def motion(self, axes: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        """Axes as shares of the largest force or moment (`PilotCommand.motion`)."""
        return np.clip(self.wrench(self.commands(axes)) / self.largest, -1.0, 1.0)

    def command_of_motion(self, motion: Float[np.ndarray, "6"]) -> Float[np.ndarray, " n"]:
        """Commands of the thrusters whose wrench is `motion` times `largest`: inverts `motion`."""
        forces = np.linalg.pinv(self.configuration) @ (np.asarray(motion, dtype=float) * self.largest)
        u = [np.interp(force, curve, GRID) for force, curve in zip(forces, self.curves, strict=True)]
        return np.clip(u, -1.0, 1.0)


def mixer(thrusters: Thrusters) -> Mixer:
    """The mixing of a vehicle's thrusters."""
    configuration = np.asarray(thrusters.configuration, dtype=float)
    size = np.abs(configuration).max(axis=1, keepdims=True)
    counts = np.abs(configuration) > SMALL * np.where(size > 1e-9, size, np.inf)
    factors = (np.sign(configuration) * counts).T
    n = configuration.shape[1]
    curves = np.array([np.asarray(static_force(thrusters, as_array(np.full(n, u)))) for u in GRID]).T
    return Mixer(configuration, factors, curves)


def shares(thrusters: Thrusters) -> Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, "6"]]:
    """What `MavlinkLink(axes=...)` takes for a vehicle: commands u to axes."""
    return mixer(thrusters).axes


def clean_axes(axes: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    """Axes within +-1; what is no number is 0. Shape (6,)."""
    return np.clip(np.nan_to_num(np.asarray(axes, dtype=float), nan=0.0, posinf=0.0, neginf=0.0), -1.0, 1.0)
