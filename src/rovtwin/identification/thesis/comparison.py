"""Tables 4.1 and 4.2, and figure 4.10: all methods side by side."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.identification.thesis.decay import PLACES, corrected
from rovtwin.identification.thesis.found import Curve, Line, Panel, Section, printed, sentence
from rovtwin.identification.thesis.free_running import bent, bent_heave
from rovtwin.identification.thesis.parts import quadratic_of_parts
from rovtwin.vehicle.constants import COEFFICIENT_UNITS

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FASTEST = {"surge": 0.29, "sway": 0.16, "heave": 0.06}  # of the free-running tests, tables 3.3 to 3.5 [m/s]
WORDS = ("linear", "quadratic")


def force(pair: Sequence[float], v: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Damping of a (linear, quadratic) pair at speeds."""
    return pair[0] * v + pair[1] * np.abs(v) * v


def largest_gap(axis: str) -> tuple[float, float, float]:
    """Largest difference of printed free running from towing over the tested speeds: [N], share of towing, at [m/s]."""
    row = printed("comparison")["table_4_2"][axis]
    v = np.linspace(0.005, FASTEST[axis], 200)
    towed = force(row["towing"], v)
    gap = force(row["free_running"], v) - towed
    i = int(np.abs(gap).argmax())
    return float(gap[i]), float(gap[i] / towed[i]), float(v[i])


def copies() -> list[Line]:
    """Where table 4.2 repeats another number than its source."""
    data = printed("comparison")
    lines = []
    for i, axis in enumerate(AXES):
        row = data["table_4_2"][axis]
        for k, word in enumerate(WORDS):
            sources = {
                "free running": ("table 3.7", row["free_running"][k], data["table_3_7"][axis][1 + k]),
                "empirical": (
                    data["empirical"][word]["where"],
                    row["empirical"][k],
                    data["empirical"][word]["values"][i],
                ),
            }
            for method, (source, shown, first) in sources.items():
                # Fewer digits of the same number are no mistake.
                if abs(shown - first) <= 0.05 * abs(first):
                    continue
                times = f", {shown / first:.2f} times it" if first else ""
                lines.append(
                    Line(
                        f"{axis}, {word} damping, {method}",
                        COEFFICIENT_UNITS[f"{word}_damping"][i > 2],
                        "table 4.2",
                        shown,
                        first,
                        reason=sentence("other_table", source=source, times=times),
                    )
                )
    return lines


def _largest_error(axis: str) -> Line:
    gap, share, at = largest_gap(axis)
    v = np.linspace(0.005, FASTEST[axis], 200)
    towed = force(printed("comparison")["table_4_2"][axis]["towing"], v)
    after = None if axis == "heave" else float(np.abs(bent(axis).drag(v) - towed).max())
    why = sentence("largest_error_heave" if axis == "heave" else "largest_error", at=at, share=100 * share)
    claimed = float(printed("comparison")["largest_error"])
    return Line(f"{axis}, largest error of free running", "N", "sec. 4.6.2", claimed, abs(gap), after, reason=why)


def comparison_section() -> Section:
    """Tables 4.1 and 4.2, figure 4.10."""
    lines = (*copies(), *map(_largest_error, FASTEST))
    remarks = (sentence("table_4_1"), sentence("towing"))
    title = "Comparison of the methods (tables 4.1 and 4.2, figure 4.10)"
    return Section("comparison", title, lines, remarks, tuple(map(_panel, AXES)))


def _corrected(axis: str, v: Float[np.ndarray, " n"]) -> Curve:
    if axis == "heave":
        return Curve("corrected", v, bent_heave()[0].force(v), "corrected")
    if axis in PLACES:
        pair = (corrected(axis)[1], float(quadratic_of_parts()[PLACES[axis]]))
        return Curve("corrected", v, force(pair, v), "corrected")
    fit = bent(axis)
    return Curve("corrected", v, fit.drag(v), "corrected", fit.drag_sd(v))


def _panel(axis: str) -> Panel:
    """One direction of figure 4.10, with what is corrected."""
    row = printed("comparison")["table_4_2"][axis]
    v = np.linspace(0, FASTEST.get(axis, 0.8), 60)
    curves = [
        Curve("empirical, published", v, force(row["empirical"], v), "empirical"),
        Curve("free running or decay, published", v, force(row["free_running"], v), "published"),
        _corrected(axis, v),
    ]
    if "towing" in row:
        curves.append(Curve("towing", v, force(row["towing"], v), "towing"))
    speed, unit = ("m/s", "N") if axis in FASTEST else ("rad/s", "N m")
    return Panel(axis.capitalize(), f"Speed [{speed}]", f"Damping [{unit}]", tuple(curves))
