"""What is known of the parameters before any test: values of the file, widths, and what errors have in common.

The prior is Gaussian in theta, so log-normal for what is positive. Errors of one kind share a cause (a drag formula, a
supply voltage, the water inside the hulls), so that widths of a kind are correlated: without that, many parameters
together would pretend to know the common scale of all forces, which no motion can tell.
"""

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.config import near
from rovtwin.identification.joint.model.couplings import BOTH_WAYS, SKEW
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import INFLOW, Parameters
from rovtwin.identification.priors.widths import prior_widths
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.analysis.stability import steady_speed
from rovtwin.vehicle.physics.actuation import wrench_limits

# Standard deviation of theta by pattern, of what `widths` (added mass, damping) does not know.
WIDTHS: dict[str, float] = {
    **{f"added_mass.{name}": 0.02 for name in SKEW},
    "added_mass.*_*": 0.1,  # couplings, as shares: a centre some centimetres off
    **{f"*_damping.{name}": 0.03 for name, at in BOTH_WAYS.items() if min(at) > 2},
    "*_damping.*_*": 0.1,
    "restoring.metacentric_height": 0.5,
    "restoring.center_of_buoyancy_*": 0.003,  # [m]
    "restoring.net_buoyancy": 2.0,  # [N]
    "thrusters.*.force_*": 0.15,
    "thrusters.*.exponent": 0.35,
    "thrusters.*.dead_band": 1.0,
    "thrusters.*.time_constant": 0.5,
    "tether.drag": 0.7,
    "sensors.*.delay": 0.02,  # [s], of one clock or protocol against another, beyond what the log says
    "sensors.gyro.*": 0.02,  # [rad], of a bracket or a board in its housing
    "commands.delay": 0.03,  # [s], of a link and of motor controllers, beyond what the log says
}
# Share of the variance that parameters of one kind have in common.
COMMON: dict[str, float] = {
    "added_mass.*_*": 0.0,  # before the diagonals, the first pattern that fits counts
    "*_damping.*_*": 0.0,
    "added_mass.*": 0.5,
    "linear_damping*": 0.5,
    "quadratic_damping*": 0.5,
    "thrusters.*.force_*": 0.7,
    "thrusters.*.exponent": 0.5,
}
LOST = 0.3  # share of the thrust at top speed, one standard deviation
_SLOWEST, _FASTEST = 0.1, 5.0  # top speeds that are plausible [m/s]
_WAYS = ("value", "sd", "factor", "common")


def default_prior(parameters: Parameters, vehicle: Vehicle, stated: Mapping[str, Any] | None = None) -> Gaussian:
    """Prior around the starting values.

    Args:
        parameters: Free ones.
        vehicle: How good its parts' numbers are, see `widths.prior_widths`.
        stated: By pattern of names, in place of the defaults: `{factor: 2}` is one standard deviation of a factor of
            two (of those that are positive), `{sd: 0.3}` one in the parameter's unit, `{value: 20, sd: 0.4}` moves the
            middle too; `common: 0.9` beside them is the share of their variance that the parameters of the pattern
            have in common.

    Raises:
        IdentificationError: A pattern fits nothing, or a width is not positive.
    """
    names = parameters.names
    mean = np.zeros(len(names))
    known = prior_widths(vehicle) | _inflow_widths(parameters)
    width = np.array([known.get(ahead, 0.0) or _width(ahead) for ahead in (n.replace("_astern.", ".") for n in names)])
    kind = np.array([_kind(name) for name in names], dtype=object)
    shares = dict(COMMON)
    for pattern, words in (stated or {}).items():
        rows = [i for i, name in enumerate(names) if fnmatchcase(name, pattern)]
        if not rows:
            raise IdentificationError(f"prior: '{pattern}' fits no free parameter.{near(pattern, names)}")
        if isinstance(words, Mapping) and "factor" in words:
            # A coupling has a sign; a pattern for its whole family does not mean it.
            rows = [i for i in rows if parameters.free[i].positive] or rows
        for i in rows:
            mean[i], width[i] = _stated(parameters.free[i], pattern, words, width[i])
            kind[i] = pattern  # what somebody states has errors of its own
        shares[pattern] = words.get("common", 0.0)
    correlation = np.eye(len(names))
    for pattern, share in shares.items():
        same = np.flatnonzero(kind == pattern)
        correlation[np.ix_(same, same)] = share
    np.fill_diagonal(correlation, 1.0)
    return Gaussian(mean, correlation * np.outer(width, width))


def _inflow_widths(parameters: Parameters) -> dict[str, float]:
    """Of what an inflow takes of the thrust [s/m], by name.

    At top speed a propeller that suits its vehicle has lost a fifth to a half of its pull (thrust falls about linearly
    with the advance speed: van Lammeren et al. 1969, The Wageningen B-screw series).
    """
    return {
        f"thrusters.{group}.{INFLOW}": LOST / top_speed(parameters.model, members)
        for group, members in parameters.groups.items()
    }


def top_speed(model: Model, thrusters: Sequence[int]) -> float:
    """Of the vehicle in the direction in which these thrusters push most [m/s]; within what vehicles reach."""
    T, (low, high) = np.asarray(model.thrusters.configuration), wrench_limits(model.thrusters)
    axis = int(np.abs(T[:3, list(thrusters)]).sum(axis=1).argmax())
    top = max(steady_speed(model, axis, float(low[axis])), steady_speed(model, axis, float(high[axis])))
    return min(max(top, _SLOWEST), _FASTEST)


def _width(name: str) -> float:
    return next(width for pattern, width in WIDTHS.items() if fnmatchcase(name, pattern))


def _kind(name: str) -> str:
    return next((pattern for pattern in COMMON if fnmatchcase(name.replace("_astern.", "."), pattern)), "")


def _stated(parameter: Any, pattern: str, words: Any, width: float) -> tuple[float, float]:
    where = f"prior: {pattern}"
    if not isinstance(words, Mapping) or not words or set(words) - set(_WAYS):
        raise IdentificationError(
            f"{where}: found {words!r}, expected {{factor: 2}}, {{sd: 0.3}} or {{value: .., sd: ..}}"
        )
    for key, value in words.items():
        if not isinstance(value, int | float) or isinstance(value, bool) or not np.isfinite(value):
            raise IdentificationError(f"{where}.{key}: found {value!r}, expected a number")
    if not 0 <= words.get("common", 0.0) < 1:
        raise IdentificationError(f"{where}.common: found {words['common']:g}, expected a share from 0 to below 1")
    value = float(words.get("value", parameter.base))
    mean = parameter.theta(value)
    if "factor" in words:
        if words["factor"] <= 1 or not parameter.positive:
            raise IdentificationError(f"{where}.factor: expected more than 1, of a parameter that is positive")
        return mean, float(np.log(words["factor"]))
    if "sd" in words:
        if words["sd"] <= 0:
            raise IdentificationError(
                f"{where}.sd: found {words['sd']:g}, expected more than 0; leave it out of 'free'"
            )
        return mean, float(words["sd"]) / parameter.slope(value)
    return mean, width
