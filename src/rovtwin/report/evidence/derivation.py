"""Published results beside what follows from their own data: tables and figures of `rovtwin thesis`.

The study is taken as it is: sections with `title`, `lines`, `remarks` and `panels` of curves, each curve of a kind.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rovtwin.report.parts.page import save, write_page
from rovtwin.report.parts.style import BLACK, BLUE, FONT, GREEN, GREY, ORANGE, SMALL, dress, new_figure
from rovtwin.report.parts.tables import Table

LOOKS: dict[str, dict[str, Any]] = {
    "published": {"color": ORANGE, "linestyle": (0, (4, 2)), "linewidth": 1.3},
    "derived": {"color": GREY, "linestyle": (0, (1, 1.5)), "linewidth": 1.6},
    "corrected": {"color": BLUE, "linewidth": 1.5},
    "towing": {"color": BLACK, "linewidth": 1.1},
    "empirical": {"color": GREEN, "linestyle": (0, (6, 2, 1, 2)), "linewidth": 1.2},
    "data": {"color": ORANGE, "linestyle": "none", "marker": "o", "markersize": 4.5, "markerfacecolor": "white"},
    "derived_data": {"color": GREY, "linestyle": "none", "marker": "s", "markersize": 4.0},
    "corrected_data": {"color": BLUE, "linestyle": "none", "marker": "o", "markersize": 4.5},
}
COLUMNS, PANEL_HEIGHT, ROW_EXTRA = 2, 2.5, 0.5  # [inch]


class Curve(Protocol):
    """What is drawn: `sd` of y makes a band of 95 %."""

    label: str
    x: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    kind: str
    sd: Float[np.ndarray, " n"] | None


def draw(panels: Sequence[Any]) -> Figure:
    """All panels of a section, two beside each other."""
    columns = min(COLUMNS, len(panels))
    count = -(-len(panels) // columns)
    figure = new_figure(count * PANEL_HEIGHT + ROW_EXTRA)
    grid = figure.subplots(count, columns, squeeze=False)
    handles: dict[str, Any] = {}
    for axes, panel in zip(grid.ravel(), panels, strict=False):
        for curve in panel.curves:
            handles.setdefault(curve.label, _draw(axes, curve))
        dress(axes, panel.y_label, panel.x_label)
        axes.set_title(panel.title, fontsize=FONT, loc="left")
    for axes in grid.ravel()[len(panels) :]:
        axes.set_visible(False)
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=min(3, len(handles)), fontsize=SMALL,
        frameon=False,
    )  # fmt: skip
    return figure


def _draw(axes: Axes, curve: Curve) -> Any:
    (drawn,) = axes.plot(curve.x, curve.y, **LOOKS[curve.kind])
    if curve.sd is not None:
        band = np.maximum(curve.y - 1.96 * curve.sd, 0.0), curve.y + 1.96 * curve.sd
        axes.fill_between(curve.x, *band, color=LOOKS[curve.kind]["color"], alpha=0.15, linewidth=0)
    return drawn


def digits(value: float | None, sd: float | None = None) -> str:
    """A number for a table: 4 significant digits, with its deviation where there is one."""
    if value is None:
        return "-"
    value = 0.0 if abs(value) < 1e-9 else value
    if sd is None or not 0 < sd < np.inf:
        return f"{value:.4g}" if abs(value) < 1e3 else f"{value:.0f}"
    places = max(0, 1 - int(np.floor(np.log10(sd))))
    return f"{value:.{places}f} ± {sd:.{places}f}"


def table_of(section: Any) -> Table:
    """A section's lines for the page."""
    head = ["Quantity", "Unit", "Thesis", "Published", "Derived", "Corrected", "Why"]
    rows = [
        [line.name, line.unit, line.where, digits(line.published), digits(line.derived),
         digits(line.corrected, line.sd), line.reason]
        for line in section.lines
    ]  # fmt: skip
    return Table(section.title, head, rows)


def write_derivation(study: Any, folder: str | Path, title: str, caption: str) -> Path:
    """Write `report.html` and its figures into a folder.

    Args:
        study: `sections` as above.
        folder: Made where it does not exist.
        title: On top of the page.
        caption: Below every figure.

    Returns:
        The path of the page.
    """
    folder = Path(folder)
    sections = []
    for section in study.sections:
        picture = save(draw(section.panels), folder, section.key, section.title, caption) if section.panels else None
        sections.append({"key": section.key, "title": section.title, "table": table_of(section),
                         "remarks": section.remarks, "picture": picture})  # fmt: skip
    return write_page(folder / "report.html", "derivation.html.j2", title=title, sections=sections)
