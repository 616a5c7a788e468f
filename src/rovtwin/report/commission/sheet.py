"""Sheets of A4 that are filled from the top with text and tables; what has no room goes on to the next sheet."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.lines import Line2D
from matplotlib.textpath import text_to_path

from rovtwin.report.parts.tables import Table

POINTS = 72.0  # an inch
PAGE = (8.27 * POINTS, 11.69 * POINTS)  # width and height of A4 [pt]
MARGIN = 40.0  # [pt]
INK, SOFT, FAINT = "#1c2024", "#5b6570", "#c4cad0"
LEADING = 1.28  # from line to line over the size of the letters
GAP = 6.0  # between columns of a table [pt]


@cache
def width_of(text: str, size: float, bold: bool = False) -> float:
    """Of a line of text [pt]."""
    return float(text_to_path.get_text_width_height_descent(text, _font(size, bold), False)[0])


@cache
def printable(text: str) -> str:
    """With a question mark for each letter that the font does not have, and no breaks of lines."""
    font = get_font(findfont(_font(8.0, False)))
    return "".join(c if font.get_char_index(ord(c)) else "?" for c in " ".join(text.split()))


def _font(size: float, bold: bool) -> FontProperties:
    return FontProperties(family="DejaVu Sans", size=size, weight="bold" if bold else "normal")


def wrapped(text: str, size: float, width: float, bold: bool = False) -> list[str]:
    """Lines of at most a width [pt]; a word that is longer, such as a hash, is cut."""
    lines, line = [], ""
    for word in printable(text).split(" "):
        longer = f"{line} {word}".lstrip()
        if width_of(longer, size, bold) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        while width_of(word, size, bold) > width and len(word) > 1:
            cut = next(n for n in range(len(word) - 1, 0, -1) if n == 1 or width_of(word[:n], size, bold) <= width)
            lines.append(word[:cut])
            word = word[cut:]
        line = word
    return [*lines, line]


class Sheets:
    """Pages so far.

    Attributes:
        y: Where the next line begins, from the top of the page [pt].
        left, width: Of the column that is filled [pt].
    """

    def __init__(self, footer: str):
        self.pages: list[Figure] = []
        self.footer = footer
        self.left, self.width = MARGIN, PAGE[0] - 2 * MARGIN
        self.turn()

    def turn(self) -> None:
        """A new page."""
        self.pages.append(Figure(figsize=(PAGE[0] / POINTS, PAGE[1] / POINTS), facecolor="white"))
        self.y = MARGIN
        self.put(MARGIN, PAGE[1] - 22.0, self.footer, 6.5, SOFT)
        self.put(PAGE[0] - MARGIN, PAGE[1] - 22.0, str(len(self.pages)), 6.5, SOFT, right=True)

    @property
    def room(self) -> float:
        """Left on the page [pt]."""
        return PAGE[1] - MARGIN - self.y

    def need(self, height: float) -> None:
        """Turn the page where there is less room than that [pt]."""
        if height > self.room:
            self.turn()

    def put(
        self, x: float, y: float, text: str, size: float, color: str = INK, bold: bool = False, right: bool = False
    ) -> None:
        """A line of text with its baseline at a place from the top left corner [pt]."""
        self.pages[-1].text(
            x / PAGE[0], 1.0 - y / PAGE[1], printable(text), fontproperties=_font(size, bold), color=color,
            ha="right" if right else "left", va="baseline", parse_math=False,
        )  # fmt: skip

    def rule(self, y: float, color: str = FAINT, thick: float = 0.5, left: float | None = None, width: float = 0.0):
        """A line across the column [pt], or from `left` on."""
        start = self.left if left is None else left
        ends = [start / PAGE[0], (start + (width or self.width)) / PAGE[0]]
        height = 1.0 - y / PAGE[1]
        self.pages[-1].add_artist(Line2D(ends, [height, height], color=color, linewidth=thick))

    def paragraph(
        self, text: str, size: float, color: str = INK, bold: bool = False, indent: float = 0.0, space: float = 2.0
    ) -> None:
        """Text over as many lines as it takes."""
        for line in wrapped(text, size, self.width - indent, bold):
            self.need(size * LEADING)
            self.put(self.left + indent, self.y + size, line, size, color, bold)
            self.y += size * LEADING
        self.y += space

    def table(self, table: Table, size: float) -> None:
        """A table over the column's width; its head stands on each page."""
        if table.rows:
            widths = self._widths(table, size)
            if any(table.head):
                self._row(table.head, widths, size, bold=True)
            for row in table.rows:
                if self._height(row, widths, size) > self.room:
                    self.turn()
                    if any(table.head):
                        self._row(table.head, widths, size, bold=True)
                self._row(row, widths, size)
        if table.note:
            self.paragraph(table.note, size, SOFT)

    def _widths(self, table: Table, size: float) -> list[float]:
        """Of the columns [pt]: as wide as their text where that fits, else the widest ones give way."""
        columns = list(zip(*([table.head] if any(table.head) else []), *table.rows, strict=False))
        natural = [max(width_of(printable(cell), size, True) for cell in column) + GAP for column in columns]
        spare = self.width - sum(natural)
        if spare >= 0:
            return [width + spare / len(natural) for width in natural]
        limit = max(natural)
        while sum(min(width, limit) for width in natural) > self.width and limit > 3 * size:
            limit *= 0.97
        return [min(width, limit) for width in natural]

    def _height(self, row: Sequence[str], widths: Sequence[float], size: float, bold: bool = False) -> float:
        lines = [len(wrapped(cell, size, width - GAP, bold)) for cell, width in zip(row, widths, strict=False)]
        return max(lines) * size * LEADING + 2.0

    def _row(self, row: Sequence[str], widths: Sequence[float], size: float, bold: bool = False) -> None:
        x, height = self.left, self._height(row, widths, size, bold)
        for cell, width in zip(row, widths, strict=False):
            for k, line in enumerate(wrapped(cell, size, width - GAP, bold)):
                self.put(x, self.y + size + k * size * LEADING, line, size, bold=bold)
            x += width
        self.y += height
        self.rule(self.y)

    def save(self, path: Path, title: str) -> None:
        """Write all pages; the file has no time in it, so that the same pages give the same bytes."""
        with PdfPages(path, metadata={"Title": title, "CreationDate": None}) as file:
            for page in self.pages:
                file.savefig(page)
