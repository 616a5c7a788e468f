"""Roll-outs of the equations of motion as labelled arrays: no sensors, no autopilot, endless water."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from rovtwin.core.block import Start
from rovtwin.core.extras import require
from rovtwin.core.flow import Command, Environment
from rovtwin.core.notebook import axes_of, labelled
from rovtwin.core.notebook.face import Row
from rovtwin.core.numerics import as_array, jax
from rovtwin.core.stored import Stored
from rovtwin.vehicle.physics.dynamics import State, rollout
from rovtwin.vehicle.physics.model import Model

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

AXES = {"position": ("north", "east", "down"), "attitude": ("w", "x", "y", "z"), "nu": ("u", "v", "w", "p", "q", "r")}
STATES = {  # of a trajectory: dimension beside time, unit, frame, what it is
    "position": ("direction", "m", "n", "position of CO"),
    "attitude": ("quaternion", "1", "n", "quaternion R_nb"),
    "nu": ("axis", "m/s, rad/s", "b", "velocity at CO"),
    "thrust": ("thruster", "N", "b", "thrust of each"),
    "command": ("thruster", "1", "", "command of the step that begins"),
}
_run = jax.jit(rollout, static_argnums=4)


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Stored):
    """How a vehicle moves under given commands, as `simulate` gives it.

    Attributes:
        vehicle: Its name.
        dt: Time between two states [s]; the first is at 0.
        thrusters: Their names.
        states: By name (`position`, `attitude`, `nu`, `thrust`, `command`), shape (time, n); each is an attribute
            too, as a DataArray.

    Example:
        >>> path = rovtwin.simulate("double_blueye", {"port.surge": [0.5] * 100, "starboard.surge": [0.5] * 100})
        >>> path
        <Trajectory of double_blueye: 100 steps of 0.01 s, 0.04 m>
        >>> path.nu.sel(axis="u").attrs["units"]
        'm/s, rad/s'
    """

    vehicle: str
    dt: float
    thrusters: tuple[str, ...]
    states: dict[str, np.ndarray]

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        return f"<Trajectory of {self.vehicle}: {len(self.t) - 1} steps of {self.dt:g} s, {self._length:.2f} m>"

    @property
    def t(self) -> np.ndarray:
        """Times [s], shape (time,)."""
        return self.dt * np.arange(len(self.states["position"]))

    @property
    def position(self) -> "xarray.DataArray":
        """CO in n [m], by `time` and `direction`."""
        return self.to_xarray()["position"]

    @property
    def attitude(self) -> "xarray.DataArray":
        """Quaternion R_nb, scalar first, by `time` and `quaternion`."""
        return self.to_xarray()["attitude"]

    @property
    def nu(self) -> "xarray.DataArray":
        """Velocity in b at CO [m/s, rad/s], by `time` and `axis`."""
        return self.to_xarray()["nu"]

    @property
    def thrust(self) -> "xarray.DataArray":
        """Thrust [N], by `time` and `thruster`."""
        return self.to_xarray()["thrust"]

    @property
    def command(self) -> "xarray.DataArray":
        """Command of the step that begins, by `time` and `thruster`; NaN at the end."""
        return self.to_xarray()["command"]

    @property
    def _length(self) -> float:
        return float(np.linalg.norm(np.diff(self.states["position"], axis=0), axis=1).sum())

    def figures_table(self) -> list[Row]:
        """Duration, way and largest values.

        Example:
            >>> path.figures_table()[0]
            ('duration', 1.0, 's')
        """
        speed = np.linalg.norm(self.states["nu"][:, :3], axis=1)
        return [
            ("duration", float(self.t[-1]), "s"),
            ("way", self._length, "m"),
            ("end, north / east / down", self.states["position"][-1].tolist(), "m"),
            ("largest speed", float(speed.max()), "m/s"),
            ("largest turning rate", float(np.abs(self.states["nu"][:, 3:]).max()), "rad/s"),
            ("largest thrust", float(np.abs(self.states["thrust"]).max()), "N"),
        ]

    def to_xarray(self) -> "xarray.Dataset":
        """By `time` [s]: `position`, `attitude`, `nu`, `thrust`, `command`, each with unit, frame and `long_name`.

        Example:
            >>> dict(path.to_xarray().position.sizes)
            {'time': 101, 'direction': 3}
        """
        variables = {name: (("time", STATES[name][0]), x, STATES[name][1]) for name, x in self.states.items()}
        places = {"direction": AXES["position"], "quaternion": AXES["attitude"], "axis": AXES["nu"]}
        coordinates = {name: list(labels) for name, labels in places.items()} | {"thruster": list(self.thrusters)}
        found = labelled(
            "Trajectory.to_xarray", variables, {"time": self.t} | coordinates, {"vehicle": self.vehicle, "dt": self.dt}
        )
        for name, (_, _, frame, what) in STATES.items():
            found[name].attrs |= {"long_name": what} | ({"frame": frame} if frame else {})
        return found

    def to_pandas(self) -> "pandas.DataFrame":
        """A column for each number, `nu.u`, indexed by time [s].

        Example:
            >>> float(path.to_pandas()["nu.u"].iloc[0])
            0.0
        """
        require("pandas", "notebook", "Trajectory.to_pandas")
        import pandas

        labels = {"direction": AXES["position"], "quaternion": AXES["attitude"], "axis": AXES["nu"]}
        labels |= {"thruster": self.thrusters}
        names = [f"{name}.{one}" for name in self.states for one in labels[STATES[name][0]]]
        return pandas.DataFrame(np.hstack(list(self.states.values())), pandas.Index(self.t, name="time"), names)

    def plot(self) -> "Axes":
        """The path from above.

        Example:
            >>> path.plot().get_ylabel()
            'North [m]'
        """
        axes, place = axes_of("East [m]", "North [m]", equal=True), self.states["position"]
        axes.plot(place[:, 1], place[:, 0], color="#0072B2")
        axes.plot(place[:1, 1], place[:1, 0], "o", color="#1a1a1a", label="start")
        axes.legend(frameon=False)
        return axes


def roll_out(
    model: Model,
    u: Float[np.ndarray, "steps n"],
    dt: float,
    position: ArrayLike,
    heading: float,
    current: ArrayLike,
    thrusters: Sequence[str],
    vehicle: str,
) -> Trajectory:
    """States from rest under commands.

    Args:
        model: The vehicle.
        u: Commands.
        dt: Step [s].
        position: CO at the start, n [m].
        heading: At the start [rad].
        current: Velocity of the water, n [m/s].
        thrusters: Their names.
        vehicle: Its name.
    """
    start = State.at(model, Start.at(position, heading))
    water = Environment.calm(velocity=as_array(current))
    path = _run(model, start, jax.vmap(Command)(as_array(u)), water, dt)
    states = {
        name: np.concatenate([np.asarray(getattr(start, name))[None], np.asarray(getattr(path, name))])
        for name in ("position", "attitude", "nu", "thrust")
    }
    states["command"] = np.vstack([u, np.full(u.shape[1], np.nan)])
    return Trajectory(vehicle, dt, tuple(thrusters), states)
