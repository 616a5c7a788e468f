"""Pages: a template filled and written, and figures as a page shows them."""

import base64
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rovtwin.core.user_files.files import write_text

DPI = 150
_TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True)
class Picture:
    """A figure as the page shows it: `data` is its PNG as a data URI, the files lie in `figures/`."""

    name: str
    title: str
    caption: str
    data: str


def save(figure: Figure, folder: Path, name: str, title: str = "", caption: str = "") -> Picture:
    """Write a figure as PNG and SVG into `folder/figures`."""
    target = folder / "figures"
    target.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure)
    # The layout is computed once, not again for each format.
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=DPI)
    (target / f"{name}.png").write_bytes(stream.getvalue())
    figure.savefig(target / f"{name}.svg", format="svg", metadata={"Date": None})
    data = "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()
    return Picture(name, title, caption, data)


def write_page(path: Path, template: str, **context: Any) -> Path:
    """Fill a template and write it."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, environment.get_template(template).render(**context))
    return path
