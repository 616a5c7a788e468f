"""How results of the thesis are laid side by side."""

from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.user_files.config import parse_yaml


@dataclass(frozen=True)
class Line:
    """One result.

    Attributes:
        name: For people.
        unit: SI.
        where: Table or equation of the thesis.
        published: As printed, None where the thesis prints none.
        derived: What the thesis's own data give by its own formula, None where they do not suffice.
        corrected: What they give when the mistakes are mended, None where nothing is to mend or it cannot be.
        sd: Standard deviation of `corrected`, where there is one.
        reason: Why they differ; empty where they agree.
    """

    name: str
    unit: str
    where: str
    published: float | None
    derived: float | None = None
    corrected: float | None = None
    sd: float | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Curve:
    """A line or points of a figure.

    Attributes:
        label: For the legend.
        x, y: Its points.
        kind: published, derived, corrected, towing, empirical or data: decides how it is drawn.
        sd: Of y, for a band.
    """

    label: str
    x: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    kind: str
    sd: Float[np.ndarray, " n"] | None = None


@dataclass(frozen=True)
class Panel:
    """Curves over one pair of axes."""

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class Section:
    """One subject: lines of a table, what there is to say, panels of its figure."""

    key: str
    title: str
    lines: tuple[Line, ...]
    remarks: tuple[str, ...] = ()
    panels: tuple[Panel, ...] = field(default=(), compare=False)


@cache
def printed(name: str) -> dict[str, Any]:
    """What the thesis prints: `free_running`, `decay`, `comparison`, `simulation`; and `reasons`."""
    text = (files("rovtwin.identification.thesis") / f"{name}.yaml").read_text(encoding="utf-8")
    return parse_yaml(text, f"{name}.yaml")


def sentence(key: str, **values: Any) -> str:
    """A reason of reasons.yaml with what was computed filled in."""
    return str(printed("reasons")[key]).format(**values)


def half_digit(value: float) -> float:
    """Half of the last printed digit: how far rounding may have moved a number; a whole number is taken as exact."""
    text = repr(float(value))
    return 0.5 * 10.0 ** -len(text.split(".")[1]) if not text.endswith(".0") else 0.0
