"""Picture of a pull on a scale: where the line is tied, which way the vehicle pulls, what is read off."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle

from rovtwin.report.parts.style import BLACK, BLUE, GREY, ORANGE, SKY, SMALL, new_figure

# Where the picture is seen from, and the ends of the vehicle that the line does not and does hold.
_WAYS = {
    "surge": ("from above", "bow", "stern"),
    "sway": ("from above", "starboard side", "port side"),
    "heave": ("from the side", "bottom", "top"),
}
# Along the line: from the fixed point to the scale, through it, to the vehicle, through it, to the arrow's tip.
_FIXED, _SCALE, _HULL, _TIP = 0.55, (1.5, 2.4), (5.6, 7.8), 9.6


def draw_bollard(direction: str, command: float, seconds: float, expected: float) -> Figure:
    """The arrangement of one pull.

    Args:
        direction: surge, sway or heave: ahead, to starboard or down.
        command: Share of full command.
        seconds: How long it pulls.
        expected: Reading of the scale by the vehicle's file [N].
    """
    seen, front, back = _WAYS[direction]
    upright = direction == "heave"
    figure = new_figure(5.5 if upright else 3.0)
    axes = figure.add_subplot()
    axes.set(xlim=(0, 10), ylim=(-10, 0) if upright else (-2, 2), aspect="equal")
    axes.axis("off")
    if upright:
        axes.axhspan(-10.0, -3.4, color=SKY, alpha=0.15, linewidth=0)
    _arrangement(axes, upright)
    fixed = "a beam above the water" if upright else "a fixed point at the wall"
    words = (
        (0.3, -1.0, fixed),
        (0.5 * sum(_SCALE), 0.45, f"scale, should read some {expected:.0f} N"),
        (4.0, -0.45, "line, taut, on the vehicle's middle"),
        (_HULL[0], 0.95, f"{back}: tie it here"),
        (_HULL[1], -0.95, front),
        (0.5 * (_HULL[1] + _TIP), 0.45, f"pulls at {command:.0%} for {seconds:g} s"),
    )
    for along, across, text in words:
        x, y = _at(along, abs(across) if upright else across, upright)
        axes.text(x, y, text, fontsize=SMALL, color=BLACK, ha="left" if upright else "center", va="center")
    axes.set_title(f"pull in {direction}, seen {seen}", fontsize=SMALL, loc="left")
    return figure


def _arrangement(axes: Axes, upright: bool) -> None:
    """Fixed point, scale, line, vehicle, arrow."""

    def box(along: tuple[float, float], half: float, **style: Any) -> None:
        (x0, y0), (x1, y1) = (_at(a, b, upright) for a, b in zip(along, (-half, half), strict=True))
        corner = (min(x0, x1), min(y0, y1))
        axes.add_patch(Rectangle(corner, abs(x1 - x0), abs(y1 - y0), **style))

    box((0.2, _FIXED), 0.8, color=GREY)
    box(_SCALE, 0.25, fill=False, edgecolor=ORANGE, linewidth=1.5)
    box(_HULL, 0.7, fill=False, edgecolor=BLUE, linewidth=1.8)
    for start, end in ((_FIXED, _SCALE[0]), (_SCALE[1], _HULL[0])):
        x, y = zip(_at(start, 0.0, upright), _at(end, 0.0, upright), strict=True)
        axes.plot(x, y, color=BLACK, linewidth=1.2)
    ends = (_at(_HULL[1] + 0.1, 0.0, upright), _at(_TIP, 0.0, upright))
    axes.add_patch(FancyArrowPatch(*ends, arrowstyle="-|>", mutation_scale=18, color=BLUE))


def _at(along: float, across: float, upright: bool) -> tuple[float, float]:
    """Place in the picture of a point of the line, and beside it."""
    return (2.5 + across, -along) if upright else (along, across)
