"""Free running: surge, sway, heave and yaw damping (tables 3.3 to 3.6), and the searches for added mass."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.identification.known import Known
from rovtwin.identification.steady.damping_fit import DampingFit, fit_damping
from rovtwin.identification.steady.nsga import is_on_bound
from rovtwin.identification.steady.thrust import shape
from rovtwin.identification.steady.thrust_damping import JointFit, ThrustPrior, fit_thrust_and_damping
from rovtwin.identification.thesis.found import Curve, Line, Panel, Section, half_digit, printed, sentence
from rovtwin.identification.thesis.parts import linear_of_parts
from rovtwin.vehicle.constants import COEFFICIENT_UNITS

SHARE_KNOWN = 0.02  # a bollard pull: width of the full thrust
EXPONENT = Known(1.75, 0.125)  # 1.5 to 2, as T200s in bollard tests
PIONEER_CURVE = (0.07, 1.33)  # dead band and exponent of blueye_pioneer.yaml: T200 at 16 V, full force held


def rows(name: str) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Commands, forces and speeds of a table."""
    command, force, speed = np.array(printed("free_running")[name]["rows"], float).T
    return command, force, speed


def as_printed(name: str) -> Float[np.ndarray, "2"]:
    """D_L and D_NL from the table by (2.32), both not negative."""
    _, force, speed = rows(name)
    return fit_damping(speed, force).coefficients


def rounding(name: str) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lowest and highest (D_L, D_NL) that the rounding of the printed speeds allows, first order."""
    _, force, speed = rows(name)
    middle = fit_damping(speed, force, nonnegative=False).coefficients
    reach = np.zeros(2)
    for i, value in enumerate(speed):
        moved = speed.copy()
        moved[i] += half_digit(value)
        reach += np.abs(fit_damping(moved, force, nonnegative=False).coefficients - middle)
    return middle - reach, middle + reach


def full(name: str) -> Known:
    """Force [N] or moment [N m] at full command."""
    data = printed("free_running")
    value = 2 * data["yaw_force"] * data["yaw_arm"] if name == "yaw" else data["thrust"][name]
    return Known(float(value), SHARE_KNOWN * float(value))


def bent(name: str) -> JointFit:
    """Thrust curve and damping together, from the same commands and speeds."""
    command, _, speed = rows(name)
    # The first turn in yaw is as fast as the second at half its moment: not a steady turn under that moment.
    keep = command > (0.3 if name == "yaw" else 0.0)
    return fit_thrust_and_damping(command[keep], speed[keep], ThrustPrior(full(name), EXPONENT), source=name)


def bent_heave() -> tuple[DampingFit, Float[np.ndarray, "2"]]:
    """Heave damping with the thrust and the buoyancy it holds from a curve; deviations with those of the exponent."""
    floats_at = printed("free_running")["heave"]["floats_at"]
    command, _, speed = rows("heave")
    fits = []
    for exponent in EXPONENT.value + EXPONENT.sd * np.array([-1.0, 0.0, 1.0]):
        share = shape(command, 0.0, exponent) - shape(floats_at, 0.0, exponent)
        fits.append(fit_damping(speed, full("heave").value * share))
    by_exponent = (fits[2].coefficients - fits[0].coefficients) / 2
    return fits[1], np.sqrt(fits[1].std ** 2 + by_exponent**2)


def yaw_of_library() -> tuple[float, float]:
    """Linear yaw damping of the parts, held, and the quadratic one with the thrust curve of the library's Pioneer."""
    command, _, r = rows("yaw")
    keep = command > 0.3
    linear, r = float(linear_of_parts()[5]), r[keep]
    moment = full("yaw").value * shape(command[keep], *PIONEER_CURVE)
    return linear, float(r**2 @ (moment - linear * r) / np.sum(r**4))


def rms(error: Float[np.ndarray, " n"]) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(error**2)))


def towed(name: str, speed: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """The thesis's own towing, ahead [N], at speeds [m/s]."""
    linear, quadratic = printed("comparison")["towing"][name]["ahead"]
    return linear * speed + quadratic * speed**2


def _pair(
    name: str, corrected: Float[np.ndarray, "2"], sd: Float[np.ndarray, "2"], reasons: Sequence[str]
) -> list[Line]:
    data = printed("free_running")[name]
    published, derived = data["published"], as_printed(name)
    where = f"{published['where']}, table {data['table']}"
    return [
        Line(
            f"{name}, {word} damping",
            COEFFICIENT_UNITS[f"{word}_damping"][name == "yaw"],
            where,
            float(published[word]),
            float(derived[i]),
            float(corrected[i]),
            float(sd[i]),
            reasons[i],
        )
        for i, word in enumerate(("linear", "quadratic"))
    ]


def _heave_reasons() -> tuple[str, str]:
    (low, high), (_, quadratic) = rounding("heave"), as_printed("heave")
    drag = quadratic / (500.0 * printed("comparison")["geometry"]["areas"][2])
    return sentence("heave_linear", low=low[0], high=high[0]), sentence(
        "heave_quadratic", low=low[1], high=high[1], drag=drag
    )


def damping_section() -> Section:
    """Tables 3.3 to 3.6."""
    fits = {name: bent(name) for name in ("surge", "sway", "yaw")}
    heave, heave_sd = bent_heave()
    low, high = rounding("surge")
    _, force, speed = rows("sway")
    reasons = {
        "surge": [sentence(f"surge_{w}", low=low[i], high=high[i]) for i, w in enumerate(("linear", "quadratic"))],
        "sway": [
            sentence("sway_linear", low=(force / speed).min(), high=(force / speed).max()),
            sentence("sway_quadratic"),
        ],
        "yaw": [sentence("yaw_linear"), sentence("yaw_quadratic")],
    }
    pairs = {name: _pair(name, fit.damping, fit.sd[:2], reasons[name]) for name, fit in fits.items()}
    pairs["heave"] = _pair("heave", heave.coefficients, heave_sd, _heave_reasons())
    order = ("surge", "sway", "heave", "yaw")
    linear, quadratic = yaw_of_library()
    library = Line(
        "yaw, quadratic damping, library",
        COEFFICIENT_UNITS["quadratic_damping"][1],
        "table 3.6",
        None,
        None,
        quadratic,
        None,
        sentence("yaw_library", linear=linear),
    )
    lines = (*(line for name in order for line in pairs[name]), library)
    panels = tuple(_panel(name, fits.get(name, heave)) for name in order)
    return Section("free_running", "Free running: damping (tables 3.3 to 3.6)", lines, _remarks(fits), panels)


def _remarks(fits: dict[str, JointFit]) -> tuple[str, ...]:
    command, _, speed = rows("surge")
    fit, drag, most = fits["surge"], towed("surge", speed), full("surge").value
    _, force, sway_speed = rows("sway")
    surge = sentence(
        "surge_towing",
        linear=rms(most * command - drag),
        bent=rms(most * command**1.75 - drag),
        exponent=fit.thrust[2],
        sd=fit.sd[4],
        thrust=rms(fit.force(command) - drag),
        drag=rms(fit.drag(speed) - drag),
    )
    sway = sentence(
        "sway_towing",
        before=rms(force - towed("sway", sway_speed)),
        after=rms(fits["sway"].drag(sway_speed) - towed("sway", sway_speed)),
    )
    return surge, sway, sentence("widths")


def _panel(name: str, fit: JointFit | DampingFit) -> Panel:
    command, force, speed = rows(name)
    data = printed("free_running")[name]
    published, (force_unit, speed_unit) = data["published"], data["unit"]
    v = np.linspace(0, 1.15 * speed.max(), 60)
    curves = [
        Curve("published", v, published["linear"] * v + published["quadratic"] * v**2, "published"),
        Curve("least squares of the table", v, fit_damping(speed, force).force(v), "derived"),
        Curve("runs, thrust linear in command", speed, force, "data"),
    ]
    if isinstance(fit, JointFit):
        curves.append(Curve("corrected, thrust curve free", v, fit.drag(v), "corrected", fit.drag_sd(v)))
        curves.append(Curve("runs, thrust curve found", speed, fit.force(command), "corrected_data"))
    else:
        curves.append(Curve("corrected, thrust curve free", v, fit.force(v), "corrected"))
    if name in printed("comparison")["towing"]:
        curves.append(Curve("towing", v, towed(name, v), "towing"))
    return Panel(name.capitalize(), f"Speed [{speed_unit}]", f"Damping [{force_unit}]", tuple(curves))


def added_mass_section() -> Section:
    """The NSGA-II searches (3.12) and (3.23), as far as the thesis prints what they rest on."""
    data = printed("free_running")
    heave, yaw, damping = data["nsga"]["heave"], data["nsga"]["yaw"], data["heave"]["published"]
    low, high = heave["bounds"]
    speed = float(rows("heave")[2][-1])
    needed = damping["linear"] * speed + damping["quadratic"] * speed**2
    reached = float(np.roots([damping["quadratic"], damping["linear"], -low]).max())
    place = "on the bound" if is_on_bound(heave["thrust"], low, high) else "within the bounds"
    why = sentence("heave_thrust", place=place, low=low, high=high, speed=speed, needed=needed, reached=reached)
    lines = (
        Line("heave, thrust of the search", "N", heave["where"], heave["thrust"], needed, reason=why),
        Line("heave, added mass", "kg", heave["where"], heave["added_mass"], reason=sentence("heave_added")),
        Line("yaw, added inertia", "kg m2", yaw["where"], yaw["added_mass"], yaw["total"] - yaw["inertia"],
             reason=sentence("yaw_added")),
    )  # fmt: skip
    return Section("added_mass", "Free running: added mass by NSGA-II ((3.11), (3.12), (3.23))", lines)
