"""From an autopilot's thruster commands to a Blueye's motion input, which is linear in force."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.physics.thrusters import Thrusters

Curve = Callable[[np.ndarray], np.ndarray]  # normalised commands -> shares of the largest force, both shape (3,)


def linear(u: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The curve of thrusters whose force is linear in the command: the command is the share."""
    return u


def force_shares(thrusters: Thrusters, which: Sequence[int]) -> Curve:
    """The curve of a drone's pseudo-thrusters surge, sway, heave: share of the largest force at a command.

    That is `thrusters.static_force` of sound thrusters over its value at u = +-1, in NumPy, for it runs at
    every command. The drone undoes its thrusters' own curve: a share m of its motion input is m times the force.

    Args:
        thrusters: Of the vehicle that the autopilot knows.
        which: Which of them are this drone's surge, sway and heave.
    """
    index = np.asarray(which)
    dead = np.asarray(thrusters.dead_band, dtype=float)[index]
    exponent = np.asarray(thrusters.exponent, dtype=float)[index]
    step = np.asarray(thrusters.quantisation, dtype=float)[index]
    grid = np.asarray(thrusters.table_command, dtype=float)
    tables = np.asarray(thrusters.table_force, dtype=float)[index]
    tabulated = np.flatnonzero(np.asarray(thrusters.tabulated)[index])

    def shares(u: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        u = np.asarray(u, dtype=float)
        u = np.clip(np.where(step > 0, np.round(u / np.where(step > 0, step, 1.0)) * step, u), -1.0, 1.0)
        share = np.sign(u) * np.maximum((np.abs(u) - dead) / (1.0 - dead), 0.0) ** exponent
        for i in tabulated:
            largest = tables[i, -1] if u[i] >= 0 else -tables[i, 0]
            share[i] = np.interp(u[i], grid, tables[i]) / largest if largest > 0 else 0.0
        return share

    return shares
