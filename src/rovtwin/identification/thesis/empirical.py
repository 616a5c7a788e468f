"""The empirical method, (3.3) to (3.5)."""

import numpy as np

from rovtwin.identification.priors.empirical import Published, against_thesis
from rovtwin.identification.thesis.comparison import FASTEST, force
from rovtwin.identification.thesis.found import Line, Section, printed, sentence
from rovtwin.vehicle.constants import COEFFICIENT_UNITS

WORDS = {"added_mass": "added mass", "quadratic_damping": "quadratic damping", "linear_damping": "linear damping"}
ROTATIONS = ("roll", "pitch", "yaw")


def empirical_section() -> Section:
    """(3.3) to (3.5) beside what the method gives for the box of table 5.1."""
    lines = tuple(
        Line(
            f"{one.axis}, {WORDS[one.quantity]}",
            COEFFICIENT_UNITS[one.quantity][one.axis in ROTATIONS],
            one.equation,
            one.printed,
            one.computed,
            reason=_reason(one),
        )
        for one in against_thesis()
    )
    title = "Empirical method of Eidsvik ((3.3) to (3.5))"
    remarks = (sentence("empirical_prior", **_towing_over_empirical()), sentence("empirical_panels"))
    return Section("empirical", title, lines, remarks)


def _towing_over_empirical() -> dict[str, float]:
    """Ratio of the dampings in table 4.2 at the fastest free-running speed."""
    table = printed("comparison")["table_4_2"]
    ratios = {}
    for axis, fastest in FASTEST.items():
        v = np.array([fastest])
        ratios[axis] = float((force(table[axis]["towing"], v) / force(table[axis]["empirical"], v))[0])
    return ratios


def _reason(one: Published) -> str:
    if one.follows:
        return ""
    if abs(one.computed / one.printed - 1) < 0.01:
        return sentence("empirical_nearly")
    if one.quantity == "added_mass":
        return sentence("empirical_added", printed=one.printed, computed=one.computed)
    if one.quantity == "linear_damping":
        return sentence("empirical_linear")
    return sentence("empirical_quadratic")
