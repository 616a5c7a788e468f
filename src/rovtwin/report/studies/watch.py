"""Report of a watch: each quantity over the runs, and the runs beside each other."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rovtwin.report.identification.html import Section
from rovtwin.report.parts.page import save, write_page
from rovtwin.report.parts.style import BAND, BLACK, FAULT, GREY, SMALL, dress, name_panel, new_figure
from rovtwin.report.parts.tables import Table
from rovtwin.report.parts.verdict import Verdict

COLUMNS = 3


def watch_figure(found: Any, shown: list[int], changed: set[tuple[int, int]]) -> Figure:
    """A panel for each quantity: runs with two standard deviations, and the band of those before.

    Args:
        found: `rovtwin.runs.watch.Watch`.
        shown: Which quantities.
        changed: Pairs of run and quantity that have changed.
    """
    rows = -(-len(shown) // COLUMNS)
    figure = new_figure(1.7 * rows + 0.4)
    panels = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True).ravel()
    at = np.arange(len(found.runs))
    for panel, i in zip(panels, shown, strict=False):
        readings = [one.run.readings[i] for one in found.runs]
        unit = readings[0].scale[1]
        if found.before is not None and np.isfinite(found.before.std[i]):
            low, _, high = readings[0].with_values(found.before.value[i], found.before.std[i]).interval
            panel.axhspan(low, high, **BAND)
        panel.axhline(0.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 2)))
        for k, reading in enumerate(readings):
            colour = FAULT if (k, i) in changed else BLACK if reading.learnt else GREY
            low, middle, high = reading.interval
            panel.errorbar(k, middle, [[middle - low], [high - middle]], color=colour, fmt="o", markersize=3.5)
        dress(panel, f"[{unit}]")
        name_panel(panel, readings[0].quantity.words.rstrip(","))
        panel.set_xlim(-0.5, len(found.runs) - 0.5)
        panel.set_xticks(at, [one.run.name for one in found.runs], rotation=60, ha="right", fontsize=SMALL)
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    return figure


def write_watch(found: Any, folder: Path, also: Sequence[str] = ()) -> Path:
    """Write `report.html` and figures of a `rovtwin.runs.watch.Watch` into a folder; the path of the page.

    `also` are further lines, such as what a certificate says.
    """
    changed = found.changes
    names = [reading.quantity.name for reading in found.runs[0].run.readings]
    shown = [i for i in range(len(names)) if any(one.run.readings[i].learnt for one in found.runs)]
    marked = {(k, names.index(c.reading.quantity.name)) for k, some in enumerate(changed) for c in some}
    items: list[Any] = []
    if shown:
        items.append(
            save(
                watch_figure(found, shown, marked), Path(folder), "watch", "Quantities over the runs",
                "Against the description, with two standard deviations; red: changed; grey: not learnt. Band: the runs "
                "of the baseline, or the identification.",
            )
        )  # fmt: skip
    head = ["Quantity", *(one.run.name for one in found.runs)]
    cells = [
        [found.runs[0].run.readings[i].quantity.words.rstrip(","), *(one.run.readings[i].figures for one in found.runs)]
        for i in shown
    ]
    any_lost = any(one.lost for one in found.runs)
    any_changed = any(changed) or bool(found.drifts) or any_lost
    headline = "Something has changed" if any_changed else "Nothing has changed that these runs can tell"
    unknown = found.before is None or (any(found.first_learnt) and not any_changed)
    if unknown:
        headline = f"Not as described, where nothing is known from {found.against}"
    if found.before is None:
        unknown = not any_lost
        headline = "A thruster is lost" if any_lost else "One run against its description"
    return write_page(
        Path(folder) / "report.html",
        "sections.html.j2",
        title=f"Watch: {found.vehicle.name}",
        verdict=Verdict(None if unknown else not any_changed, headline, [f"Compared with {found.against}."], []),
        sections=[
            Section("runs", "Runs", (), [*(text for text, _ in found.words()), *also], [*items, Table("", head, cells)])
        ],
    )
