"""Figures of the tests behind an identification: what was read and what the model says, one figure per test."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from rovtwin.report.parts.style import BLACK, BLUE, ORANGE, dress, legend_above, line, name_panel, new_figure, note

# Angles in figures are in degrees; the rest as read.
_UNITS = {"position": "m", "horizontal": "m", "depth": "m", "velocity": "m/s", "accelerometer": "m/s²"}
_DEGREES = {"attitude": "deg", "gyro": "deg/s"}
_NAMES = {"phi": "roll", "theta": "pitch", "psi": "heading"}
_LOOKS = ({"color": BLUE, "linewidth": 1.2, "zorder": 4}, {"color": ORANGE, "linewidth": 1.0, "zorder": 5})
_READ = {"color": BLACK, "linewidth": 0.0, "marker": ".", "markersize": 1.6, "alpha": 0.45, "zorder": 2}
_DOTS = 1200
_READ["rasterized"] = True  # thousands of dots weigh down a vector file


def prediction_figure(predictions: Sequence[Any]) -> Figure:
    """Read and predicted components of one test.

    Args:
        predictions: Of the same record: `readings`, `scores`, `excited`, `window`; the first gives the remarks.
    """
    first = predictions[0]
    names = list(first.scores)
    columns = 2 if len(names) > 1 else 1
    rows = -(-len(names) // columns)
    figure = new_figure(1.35 * rows + 0.55)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for k, (axes, name) in enumerate(zip(grid, names, strict=False)):
        _component(axes, predictions, name)
        dress(axes, f"[{unit_of(name)}]", "Time [s]" if k // columns == rows - 1 else "", ticks=4)
        axes.tick_params(labelbottom=len(names) - k <= columns)
        name_panel(axes, component_name(name))
        score = first.scores[name]
        text = (
            f"fit {round(score.fit)} %"
            if first.excited[name]
            else f"little above its noise; rms {_shown(name, score.rms)}"
        )
        note(axes, text)
    for axes in grid[len(names) :]:
        axes.set_visible(False)
    handles = [Line2D([], [], **_READ | {"markersize": 5, "alpha": 1.0}, label="read")]
    handles += [Line2D([], [], **look, label=how(p)) for look, p in zip(_LOOKS, predictions, strict=False)]
    legend_above(figure, handles)
    return figure


def how(prediction: Any) -> str:
    """How a prediction was made, in words."""
    return "open loop, whole test" if prediction.window is None else f"measured anew every {prediction.window:g} s"


def component_name(component: str) -> str:
    """For people: `roll`, `gyro p`, `north`."""
    signal, part = component.split(".")
    return _NAMES.get(part, part) if signal in ("attitude", "depth", "horizontal", "position") else f"{signal} {part}"


def unit_of(component: str) -> str:
    """Of a component in figures and tables."""
    signal = component.split(".")[0]
    return _DEGREES.get(signal) or _UNITS[signal]


def scaled(component: str, value: Any) -> Any:
    """A value in the unit of `unit_of`."""
    return np.degrees(value) if component.split(".")[0] in _DEGREES else value


def _shown(component: str, value: float) -> str:
    return f"{scaled(component, value):.2g} {unit_of(component)}"


def _component(axes: Axes, predictions: Sequence[Any], name: str) -> None:
    signal, part = name.split(".")
    own = [n.split(".")[1] for n in predictions[0].scores if n.startswith(f"{signal}.")].index(part)
    for k, (look, prediction) in enumerate(zip(_LOOKS, predictions, strict=False)):
        t, read, predicted = (np.asarray(x) for x in prediction.readings[signal])
        y = read[:, own]
        gap = predicted[:, own] - y
        if prediction.window is None and signal == "attitude":
            gap = np.unwrap(gap)
        y = np.unwrap(y) if signal == "attitude" else y
        t = t - t[0]
        if k == 0:
            some = slice(None, None, -(-len(t) // _DOTS))  # not the ends of bins, as of a line: noise would look hollow
            axes.plot(t[some], scaled(name, y)[some], **_READ)
        line(axes, t, scaled(name, _broken(prediction.window, t, y + gap)), points=5000, **look)


def _broken(
    window: float | None, t: Float[np.ndarray, " n"], y: Float[np.ndarray, "n ..."]
) -> Float[np.ndarray, "n ..."]:
    """With a gap at each restart, so that jumps back to the readings aren't drawn as motion."""
    if window is None or len(t) < 2:
        return y
    number = np.floor((t - t[0] + np.median(np.diff(t))) / window)  # a test begins one reading before its first
    return np.where(np.diff(number, prepend=number[0]) > 0, np.nan, y)
