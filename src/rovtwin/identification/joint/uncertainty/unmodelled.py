"""What the equations leave out although it is known of: do tests speak of it, and how far does it move the estimate?

An effect c adds a load c w(t) along the estimated path. With J_c the residuals' derivative by its size c, r the
whitened residuals and everything else at its best, the tests know it with the information A_c = J_c' (I - P) J_c and
want the size -J_c' r / (A_c + 1 / s^2), s what is known of it beforehand: a score test (Rao 1948) in a direction that
physics names. An estimate without it is off by d(theta)/dc times c, so that its covariance grows by

    E[c^2] (d theta / dc) (d theta / dc)',    E[c^2] = mean^2 + variance of c.

The estimate itself is not moved: what it is used for is a model without the effect. Where tests show that there is
none, nothing grows.

Effects: drag that comes late, apart for translation and rotation (a wake takes about a hull's length to follow, here at
top speed: Sarpkaya and Garrison 1963, Vortex formation and resistance in unsteady flow; Mougin and Magnaudet 2002);
thrust that an inflow takes in proportion to the force (van Lammeren et al. 1969, The Wageningen B-screw series). Where
the model has such a loss, to the root of the force, what is looked for is the other law; and a tether that nobody
stated, which pulls against the whole velocity, and so ties the directions together as no drag of the hull does.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped
from scipy.spatial.transform import Rotation

from rovtwin.core.numerics import as_array, jnp
from rovtwin.identification.joint.model.loads import thrust_history
from rovtwin.identification.joint.model.nodes import NODE, Nodes
from rovtwin.identification.joint.model.parameters import INFLOW
from rovtwin.identification.joint.model.prior import LOST, top_speed
from rovtwin.identification.joint.solver.arrow import Arrow
from rovtwin.identification.joint.solver.problem import Noise, Problem, Unknowns
from rovtwin.identification.joint.solver.segments import Segments
from rovtwin.vehicle.constants import FRESH_WATER
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import inflow_damping

LATE = 0.3  # share of the quadratic drag that comes late, one standard deviation
# Drag of a tether that is not stated, of the hull's along surge, one standard deviation: 10 m of 8 mm across the flow
# (C_D 1.2) are 48 N s2/m2, a third of those of the Double Blueye and the BlueROV2 Heavy.
TETHER = 0.3
HULL = 2.0  # length of a hull in cube roots of its volume
_WHOLE = 0.95  # share of a value that an estimate may be off by: beyond, it says nothing from below
_MOST = 0.8  # share of a loss that the other law may lack at the forces of the tests: they were a 25th of the full one
_DRAG = "of the quadratic drag"
OTHER_LAW = "a loss to the inflow in proportion to the force and not to its root"
_TRANSLATION = np.arange(6) < 3


@dataclass(frozen=True, eq=False)
class Effects:
    """C effects that are left out; none where nothing was looked for.

    Attributes:
        names: Of them.
        units: Of their sizes.
        size: As the tests and what is known beforehand have it.
        covariance: Of the size.
        shift: How theta moves with the size.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    size: Float[np.ndarray, " C"]
    covariance: Float[np.ndarray, "C C"]
    shift: Float[np.ndarray, "n C"]

    @classmethod
    def none(cls, n: int) -> "Effects":
        """Of n parameters."""
        return cls((), (), np.zeros(0), np.zeros((0, 0)), np.zeros((n, 0)))

    @property
    def std(self) -> Float[np.ndarray, " C"]:
        """Of the size."""
        return np.sqrt(np.diag(self.covariance))

    def of_theta(self, bound: Float[np.ndarray, " n"], positive: Bool[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
        """What comes to the covariance of theta.

        Loads are linear in a parameter's value, theta is the logarithm of one that is `positive`: a value that is off
        by a share s of itself is off by log(1 - s) downwards.

        Args:
            bound: No variance grows by more.
            positive: Whether theta is a logarithm.
        """
        found = self.shift @ (np.outer(self.size, self.size) + self.covariance) @ self.shift.T
        off = np.maximum(np.sqrt(np.diag(found)), 1e-150)
        reach = np.where(positive, -np.log1p(-np.minimum(off, _WHOLE)), off)
        grown = np.minimum(np.maximum(reach, off), np.sqrt(bound)) / off
        return found * np.outer(grown, grown)


class _Load(NamedTuple):
    """An effect: what it is called, the unit of its size, its load at size 1, and its standard deviation beforehand."""

    name: str
    unit: str
    at_grid: Float[np.ndarray, "S points 6"]
    expected: float


def effects(problem: Problem, here: Unknowns, noise: Noise, arrow: Arrow, wider: float = 1.0) -> Effects:
    """What is left out of the model, at the estimate `here` with its normal equations; `wider` as in `known_of`."""
    model, extras = problem.shooting.parameters.model_at(as_array(here.theta))
    nu_r = _through_water(problem, here)
    late = _late_drag(problem, model, nu_r)
    found = [
        _Load("drag in translation that comes late", _DRAG, late * _TRANSLATION, LATE),
        _Load("drag in rotation that comes late", _DRAG, late * ~_TRANSLATION, LATE),
        _lost_thrust(problem, model, extras.delay, nu_r),
        *_tether(problem, model, nu_r),
    ]
    loads, expected = np.stack([load.at_grid for load in found], axis=-1), np.array([load.expected for load in found])
    size, covariance, shift = known_of(problem, here, noise, arrow, loads, expected, wider)
    for c, load in enumerate(found):
        if load.name == OTHER_LAW:
            shift[:, c] = _at_full_force(problem, here.theta, shift[:, c])
    return Effects(tuple(x.name for x in found), tuple(x.unit for x in found), size, covariance, shift)


def known_of(
    problem: Problem,
    here: Unknowns,
    noise: Noise,
    arrow: Arrow,
    loads: Float[np.ndarray, "S points 6 C"],
    expected: Float[np.ndarray, " C"],
    wider: float = 1.0,
) -> tuple[Float[np.ndarray, " C"], Float[np.ndarray, "C C"], Float[np.ndarray, "n C"]]:
    """Sizes of C effects, their covariance, and how theta moves with them.

    Args:
        problem: The readings.
        here: The estimate.
        noise: As estimated.
        arrow: The normal equations there.
        loads: Of effects of size 1 at grid points.
        expected: Standard deviations of the sizes beforehand.
        wider: By how much widths of white residuals are too small, see `agreement`.
    """
    cross, own, slope = _normal_equations(problem, here, noise, expected * loads)
    solved = []
    for nodes, corner in cross:
        factored = replace(arrow, b=nodes, b_corner=corner).factor()
        theta = factored.border()
        solved.append((factored.nodes(theta), theta))
    shared = np.array([[np.sum(b * x) + c @ y for x, y in solved] for b, c in cross])
    # Beforehand it is 1, in what is expected.
    information = (own - 0.5 * (shared + shared.T)) / wider**2 + np.eye(len(expected))
    covariance = np.linalg.inv(information)
    shift = -np.stack([y for _, y in solved], axis=-1)[: len(here.theta)]
    size = -expected * (covariance @ slope) / wider**2
    return size, np.outer(expected, expected) * covariance, shift / expected


def _normal_equations(
    problem: Problem, here: Unknowns, noise: Noise, loads: Float[np.ndarray, "S points 6 C"]
) -> tuple[
    list[tuple[Float[np.ndarray, "S _"], Float[np.ndarray, " m"]]], Float[np.ndarray, "C C"], Float[np.ndarray, " C"]
]:
    """J'J_c of nodes and of the corner for each effect, J_c'J_c, shape (C, C), and J_c'r, shape (C,), all whitened."""
    blocks = problem.blocks(here, noise, _with_effects(problem.segments, loads))
    n, m, weight = len(here.theta), blocks.slopes.shape[-1], noise.sigma**-2.0
    readings = np.einsum("g,sgac->sac", weight, blocks.effects.readings)
    J, J_c = (x / noise.defect[:, None] for x in (blocks.defect_jacobian, blocks.effects.defect_jacobian))
    at_defects = np.swapaxes(J, 1, 2) @ J_c
    nodes, corner = readings[:, :NODE] + at_defects[:, :NODE], readings[:, NODE:m].sum(axis=0)
    nodes[1:] += at_defects[:-1, NODE + n :]
    corner[:n] += at_defects[:, NODE : NODE + n].sum(axis=0)
    own = readings[:, m:].sum(axis=0) + np.einsum("sic,sid->cd", J_c, J_c)
    slope = np.einsum("g,sgc->c", weight, blocks.effects.slopes)
    slope += np.einsum("sic,si->c", J_c, blocks.defect / noise.defect)
    return [(nodes[..., c], corner[:, c]) for c in range(loads.shape[-1])], own, slope


def _with_effects(segments: Segments, loads: Float[np.ndarray, "S points 6 C"]) -> Segments:
    """Segments with loads at grid points (S, K + 1, 6, C) [N, N m] as effects."""
    middle = 0.5 * (loads[:, :-1] + loads[:, 1:])
    at = np.stack([loads[:, :-1], middle, loads[:, 1:]], axis=2)
    return replace(segments, arrays=segments.arrays | {"effects": at})


def _through_water(problem: Problem, here: Unknowns) -> Float[np.ndarray, "S points 6"]:
    """nu_r of the estimated path at grid points."""
    arrays = problem.segments.arrays
    path: Nodes = problem.shooting.trajectories(as_array(here.theta), here.nodes, arrays)
    S, K = path.nu.shape[:2]
    R = Rotation.from_quat(np.asarray(path.attitude).reshape(-1, 4), scalar_first=True)
    flow = R.inv().apply(np.repeat(np.asarray(arrays["current"]), K, axis=0)).reshape(S, K, 3)
    nu_r = np.array(path.nu)
    nu_r[..., :3] -= flow
    return nu_r


def _length(model: Model) -> float:
    return HULL * float(np.cbrt(np.asarray(model.displaced_mass) / FRESH_WATER))


def _late_drag(
    problem: Problem, model: Model, nu_r: Float[np.ndarray, "S points 6"]
) -> Float[np.ndarray, "S points 6"]:
    """What of the quadratic drag is missing while the wake follows [N, N m]: along nu_r."""
    grid, arrays = problem.segments.grid, problem.segments.arrays
    length = _length(model)
    speed = top_speed(model, range(model.thrusters.count))
    keep = np.exp(-grid.step * speed / length)
    square = nu_r * np.abs(nu_r)
    late, now = np.empty_like(square), square[0, 0]
    for s in range(len(square)):
        now = square[s, 0] if np.asarray(arrays["fresh"])[s, 0] > 0 else now
        for k in range(square.shape[1]):
            late[s, k] = now
            if k + 1 < square.shape[1]:
                now = square[s, k + 1] + keep * (now - square[s, k + 1])
    drag = np.where(
        nu_r >= 0,
        *(np.diagonal(np.asarray(d)) for d in (model.quadratic_damping_ahead, model.quadratic_damping_astern)),
    )
    return drag * (square - late)


def _tether(problem: Problem, model: Model, nu_r: Float[np.ndarray, "S points 6"]) -> list[_Load]:
    """The pull of a tether with the hull's quadratic drag along surge, at CO, and its moment at half a hull's length.

    None in tests whose tether, or that there is none (0 m), is stated; a tether of some length keeps its moment, which
    no parameter holds.
    """
    v = nu_r[..., :3]
    drag = np.asarray(model.quadratic_damping_ahead)[0, 0]
    pull = -drag * np.linalg.norm(v, axis=-1, keepdims=True) * v
    segments = problem.segments
    counts = np.diff([*segments.first, len(pull)])
    unstated = np.repeat([record.tether_length is None for record in segments.records], counts)
    free = any(name.startswith("tether.") for name in problem.shooting.parameters.names)
    there = unstated | (np.asarray(segments.arrays["tether"]) > 0.0)
    none = np.zeros_like(pull)
    lever = -0.5 * _length(model)
    moment = lever * np.stack([none[..., 0], -pull[..., 2], pull[..., 1]], axis=-1)
    unit = "of the hull's along surge"
    astern = "the moment of a tether that is fixed half a hull's length astern"
    return [
        _Load(
            "a tether's drag", unit, np.concatenate([pull * _each(unstated if free else there), none], axis=-1), TETHER
        ),
        _Load(astern, unit, np.concatenate([none, moment * _each(there)], axis=-1), TETHER),
    ]


def _each(segments: Shaped[np.ndarray, " S"]) -> Float[np.ndarray, "S 1 1"]:
    return segments[:, None, None].astype(float)


def _at_full_force(
    problem: Problem, theta: Float[np.ndarray, " n"], shift: Float[np.ndarray, " n"]
) -> Float[np.ndarray, " n"]:
    """How theta moves where the loss follows the other law altogether.

    A loss is stated at full force. To first order it moves by the share s of itself that the other law lacks at the
    forces of the tests; a law that gives 1 - s of the loss there takes 1 / (1 - s) of it at full force.
    """
    parameters = problem.shooting.parameters
    value = parameters.values(theta)
    loss = np.array([name.endswith(f".{INFLOW}") for name in parameters.names])
    share = np.where(loss, shift / np.where(value == 0.0, np.inf, value), 0.0)
    return shift / (1.0 - np.clip(share, 0.0, _MOST))


def _lost_thrust(problem: Problem, model: Model, delay: Any, nu_r: Float[np.ndarray, "S points 6"]) -> _Load:
    """A loss in proportion to each thruster's force: of 1 / (m/s), or, where the model has a loss, in place of that."""
    arrays, grid, thrusters = problem.segments.arrays, problem.segments.grid, model.thrusters
    T = np.asarray(thrusters.configuration)
    single = replace(thrusters, configuration=jnp.eye(T.shape[1]), inflow_loss=None)
    command, held, fresh = (jnp.asarray(arrays[key]) for key in ("command", "held", "fresh"))
    force = thrust_history(single, command, held, fresh, grid.step, delay)
    force = jnp.concatenate([force[:, :, 0], force[:, -1:, 2]], axis=1)
    inflow = nu_r @ T
    if thrusters.inflow_loss is None:
        load = -(np.abs(force) * inflow) @ T.T
        expected = LOST / top_speed(model, range(T.shape[1]))
        return _Load("thrust lost to the inflow in proportion to the force", "s/m", load, expected)
    other = np.abs(force) * np.asarray(thrusters.inflow_loss) - np.asarray(inflow_damping(thrusters, force))
    return _Load(OTHER_LAW, "of the loss", -(other * inflow) @ T.T, 1.0)
