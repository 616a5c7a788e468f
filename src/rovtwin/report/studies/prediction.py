"""Figure of a prediction: bands of flights, made before, and the flight that came after."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from rovtwin.report.parts.style import BAND, BLACK, BLUE, FAULT, dress, legend_above, name_panel, new_figure


def prediction_figure(
    t: Float[np.ndarray, " n"],
    low: Float[np.ndarray, "n k"],
    high: Float[np.ndarray, "n k"],
    middle: Float[np.ndarray, "n k"],
    flown: tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"]] | None,
    labels: Sequence[tuple[str, str]],
    captions: Sequence[str],
) -> Figure:
    """A panel for each axis: the band, its middle, and the flight; red where it is outside.

    Args:
        t: Times of the band [s].
        low: Lower end of the band.
        high: Its upper end.
        middle: The median of what it was made from.
        flown: Times [s] and values of the flight; None: not flown yet.
        labels: Name and unit of each of the k axes.
        captions: A remark for each.
    """
    figure = new_figure(1.55 * len(labels) + 0.4)
    panels = figure.subplots(len(labels), 1, sharex=True, squeeze=False).ravel()
    for i, (panel, (name, unit), caption) in enumerate(zip(panels, labels, captions, strict=True)):
        panel.fill_between(t, low[:, i], high[:, i], **BAND)
        panel.plot(t, middle[:, i], color=BLUE, linewidth=0.8, linestyle=(0, (4, 2)))
        if flown is not None:
            n = min(len(flown[0]), len(t))
            panel.plot(flown[0][:n], flown[1][:n, i], color=BLACK, linewidth=0.9, zorder=4)
            inside = (flown[1][:n, i] >= low[:n, i]) & (flown[1][:n, i] <= high[:n, i])
            outside = np.where(inside, np.nan, flown[1][:n, i])
            panel.plot(flown[0][:n], outside, color=FAULT, linewidth=1.8, zorder=5)
        dress(panel, f"[{unit}]", "time from leaving the first corner [s]" if i == len(labels) - 1 else "")
        name_panel(panel, f"{name}{f': {caption}' if caption else ''}")
        if name == "depth":
            panel.invert_yaxis()
    handles = [
        Patch(**{**BAND, "label": "95 % band, predicted"}),
        Line2D([], [], color=BLUE, linewidth=0.8, linestyle=(0, (4, 2)), label="its median"),
    ]
    if flown is not None:
        handles.append(Line2D([], [], color=BLACK, linewidth=0.9, label="flown"))
        handles.append(Line2D([], [], color=FAULT, linewidth=1.8, label="flown, outside"))
    legend_above(figure, handles)
    return figure
