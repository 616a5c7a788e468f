"""A test that is laid out, as one object: what to fly, and what it should tell."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.extras import require
from rovtwin.core.notebook import axes_of, labelled
from rovtwin.core.notebook.face import Row
from rovtwin.core.stored import Stored
from rovtwin.identification.experiment.choice import Expected, identified
from rovtwin.planning.rehearsal import Rehearsed
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

_PLACES = {"direction": ["north", "east", "down"], "quaternion": ["w", "x", "y", "z"], "axis": list("uvwpqr")}


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Stored):
    """A test that is laid out.

    Attributes:
        scenario: To fly.
        expected: What it should tell.
        thesis: Standard deviations after the thesis's steady steps, in open water, in the same time.
        ratio: Geometric mean of the variances over the thesis's, of what at least one of both identifies.
        flown: As the twin flies it: times, path, commands.
        room: Between hull and walls on that path [m].
        fence: Where a fence may end it: how far CO is from the tank's middle to north and east, and how deep [m], shape
            (3,). The path is inside, and so are those of vehicles as they may truly be that keep to their limits.
        candidates: How many there were, and how many fitted the tank and the attitude limit.
        manoeuvres: Chosen, in words, in order.
        notes: What it counts on beside the vehicle, and what vehicle or tank do not let the test do, in words.
        model: Of the vehicle as it is assumed to be.

    Example:
        >>> rovtwin.plan_experiment("double_blueye", 3.0, "8x4x2")  # doctest: +SKIP
        <Plan for double_blueye: 9 manoeuvres, 2.9 min, tells 31 of 44 parameters>
    """

    scenario: Scenario
    expected: Expected
    thesis: Float[np.ndarray, " n"]
    ratio: float
    flown: Rehearsed
    room: float
    fence: Float[np.ndarray, "3"]
    candidates: tuple[int, int]
    manoeuvres: list[str]
    notes: list[str]
    model: Model

    @property
    def known(self) -> Bool[np.ndarray, " n"]:
        """Which parameters the plan or the steady steps identify."""
        return identified(self.expected.plan, self.thesis, self.expected.prior)

    @property
    def _vehicle(self) -> str:
        named = self.scenario.vehicle
        return named if isinstance(named, str) else str(named.get("name", "a vehicle"))

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        hopes = f"tells {int(self.expected.learnt.sum())} of {len(self.expected.names)} parameters"
        length = f"{len(self.manoeuvres)} manoeuvres, {self.expected.minutes[-1]:.1f} min"
        return f"<Plan for {self._vehicle}: {length}, {hopes}>"

    def figures_table(self) -> list[Row]:
        """Its length, room and what it should tell.

        Example:
            >>> rovtwin.plan_experiment("double_blueye", 3.0, "8x4x2").figures_table()[0]  # doctest: +SKIP
            ('length', 2.9, 'min')
        """
        return [
            ("length", float(self.expected.minutes[-1]), "min"),
            ("manoeuvres", len(self.manoeuvres), ""),
            ("candidates, and those that fitted", list(self.candidates), ""),
            ("room to the walls", float(self.room), "m"),
            ("parameters", len(self.expected.names), ""),
            ("parameters that it tells", int(self.expected.learnt.sum()), ""),
            ("variances over those of steady steps", float(self.ratio), ""),
        ]

    def remarks(self) -> list[str]:
        """What it counts on beside the vehicle, and what vehicle or tank do not let the test do.

        Example:
            >>> rovtwin.plan_experiment("double_blueye", 3.0, "8x4x2").remarks()  # doctest: +SKIP
            ['counted on: motion capture that gives the position of CO to 0.03 m, ..']
        """
        return list(self.notes)

    def to_pandas(self) -> "pandas.DataFrame":
        """A row for each parameter: value, whether sd are shares of it, sd before, after, after steady steps, learnt.

        Example:
            >>> rovtwin.plan_experiment("double_blueye", 3.0, "8x4x2").to_pandas()["sd"]  # doctest: +SKIP
        """
        require("pandas", "notebook", "Plan.to_pandas")
        import pandas

        hopes = self.expected
        columns = {"value": hopes.values, "relative": hopes.relative, "prior_sd": hopes.prior, "sd": hopes.plan}
        columns |= {"steady_sd": self.thesis, "learnt": hopes.learnt}
        return pandas.DataFrame(columns, pandas.Index(hopes.names, name="parameter"))

    def to_xarray(self) -> "xarray.Dataset":
        """The path that is expected by `time` [s], and standard deviations by `parameter` and after each `manoeuvre`.

        Standard deviations are shares of the value where `relative` is true, else in the parameter's unit.

        Example:
            >>> rovtwin.plan_experiment("double_blueye", 3.0, "8x4x2").to_xarray().position  # doctest: +SKIP
        """
        hopes, flown, sd = self.expected, self.flown, "share of the value, or the parameter's unit"
        variables: dict[str, Any] = {
            "position": (("time", "direction"), flown.position, "m"),
            "attitude": (("time", "quaternion"), flown.attitude, "1"),
            "nu": (("time", "axis"), flown.nu, "m/s, rad/s"),
            "command": (("time", "thruster"), flown.command, "1"),
            "value": (("parameter",), hopes.values, "the parameter's unit"),
            "relative": (("parameter",), hopes.relative, "1"),
            "prior_sd": (("parameter",), hopes.prior, sd),
            "sd": (("parameter",), hopes.plan, sd),
            "steady_sd": (("parameter",), self.thesis, sd),
            "sd_after": (("manoeuvre", "parameter"), hopes.path, sd),
            "minutes": (("manoeuvre",), hopes.minutes, "min"),
        }
        places = {"time": flown.t, "parameter": list(hopes.names), "manoeuvre": np.arange(len(hopes.minutes))}
        places |= _PLACES | {"thruster": np.arange(flown.command.shape[1])}
        return labelled("Plan.to_xarray", variables, places, {"vehicle": self._vehicle})

    def plot(self) -> "Axes":
        """The path that is expected, from above; `rovtwin plan-tests` draws the whole picture.

        Example:
            >>> rovtwin.plan_experiment("double_blueye", 3.0, "8x4x2").plot()  # doctest: +SKIP
        """
        axes, place = axes_of("East [m]", "North [m]", equal=True), self.flown.position
        axes.plot(place[:, 1], place[:, 0], color="#0072B2", linewidth=0.9)
        walls = self.scenario.world.model_dump().get("tank")
        if walls:
            (south, north), (west, east) = walls["north"], walls["east"]
            axes.plot([west, east, east, west, west], [south, south, north, north, south], color="#1a1a1a")
        axes.set_title(f"{self._vehicle}, {self.expected.minutes[-1]:.1f} min", fontsize=8)
        return axes
