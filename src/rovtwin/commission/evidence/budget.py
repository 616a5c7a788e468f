"""Uncertainty budget of damping forces and thrust, in the form of the GUM (JCGM 100:2008).

With A = A_readings + A_pulls + A_prior the information behind an estimate and C_0 its inverse, the variance of a
quantity with derivatives g splits without rest,

    g' C_0 g = sum_e g' C_0 A_e C_0 g,

a term for each kind of evidence. Readings are type A; pulls on a scale and what was known before are type B. What the
stated covariance has beyond C_0 (stretches of the tests that disagree, effects that the equations leave out) comes from
the readings, too. Places of sensors and the water's density are type B beside it: nothing in the fit shows them.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.commission.evidence.forces import COVERAGE, Quantity
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import as_array, jax, jnp

PLACE = 0.01  # standard deviation of where a position or depth sensor sits, each axis [m]: what a ruler does
DENSITY, UNSTATED = 1.2, 7.5  # standard deviation of the water's density [kg/m3]: +-2 of one that was stated, +-13 else
_TINY = 1e-3  # of a metre by which readings are moved: none becomes an outlier by it
_PLACED = ("position", "horizontal", "depth")

_rotations = jax.jit(jax.vmap(jax.vmap(rotation_from_quaternion)))


def budget(result: Any, quantities: Sequence[Quantity], anchors: Sequence[Any] = ()) -> list[dict[str, Any]]:
    """A budget for each quantity: contributions as standard deviations, combined and expanded (k = 2).

    Args:
        result: An `Identification` with its problem.
        quantities: Of it.
        anchors: With which it was made.
    """
    if result.problem is None or result.solution is None:
        return []
    C, evidence = _evidence(result, bool(anchors))
    places = _place_response(result)
    return [_budget(one, result, C, evidence, places) for one in quantities]


def _budget(
    one: Quantity,
    result: Any,
    C: Float[np.ndarray, "n n"],
    evidence: list[tuple[str, str, Float[np.ndarray, "n n"]]],
    places: Float[np.ndarray, "n k"],
) -> dict[str, Any]:
    by_all = C @ one.slope
    rows = [(name, kind, float(by_all @ A @ by_all)) for name, kind, A in evidence]
    stated = one.slope @ result.covariance @ one.slope
    rows.append(
        ("tests disagree among themselves; effects that the equations leave out", "A", stated - one.slope @ by_all)
    )
    rows.append(
        (f"places of position and depth sensors, {1e3 * PLACE:g} mm", "B", float(np.sum((one.slope @ places) ** 2)))
    )
    if one.what == "damping":
        share, words = _density(result)
        rows.append((words, "B", (share * one.value) ** 2))
    variances = [max(variance, 0.0) for _, _, variance in rows]
    combined = float(np.sqrt(sum(variances)))
    return {
        "quantity": _name(one),
        "value": one.value,
        "unit": one.unit,
        "contributions": [
            {"source": name, "type": kind, "std": float(np.sqrt(variance))}
            for (name, kind, _), variance in zip(rows, variances, strict=True)
        ],
        "combined_std": combined,
        "coverage_factor": COVERAGE,
        "expanded": COVERAGE * combined,
        "expanded_share": COVERAGE * combined / max(abs(one.value), 1e-12),
    }


def _name(one: Quantity) -> str:
    if one.what == "thrust":
        return f"thrust of all in {one.axis} at full command"
    return f"damping in {one.axis} at {one.at:+.3g} {'m/s' if one.unit == 'N' else 'rad/s'}"


def _evidence(
    result: Any, pulled: bool
) -> tuple[Float[np.ndarray, "n n"], list[tuple[str, str, Float[np.ndarray, "n n"]]]]:
    """C_0 and the information of each kind of evidence: name, type, matrix of shape (n, n)."""
    solution, problem = result.solution, result.problem
    before = problem.information
    pulls = problem.static_information(solution.unknowns.theta) - before
    readings = solution.information - pulls
    rows = [("readings of this test", "A", readings), ("known before: parts, formulas, earlier tests", "B", before)]
    if pulled:
        rows.append(("reading of the scale", "B", pulls))
    return np.linalg.inv(solution.information + before), rows


def _density(result: Any) -> tuple[float, str]:
    """Standard deviation as a share, and whose it is: drag is proportional to it."""
    stated = [r.water_density for r in result.problem.segments.records]
    std = DENSITY if all(stated) else UNSTATED
    density = stated[0] or 1000.0 if stated else 1000.0
    words = (
        f"density of the water, {std:g} kg/m3" if all(stated) else f"density of the water, not stated, {std:g} kg/m3"
    )
    return std / density, words


def _place_response(result: Any) -> Float[np.ndarray, "n k"]:
    """Change of theta by PLACE along each axis of b for each sensor that tells places, shape (n, 3 times sensors)."""
    problem, solution = result.problem, result.solution
    segments, unknowns, n = problem.segments, solution.unknowns, len(result.theta)
    path = problem.shooting.trajectories(as_array(unknowns.theta), unknowns.nodes, segments.arrays)
    attitude = np.asarray(path.attitude)

    def step(arrays: dict[str, Any]) -> Float[np.ndarray, " n"]:
        blocks = problem.blocks(unknowns, solution.noise, replace(segments, arrays=arrays))
        return problem.assembled(blocks, unknowns, solution.noise).factor().border()[:n]

    here, columns = step(segments.arrays), []
    for name in set(_PLACED) & set(segments.levers):
        own = segments.arrays[name]
        q = np.take_along_axis(attitude, np.asarray(own["row"])[..., None], axis=1)
        R_nb = np.asarray(_rotations(jnp.asarray(q)))
        rows = {"position": slice(0, 3), "horizontal": slice(0, 2), "depth": slice(2, 3)}[name]
        for axis in range(3):
            value = np.asarray(own["value"]) + _TINY * R_nb[..., rows, axis]
            columns.append((step(segments.arrays | {name: own | {"value": value}}) - here) * (PLACE / _TINY))
    return np.stack(columns, axis=1) if columns else np.zeros((n, 1))
