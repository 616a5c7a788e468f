"""Colours of classes: those of seabed materials as people expect them, others from a list, none twice."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

Colour = tuple[int, int, int]
OUTSIDE, MIXED = (30, 30, 30), (214, 218, 222)  # what is not of the library, and mixtures
_USUAL: dict[str, Colour] = {
    "sand": (232, 205, 140),
    "mud": (122, 92, 67),
    "rock": (139, 145, 153),
    "kelp": (92, 107, 22),
    "maerl": (197, 84, 122),
    "coral": (240, 138, 93),
    "green_algae": (63, 163, 77),
    "rust": (166, 60, 6),
    "paint_white": (245, 245, 250),
    "paint_yellow": (245, 215, 30),
    "paint_red": (220, 20, 40),
    "white_50": (250, 250, 250),
    "grey_20": (178, 178, 186),
    "black_3": (70, 70, 80),
}
# Of Okabe and Ito (2008) and lighter ones between, for classes of other names.
_OTHERS: tuple[Colour, ...] = (
    (0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (213, 94, 0), (240, 228, 66),
    (120, 94, 240), (170, 220, 170), (150, 30, 90), (60, 60, 160), (190, 150, 110),
)  # fmt: skip


@dataclass(frozen=True)
class ClassMap:
    """A map of classes, one byte a cell.

    Attributes:
        value: Numbers of the classes.
        names: Of them, from 0 on.
        colours: Of them.
        no_data: Of cells without a class.
    """

    value: UInt8[np.ndarray, "row column"]
    names: Sequence[str]
    colours: Sequence[Colour]
    no_data: int


def class_colours(names: Sequence[str]) -> list[Colour]:
    """Of classes; beyond the list grey steps, each once."""
    others = iter(_OTHERS)
    return [
        _USUAL.get(name) or next(others, (80 + (37 * k) % 150, 80 + (61 * k) % 150, 80 + (97 * k) % 150))
        for k, name in enumerate(names)
    ]
