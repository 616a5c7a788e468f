"""A log as tables, labelled arrays and a figure, as every result has them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from rovtwin.core.extras import require
from rovtwin.core.notebook import Result, axes_of, labelled
from rovtwin.core.notebook.face import Row

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

    from rovtwin.core.log.channel import Channel
    from rovtwin.core.log.reader import Series

_MOST = 6000  # points of a line that is drawn


class LogFace(Result):
    """What `Log` has of the face of all results."""

    channels: dict[str, Channel]
    metadata: dict[str, str]

    if TYPE_CHECKING:

        def __getitem__(self, name: str) -> Series: ...

        def write(self, path: str | Path, overwrite: bool = False) -> Path: ...

        @staticmethod
        def read(path: str | Path) -> Any: ...

        @property
        def start(self) -> float: ...

        @property
        def duration(self) -> float: ...

    def figures_table(self) -> list[Row]:
        """Beginning, length, and the samples of each channel.

        Example:
            >>> log.figures_table()[1]
            ('duration', 1.0, 's')
        """
        head: list[Row] = [("begins at", self.start, "s"), ("duration", self.duration, "s")]
        return head + [(name, len(self[name]), "samples") for name in self.channels]

    def summary(self) -> pandas.DataFrame:
        """A row for each channel: samples, first and last time [s], fields, unit, frame.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> log.summary().loc["depth", "unit"]
            'm'
        """
        require("pandas", "notebook", "Log.summary")
        import pandas

        rows = []
        for name, channel in self.channels.items():
            t = self[name].t
            ends = (float(t[0]), float(t[-1])) if len(t) else (np.nan, np.nan)
            rows.append(
                (len(t), *ends, " ".join(channel.fields), ", ".join(dict.fromkeys(channel.units)), channel.frame)
            )
        columns = ["samples", "first", "last", "fields", "unit", "frame"]
        return pandas.DataFrame(rows, pandas.Index(list(self.channels), name="channel"), columns)

    def to_xarray(self) -> xarray.DataTree:
        """A tree with a node for each channel, in which each field is a variable by the channel's own `time` [s].

        Raises:
            ConfigError: xarray is missing.

        Example:
            >>> log.to_xarray()["depth/z"].attrs["units"]
            'm'
        """
        require("xarray", "notebook", "Log.to_xarray")
        import xarray

        return xarray.DataTree.from_dict({self._node(name): self._dataset(name) for name in self.channels})

    def _node(self, name: str) -> str:
        """Place of a channel in the tree; one whose name begins those of others stands beside them."""
        return f"{name}_" if any(other.startswith(f"{name}/") for other in self.channels) else name

    def _dataset(self, name: str) -> xarray.Dataset:
        series, channel = self[name], self.channels[name]
        columns = zip(channel.fields, channel.units, series.values.T, strict=True)
        variables: Mapping[str, Any] = {field: (["time"], values, unit) for field, unit, values in columns}
        about = {"frame": channel.frame, "description": channel.description}
        return labelled("Log.to_xarray", variables, {"time": series.t}, about)

    def to_pandas(self) -> pandas.DataFrame:
        """All channels side by side: columns by `channel` and `field`, by time [s]; NaN where one has no sample.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> log.to_pandas()["depth", "z"].tolist()
            [2.0, 3.0]
        """
        require("pandas", "notebook", "Log.to_pandas")
        import pandas

        frames = []
        for name, channel in self.channels.items():
            t, values = self[name].t, self[name].values
            turn = np.arange(len(t)) - np.searchsorted(t, t)  # a channel may have a time twice
            rows = pandas.MultiIndex.from_arrays([t, turn], names=["time", "turn"])
            columns = pandas.MultiIndex.from_product([[name], channel.fields], names=["channel", "field"])
            frames.append(pandas.DataFrame(values, rows, columns))
        return pandas.concat(frames, axis=1).sort_index().droplevel("turn")

    def plot(self, name: str = "") -> Axes:
        """The fields of a channel over time.

        Args:
            name: The channel; by default the first that has samples.

        Raises:
            LogError: No such channel.

        Example:
            >>> log.plot("depth").get_ylabel()
            'depth [m]'
        """
        name = name or next((one for one in self.channels if len(self[one])), next(iter(self.channels)))
        series = self[name]
        axes = axes_of("Time [s]", f"{name} [{', '.join(dict.fromkeys(series.channel.units))}]")
        shown = slice(None, None, max(1, len(series) // _MOST))
        for field, values in zip(series.channel.fields, series.values.T, strict=True):
            axes.plot(series.t[shown], values[shown], linewidth=0.9, label=field)
        axes.legend(frameon=False, fontsize=8)
        return axes

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Written as an MCAP file, channels interleaved in time; as `write`.

        Raises:
            LogError: The file cannot be written, or it exists.

        Example:
            >>> log.save("depth.mcap", overwrite=True).name
            'depth.mcap'
        """
        return self.write(path, overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """A whole MCAP log; as `read`.

        Raises:
            LogError: The file is missing, not a log, unfinished or damaged.

        Example:
            >>> rovtwin.Log.load(log.save("depth.mcap", overwrite=True)).equal_data(log)
            True
        """
        return cls.read(path)
