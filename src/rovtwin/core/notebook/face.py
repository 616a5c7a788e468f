"""What every public result can do, whatever it is of: tables, arrays with labels, a figure, a file, HTML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rovtwin.core.extras import require
from rovtwin.core.notebook.html import html_table

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

Row = tuple[str, Any, str]
"""Label, value (a number, text, or several numbers) and unit ("" for none)."""


class Result:
    """The face that all results have in common; a kind of result gives `figures_table` and what has no default here.

    Example:
        >>> result = rovtwin.load_vehicle("double_blueye")
        >>> result.summary().loc["mass", "unit"]
        'kg'
    """

    __slots__ = ()

    def figures_table(self) -> Iterable[Row]:
        """The figures that describe it: label, value, unit of each.

        Example:
            >>> next(iter(rovtwin.load_scenario("square").figures_table()))
            ('vehicle', 'double_blueye', '')
        """
        raise NotImplementedError(f"{type(self).__name__}.figures_table")

    def remarks(self) -> Sequence[str]:
        """Lines for people that go below the figures.

        Example:
            >>> rovtwin.load_vehicle("double_blueye").remarks()
            []
        """
        return []

    def summary(self) -> pandas.DataFrame:
        """Its figures, a row each: `value` and `unit` by `figure`.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> list(rovtwin.load_scenario("square").summary().columns)
            ['value', 'unit']
        """
        require("pandas", "notebook", f"{type(self).__name__}.summary")
        import pandas

        labels, values, units = zip(*[(one[0].strip(), *one[1:]) for one in self.figures_table()], strict=True)
        columns = {"value": pandas.Series(values, dtype=object), "unit": pandas.Series(units, dtype=object)}
        return pandas.DataFrame(columns).set_index(pandas.Index(labels, name="figure"))

    def to_pandas(self) -> pandas.DataFrame:
        """Its numbers as a table.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> rovtwin.load_vehicle("double_blueye").to_pandas().index.name
            'thruster'
        """
        raise NotImplementedError(f"{type(self).__name__}.to_pandas")

    def to_xarray(self) -> xarray.Dataset | xarray.DataTree:
        """Its numbers as arrays with named dimensions, coordinates and units.

        Raises:
            ConfigError: xarray is missing.

        Example:
            >>> rovtwin.load_vehicle("double_blueye").to_xarray().added_mass.dims
            ('motion', 'motion_2')
        """
        raise NotImplementedError(f"{type(self).__name__}.to_xarray")

    def plot(self) -> Axes:
        """The figure that one looks at first, on axes of its own; works without a display.

        Example:
            >>> rovtwin.load_scenario("square").plot().get_xlabel()
            'East [m]'
        """
        raise NotImplementedError(f"{type(self).__name__}.plot")

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Written as one file, from which `load` makes the same again; returns the path.

        Args:
            path: The file; its folder is there.
            overwrite: Whether a file that exists may be replaced.

        Raises:
            LogError: It cannot be written, or it exists.

        Example:
            >>> rovtwin.load_scenario("square").save("mine.yaml", overwrite=True).name
            'mine.yaml'
        """
        raise NotImplementedError(f"{type(self).__name__}.save")

    @classmethod
    def load(cls, path: str | Path) -> Any:
        """What `save` wrote.

        Raises:
            RovtwinError: The file is missing, damaged, or of another kind: what was found, and the fix.

        Example:
            >>> _ = rovtwin.load_scenario("square").save("mine.yaml", overwrite=True)
            >>> rovtwin.Scenario.load("mine.yaml").name
            'square'
        """
        raise NotImplementedError(f"{cls.__name__}.load")

    def _repr_html_(self) -> str:
        """Its figures, as a notebook shows them."""
        return html_table(repr(self).strip("<>"), self.figures_table(), self.remarks())


def axes_of(xlabel: str, ylabel: str, equal: bool = False) -> Axes:
    """Axes on a figure of their own, without a display and without pyplot; `equal`: one scale in both directions."""
    from matplotlib.figure import Figure

    axes = Figure(figsize=(7.5, 4.5), layout="constrained", facecolor="white").subplots()
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.grid(True, color="#000000", alpha=0.09, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    if equal:
        axes.set_aspect("equal", adjustable="datalim")
    return axes


def labelled(
    who: str,
    variables: Mapping[str, tuple[Sequence[str], Any, str]],
    coordinates: Mapping[str, Any],
    attributes: Mapping[str, Any] | None = None,
    time: str = "time",
) -> xarray.Dataset:
    """A data set with units.

    Args:
        who: Asks for it, for the message where xarray is missing.
        variables: By name: dimensions, values, unit.
        coordinates: By dimension.
        attributes: Of the whole; texts and numbers.
        time: The coordinate that is in seconds.

    Raises:
        ConfigError: xarray is missing.
    """
    require("xarray", "notebook", who)
    import xarray

    data = {name: (list(dims), values, {"units": unit}) for name, (dims, values, unit) in variables.items()}
    places = {name: (name, values, {"units": "s"} if name == time else {}) for name, values in coordinates.items()}
    return xarray.Dataset(data, places, dict(attributes or {}))
