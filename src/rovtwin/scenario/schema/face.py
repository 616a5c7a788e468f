"""A scenario as tables, labelled arrays, a drawing and a file, as every result has them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.extras import require
from rovtwin.core.log.files import atomic
from rovtwin.core.notebook import Result, axes_of, labelled
from rovtwin.core.notebook.face import Row
from rovtwin.core.user_files.yamlfile import dump_yaml

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

COLUMNS = {"north": "m", "east": "m", "down": "m", "speed": "m/s", "acceptance": "m", "hold_time": "s"}


class ScenarioFace(Result):
    """What `Scenario` has of the face of all results."""

    __slots__ = ()

    def figures_table(self) -> list[Row]:
        """What is flown, with what, for how long.

        Example:
            >>> rovtwin.load_scenario("square").figures_table()[1]
            ('seed', 1, '')
        """
        own: Any = self
        vehicle = own.vehicle if isinstance(own.vehicle, str) else str(own.vehicle.get("name", "described here"))
        todo: list[Row] = [("way-points", len(own.waypoints), "")]
        if own.test is not None:
            todo = [("manoeuvres", len(own.test.manoeuvres), "")]
        return [
            ("vehicle", vehicle, ""),
            ("seed", own.seed, ""),
            ("longest run", float(own.duration), "s"),
            ("autopilot", own.autopilot.type, ""),
            ("start, north / east / down", list(own.start.position), "m"),
            *todo,
            ("faults", len(own.faults), ""),
        ]

    def remarks(self) -> list[str]:
        """Its description.

        Example:
            >>> len(rovtwin.load_scenario("square").remarks())
            1
        """
        own: Any = self
        return [own.description] if own.description else []

    def _waypoints(self) -> Float[np.ndarray, "n 6"]:
        """Columns as of COLUMNS."""
        own: Any = self
        rows = [[*w.placed(own.origin), w.speed, w.acceptance, w.hold_time] for w in own.waypoints]
        return np.reshape(np.array(rows, dtype=float), (-1, len(COLUMNS)))

    def to_xarray(self) -> xarray.Dataset:
        """The way-points by `waypoint`: place in n, speed, acceptance, time to stay; none of a test.

        Raises:
            ConfigError: xarray is missing.

        Example:
            >>> rovtwin.load_scenario("square").to_xarray().down.attrs["units"]
            'm'
        """
        own: Any = self
        points = self._waypoints()
        variables: dict[str, Any] = {
            name: (("waypoint",), column, unit) for (name, unit), column in zip(COLUMNS.items(), points.T, strict=True)
        }
        return labelled(
            "Scenario.to_xarray", variables, {"waypoint": np.arange(len(points))}, {"scenario": own.name, "frame": "n"}
        )

    def to_pandas(self) -> pandas.DataFrame:
        """The way-points, a row each.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> rovtwin.load_scenario("square").to_pandas().loc[0, "north"]
            np.float64(3.0)
        """
        require("pandas", "notebook", "Scenario.to_pandas")
        import pandas

        points = self._waypoints()
        return pandas.DataFrame(points, pandas.RangeIndex(len(points), name="waypoint"), list(COLUMNS))

    def plot(self) -> Axes:
        """Start and way-points from above.

        Example:
            >>> rovtwin.load_scenario("square").plot().get_ylabel()
            'North [m]'
        """
        own: Any = self
        axes, points = axes_of("East [m]", "North [m]", equal=True), self._waypoints()
        way = np.vstack([[own.start.position[:2]], points[:, :2]])
        axes.plot(way[:, 1], way[:, 0], color="#D55E00", linestyle=(0, (4, 2)))
        axes.plot(way[1:, 1], way[1:, 0], "o", color="#D55E00", label="way-point")
        axes.plot(way[:1, 1], way[:1, 0], "s", color="#1a1a1a", label="start")
        axes.legend(frameon=False, fontsize=8)
        return axes

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Written as one file, mission and autopilot in it, which `load_scenario` reads; the vehicle as it is named.

        What was left out stays so, since the vehicle or the mission has its own of it.

        Raises:
            LogError: The file cannot be written, or it exists.

        Example:
            >>> rovtwin.load_scenario("square").save("mine.yaml", overwrite=True).name
            'mine.yaml'
        """
        own: Any = self
        path = Path(path)
        text = dump_yaml({"name": own.name} | own.model_dump(mode="json", exclude_unset=True))
        with atomic(path, overwrite) as temporary:
            temporary.write_text(text, encoding="utf-8")
        return path
