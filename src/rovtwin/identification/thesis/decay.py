"""Roll and pitch decay, (3.13) to (3.20)."""

import numpy as np

from rovtwin.identification.decay.linear import from_rest, inertia_and_damping
from rovtwin.identification.decay.motion import swing
from rovtwin.identification.thesis.found import Curve, Line, Panel, Section, printed, sentence
from rovtwin.identification.thesis.parts import quadratic_of_parts

PLACES = {"roll": 3, "pitch": 4}


def corrected(axis: str) -> tuple[float, float, float, float]:
    """Added inertia [kg m2] and linear damping [N m s/rad] with phase and gravity, k/J [1/s2] and D_L/J [1/s].

    The stiffness is that of the library's BG, the quadratic damping that of the parts.
    """
    data = printed("decay")
    one = data[axis]
    k = one["weight"] * data["gravity"] * data["library_metacentric_height"]
    quadratic = quadratic_of_parts()[PLACES[axis]] / k
    c, b = from_rest(np.radians(one["angle_deg"]), one["half_b"], one["omega"], quadratic)
    return k / c - data["library_inertia"][axis], b * k / c, c, b


def as_printed(axis: str, gravity: float = 1.0) -> tuple[float, float]:
    """Added inertia and damping by (2.28) and (2.29); the thesis leaves out gravity."""
    one = printed("decay")[axis]
    J, D = inertia_and_damping(one["half_b"], one["omega"], one["weight"] * one["metacentric_height"] * gravity)
    return J - one["inertia"], D


def _gravity(axis: str, c: float) -> str:
    data = printed("decay")
    one, panel = data[axis], data["panel_added"][axis]
    added, damping = as_printed(axis, data["gravity"])
    needed = c * (data["library_inertia"][axis] + panel) / (one["weight"] * data["gravity"])
    return sentence("gravity", added=added, damping=damping, panel=panel, needed=needed)


def _phase(axis: str) -> str:
    one = printed("decay")[axis]
    half_b, omega = one["half_b"], one["omega"]
    c, b = from_rest(np.radians(one["angle_deg"]), half_b, omega)
    J, D = inertia_and_damping(half_b, omega, 1.0)
    return sentence(
        "phase",
        phase=np.degrees(np.arctan2(half_b, omega)),
        inertia=100 * (J * c - 1),
        damping=100 * (D * c / b - 1),
    )


def _lines(axis: str) -> list[Line]:
    one = printed("decay")[axis]
    published = one["published"]
    added, damping, c, _ = corrected(axis)
    printed_added, printed_damping = as_printed(axis)
    ratio = one["omega"] ** 2 + one["half_b"] ** 2
    return [
        Line(f"{axis}, added inertia", "kg m2", published["added_where"], published["added"], printed_added, added,
             reason=_gravity(axis, c)),
        Line(f"{axis}, linear damping", "N m s/rad", published["damping_where"], published["damping"], printed_damping,
             damping, reason=_phase(axis)),
        Line(f"{axis}, stiffness over inertia", "1/s2", one["where"], None, ratio, c, reason=sentence("ratio")),
    ]  # fmt: skip


def _panel(axis: str) -> Panel:
    data = printed("decay")
    one = data[axis]
    t = np.linspace(0, 10, 300)
    k = one["weight"] * data["gravity"] * data["library_metacentric_height"]
    _, _, c, b = corrected(axis)
    a = quadratic_of_parts()[PLACES[axis]] / k * c
    curve = one["angle_deg"] * np.exp(-one["half_b"] * t) * np.cos(one["omega"] * t)
    free = np.degrees(swing(t, (float(np.radians(one["angle_deg"])), 0.0), c, b, a, 0.02))
    curves = (
        Curve("published fit: no phase, leaves with a jerk", t, curve, "published"),
        Curve("the release from rest behind it", t, free, "corrected"),
    )
    return Panel(f"{axis.capitalize()} {one['where']}", "Time [s]", "Angle [deg]", curves)


def decay_section() -> Section:
    """(3.13) to (3.20)."""
    lines = tuple(line for axis in PLACES for line in _lines(axis))
    remarks = (sentence("decay_rounding"), sentence("decay_inertia"), sentence("decay_forward"))
    return Section("decay", "Decay: roll and pitch ((3.13) to (3.20))", lines, remarks, tuple(map(_panel, PLACES)))
