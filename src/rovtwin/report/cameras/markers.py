"""Markers on paper, to scale: several on a page where they fit, with cut marks and a ruler that checks the printer."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Shaped
from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from rovtwin.core.arrays.stretches import stretches
from rovtwin.core.errors import ConfigError
from rovtwin.core.markers import DICTIONARIES, pattern
from rovtwin.core.user_files.yamlfile import near

PAGES = {"a4": (0.210, 0.297), "a3": (0.297, 0.420), "letter": (0.2159, 0.2794)}  # width, height [m]
_EDGE = 0.0045  # that printers leave white [m]
_BELOW = 0.020  # of the page for the ruler [m]
_LABEL = 0.007  # height of the line with its number [m]
_MARK = 0.005  # length of a cut mark, at most half the rim of the marker beside it [m]
_INCH = 0.0254


def numbers(text: str, where: str) -> list[int]:
    """Of "0-11" or "0,3,7-9", in that order.

    Raises:
        ConfigError: Anything else, or a number twice.
    """
    found: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,4})(?:\s*-\s*(\d{1,4}))?\s*", part)
        last = match and int(match[2] or match[1])
        if not match or last is None or last < int(match[1]):
            raise ConfigError(f"{where}: found '{text}', expected numbers such as 0-11 or 0,3,7-9")
        found += range(int(match[1]), last + 1)
    twice = sorted({n for n in found if found.count(n) > 1})
    if twice:
        raise ConfigError(f"{where}: found {twice[0]} twice in '{text}', expected each id once")
    return found


@dataclass(frozen=True)
class Sheet:
    """How markers lie on a page: its size [m], how many across and down, and the side of a marker with its rim [m]."""

    width: float
    height: float
    across: int
    down: int
    board: float

    def corner(self, place: int) -> tuple[float, float]:
        """Lower left corner of a board [m] from the lower left of the page."""
        row, column = divmod(place, self.across)
        room = (self.width - 2 * _EDGE) / self.across, (self.height - 2 * _EDGE - _BELOW) / self.down
        x = _EDGE + (column + 0.5) * room[0] - 0.5 * self.board
        y = self.height - _EDGE - (row + 0.5) * room[1] - 0.5 * self.board + 0.5 * _LABEL
        return x, y


def sheet(size: float, cells: int, page: str) -> Sheet:
    """For markers of a size [m] with that many cells a side, border included; upright or across, whichever holds more.

    Raises:
        ConfigError: No such paper, or too small a paper.
    """
    if page not in PAGES:
        raise ConfigError(f"--page: found '{page}', expected one of {', '.join(PAGES)}.{near(page, PAGES)}")
    board = size * (cells + 2) / cells
    found = []
    for width, height in (PAGES[page], PAGES[page][::-1]):
        across = int((width - 2 * _EDGE) / board + 1e-9)
        down = int((height - 2 * _EDGE - _BELOW) / (board + _LABEL))
        found.append(Sheet(width, height, across, down, board))
    best = max(found, key=lambda s: s.across * s.down)
    if best.across * best.down == 0:
        width, height = PAGES[page]
        room = min(width - 2 * _EDGE, height - 2 * _EDGE - _BELOW - _LABEL)
        larger = " or --page a3" if page != "a3" else ""
        raise ConfigError(
            f"--size: found {1e3 * size:g} mm, which with its white rim takes {1e3 * board:.0f} mm; {page} has room "
            f"for {np.floor(1e3 * room * cells / (cells + 2)):.0f} mm: take a smaller one{larger}"
        )
    return best


def write_markers(path: Path, dictionary: str, ids: list[int], size: float, page: str = "a4") -> int:
    """A PDF of markers; how many pages it has.

    Args:
        path: To write.
        dictionary: Of OpenCV's.
        ids: Which.
        size: Side of the black square [m].
        page: Paper.

    Raises:
        ConfigError: No such dictionary, id or paper, or OpenCV is not installed.
    """
    if dictionary not in DICTIONARIES:
        raise ConfigError(f"--dictionary: found '{dictionary}'.{near(dictionary, DICTIONARIES)}")
    last = int(dictionary.rpartition("_")[2]) - 1
    if max(ids) > last:
        raise ConfigError(f"--ids: found {max(ids)}, but {dictionary} ends with {last}")
    patterns = {number: pattern(dictionary, number) for number in ids}
    plan = sheet(size, len(patterns[ids[0]]), page)
    each = plan.across * plan.down
    pages = [ids[start : start + each] for start in range(0, len(ids), each)]
    with PdfPages(path, metadata={"Title": f"{dictionary}, {1e3 * size:g} mm", "CreationDate": None}) as pdf:
        for shown in pages:
            pdf.savefig(_page(plan, {n: patterns[n] for n in shown}, dictionary, size))
    return len(pages)


def _page(plan: Sheet, patterns: dict[int, Shaped[np.ndarray, "side side"]], dictionary: str, size: float) -> Figure:
    """One page; its axes count metres from the lower left corner of the paper."""
    figure = Figure(figsize=(plan.width / _INCH, plan.height / _INCH), facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0, plan.width), ylim=(0, plan.height))
    axes.set_axis_off()
    for place, (number, black) in enumerate(patterns.items()):
        x, y = plan.corner(place)
        _marker(axes, x, y, plan.board, black, f"{dictionary}  {number}  {1e3 * size:g} mm")
    _ruler(axes, plan.width)
    return figure


def _marker(axes: Axes, x: float, y: float, board: float, black: Shaped[np.ndarray, "side side"], label: str) -> None:
    cells = len(black)
    cell = board / (cells + 2)
    for row in range(cells):
        # One rectangle for each run of black: no white hair between cells.
        for start, stop in stretches(black[row]):
            corner = x + (1 + start) * cell, y + (cells - row) * cell
            axes.add_patch(Rectangle(corner, (stop - start) * cell, cell, facecolor="black", edgecolor="none"))
    mark = min(_MARK, 0.5 * cell)
    for cx, outward_x in ((x, -mark), (x + board, mark)):
        for cy, outward_y in ((y, -mark), (y + board, mark)):
            axes.plot([cx, cx + outward_x], [cy, cy], color="black", lw=0.4)
            axes.plot([cx, cx], [cy, cy + outward_y], color="black", lw=0.4)
    # In the rim, so that it is still there when the marker hangs, and tells which side is up; else below.
    at = y + 0.25 * cell if cell > _LABEL else y - 0.5 * _LABEL
    axes.text(x + 0.5 * board, at, label, ha="center", va="center", fontsize=6, color="#777777")


def _ruler(axes: Axes, width: float) -> None:
    """As long as fits, in whole centimetres, with a line every centimetre."""
    length = np.floor((width - 2 * _EDGE - 0.02) / 0.01 + 1e-9) * 0.01
    x, y = 0.5 * (width - length), _EDGE + 0.008
    axes.plot([x, x + length], [y, y], color="black", lw=0.6)
    for i in range(round(length / 0.01) + 1):
        tall = 0.004 if i % 5 == 0 else 0.002
        axes.plot([x + 0.01 * i] * 2, [y, y + tall], color="black", lw=0.4)
    text = f"This line is {1e3 * length:.0f} mm long. If a ruler says otherwise, print at 100 % (no fit to page)."
    axes.text(0.5 * width, y - 0.003, text, ha="center", va="center", fontsize=7)
