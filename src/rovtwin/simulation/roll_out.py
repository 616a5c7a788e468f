"""Roll-outs of the equations of motion as labelled arrays: no sensors, no autopilot, endless water."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import as_array, jax
from rovtwin.vehicle.physics.dynamics import State, rollout
from rovtwin.vehicle.physics.model import Model

if TYPE_CHECKING:
    import xarray

AXES = {"position": ("north", "east", "down"), "attitude": ("w", "x", "y", "z"), "nu": ("u", "v", "w", "p", "q", "r")}
_run = jax.jit(rollout, static_argnums=4)


def roll_out(
    model: Model,
    u: Float[np.ndarray, "steps n"],
    dt: float,
    position: ArrayLike,
    heading: float,
    current: ArrayLike,
    thrusters: Sequence[str],
) -> "xarray.Dataset":
    """States from rest under commands.

    Args:
        model: The vehicle.
        u: Commands.
        dt: Step [s].
        position: CO at the start, n [m].
        heading: At the start [rad].
        current: Velocity of the water, n [m/s].
        thrusters: Their names.

    Returns:
        See `api.simulate`.
    """
    import xarray

    start = State.at(model, Start.at(position, heading))
    water = Environment.calm(velocity=as_array(current))
    path = _run(model, start, Command(as_array(u)), water, dt)
    states = {
        name: np.concatenate([np.asarray(getattr(start, name))[None], np.asarray(getattr(path, name))])
        for name in ("position", "attitude", "nu", "thrust")
    }
    variables = {
        "position": (("time", "direction"), states["position"], {"units": "m", "frame": "n"}),
        "attitude": (("time", "quaternion"), states["attitude"], {"units": "1", "long_name": "quaternion R_nb"}),
        "nu": (("time", "axis"), states["nu"], {"units": "m/s, rad/s", "frame": "b", "long_name": "velocity at CO"}),
        "thrust": (("time", "thruster"), states["thrust"], {"units": "N"}),
        "command": (("time", "thruster"), np.vstack([u, np.full(u.shape[1], np.nan)]), {"units": "1"}),
    }
    coordinates = {
        "time": ("time", dt * np.arange(len(u) + 1), {"units": "s"}),
        "direction": list(AXES["position"]),
        "quaternion": list(AXES["attitude"]),
        "axis": list(AXES["nu"]),
        "thruster": list(thrusters),
    }
    return xarray.Dataset(variables, coordinates)
