"""What a test would tell: Fisher information of its readings through the derivatives of the twin.

The expected covariance of a test is what the joint estimate would report of it, with the state at the start of each
segment and the offsets of the sensors unknown too, and a disturbance between segments. Information adds up over tests.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Real

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.nodes import NODE, Nodes, undisturbed
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.identification.joint.solver.problem import offset_widths
from rovtwin.identification.joint.solver.segments import Grid, Segments, cut
from rovtwin.identification.joint.solver.shooting import Shooting
from rovtwin.identification.logs.record import Record

GRID = Grid(step=0.05, steps=100, rate=20.0)
BATCH = 64  # segments that are simulated in one go
# What a segment of 5 s may miss the next node by: kinematics; 5 mm/s, 5 mrad/s of disturbance nobody models; no push
# [m/s2, rad/s2].
DEFECT = np.array([1e-4] * 6 + [5e-3] * 6 + [1e-4] * 6)
# Of each node: what a metre, a radian and their rates are is enough for what nothing measures; nothing pushes.
_KNOWN = np.array([1e-4] * 12 + [1e8] * 6)
# What readings of a real vehicle miss any model by, whatever the data sheet says: a gyro of 0.03 mrad/s would otherwise
# promise thrust curves to a part in ten thousand.
MISFIT = {"horizontal": 0.01, "position": 0.01, "depth": 0.005, "attitude": 0.005, "gyro": 0.005, "velocity": 0.01}
MISFIT["accelerometer"] = 0.1


@dataclass(frozen=True, eq=False)
class Information:
    """What tests tell: about theta and the offsets of sensors, which is what adds up.

    Attributes:
        matrices: Of each test, the states eliminated.
        offsets: Prior information of the offsets.
        seconds: How long each test takes.
    """

    matrices: Float[np.ndarray, "tests m m"]
    offsets: Float[np.ndarray, " G"]
    seconds: Float[np.ndarray, " tests"]

    def after(self, prior: Gaussian, times: Real[np.ndarray, " tests"]) -> Float[np.ndarray, "m m"]:
        """Of theta and offsets once each test was flown so many times."""
        n = len(prior.mean)
        total = np.tensordot(times, self.matrices, 1) + np.diag(np.concatenate([np.zeros(n), self.offsets]))
        total[:n, :n] += prior.information
        return total

    def covariance(self, prior: Gaussian, times: Real[np.ndarray, " tests"]) -> Float[np.ndarray, "n n"]:
        """Expected covariance of theta after each test was flown so many times."""
        n = len(prior.mean)
        return inverse(self.after(prior, times))[:n, :n]


@dataclass(frozen=True, eq=False)
class Path:
    """Where the vehicle was: t (n,) [s], position (n, 3), attitude (n, 4), nu (n, 6)."""

    t: Float[np.ndarray, " n"]
    position: Float[np.ndarray, "n 3"]
    attitude: Float[np.ndarray, "n 4"]
    nu: Float[np.ndarray, "n 6"]

    def at(self, t: Float[np.ndarray, " k"]) -> Nodes:
        """States at times of the path."""
        rows = np.clip(np.searchsorted(self.t, t - 1e-6), 0, len(self.t) - 1)
        return undisturbed(*(np.asarray(x)[rows] for x in (self.position, self.attitude, self.nu)))


def information(
    parameters: Parameters,
    tests: Sequence[Sequence[Record]],
    paths: Sequence[Path],
    seconds: Sequence[float],
    defect: Float[np.ndarray, "18"] = DEFECT,
    misfit: Mapping[str, float] = MISFIT,
    grid: Grid = GRID,
    progress: Callable[[float], None] = lambda share: None,
) -> Information:
    """What tests tell that were simulated at the starting values of the parameters.

    Args:
        parameters: Free ones.
        tests: The Records of each, all with the same signals; only commands and times of readings count.
        paths: Where the vehicle is in each test.
        seconds: How long each takes, with what leaves no Record.
        defect: By how much a segment misses the next state, standard deviations.
        misfit: What a model misses each signal by, besides the declared noise; {}: nothing.
        grid: How Records are cut; a state is free at the start of each segment.
        progress: Told which share is done.

    Raises:
        IdentificationError: A sensor's noise is not declared.
    """
    cuts = _Cuts(tests, paths, grid)
    groups = cuts.segments.groups
    sigma = _noise(cuts.segments, misfit)
    zero = jnp.zeros(len(parameters)), jnp.zeros(len(groups))
    # Sigma decides only how far out a reading is an outlier: here none is.
    nothing_is_far = jnp.full(len(groups), 1e6)

    def given(batch: range) -> tuple[Any, ...]:
        nodes, arrays = cuts.of(batch)
        return *zero, nodes, nothing_is_far, arrays

    blocks = Shooting(parameters, cuts.segments).blocks.lower(*given(cuts.batches[0])).compile()

    def information_of(batch: range) -> list[np.ndarray]:
        found = blocks(*given(batch))
        readings = np.einsum("g,sgab->sab", sigma**-2.0, np.asarray(found.readings))
        defects = np.asarray(found.defect_jacobian) / defect[:, None]
        ends = cuts.bounds[batch.start : batch.stop + 1] - cuts.bounds[batch.start]
        return [_reduced(readings[a:b], defects[a:b]) for a, b in pairwise(ends)]

    matrices = np.zeros((len(tests), *[len(parameters) + len(groups)] * 2))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for batch, of_records in zip(cuts.batches, pool.map(information_of, cuts.batches), strict=True):
            np.add.at(matrices, cuts.owner[batch], of_records)
            progress(batch.stop / len(cuts.owner))
    return Information(matrices, offset_widths(groups) ** -2.0, np.asarray(seconds, dtype=float))


class _Cuts:
    """Records of tests cut into segments, and the batches in which they are simulated.

    Attributes:
        segments: Of all records.
        bounds: First segment of each record, and the end of the last.
        owner: Test of each record.
        nodes: States at the start of segments.
        batches: Of records; every one is filled up to `size` segments, so that one program serves all.
    """

    def __init__(self, tests: Sequence[Sequence[Record]], paths: Sequence[Path], grid: Grid):
        self.segments = cut([record for test in tests for record in test], grid)
        self.bounds = np.array([*self.segments.first, self.segments.count])
        self.owner = np.repeat(np.arange(len(tests)), [len(test) for test in tests])
        starts, spans = self.segments.starts(), zip(self.owner, pairwise(self.bounds), strict=True)
        states = [paths[int(test)].at(starts[a:b]) for test, (a, b) in spans]
        self.nodes = Nodes(*(np.concatenate(parts) for parts in zip(*states, strict=True)))  # type: ignore[arg-type]  (NumPy)
        self.batches, self.size = _batches(np.diff(self.bounds))

    def of(self, batch: range) -> tuple[Nodes, dict[str, Any]]:
        """States and arrays of some records; the last segment again and again where they are fewer than `size`."""
        rows = np.minimum(self.bounds[batch.start] + np.arange(self.size), self.bounds[batch.stop] - 1)
        arrays = self.segments.arrays | {"effects": self.segments.arrays["effects"][..., :0]}
        return jax.tree.map(lambda x: jnp.asarray(x[rows]), (self.nodes, arrays))


def _noise(segments: Segments, misfit: Mapping[str, float]) -> Float[np.ndarray, " G"]:
    """Standard deviation of every signal component, with what a model misses it by."""
    sigma = np.array([segments.sigma[name][i] for name, i in segments.groups])
    if not np.all(np.isfinite(sigma) & (sigma > 0)):
        raise IdentificationError("the noise of every sensor must be declared: without it no test can be judged")
    return np.hypot(sigma, [misfit.get(name, 0.0) for name, _ in segments.groups])


def _batches(sizes: Int[np.ndarray, " records"]) -> tuple[list[range], int]:
    """Records that are simulated in one go, and how many segments that are: one program, whatever there is to judge."""
    most = max(min(BATCH, int(sizes.sum())), int(sizes.max()))
    batches, first = [], 0
    for r in range(1, len(sizes) + 1):
        if r == len(sizes) or sizes[first : r + 1].sum() > most:
            batches.append(range(first, r))
            first = r
    return batches, most


def _reduced(readings: Float[np.ndarray, "S _ _"], defects: Float[np.ndarray, "S 18 _"]) -> Float[np.ndarray, "m m"]:
    """Information of [theta, offsets] of one record, its states eliminated.

    Args:
        readings: J'WJ by segment, columns node, theta, offsets, shape (S, 18 + n + G, ...).
        defects: Whitened Jacobian of the defects by node, theta and next node, shape (S, 18, 18 + n + 18).
    """
    S, m = len(readings), readings.shape[1]
    n = defects.shape[2] - 2 * NODE
    whole = np.zeros((S * NODE + m - NODE,) * 2)
    rest = np.arange(S * NODE, len(whole))
    for s in range(S):
        own = np.arange(s * NODE, (s + 1) * NODE)
        rows = np.concatenate([own, rest])
        whole[np.ix_(rows, rows)] += readings[s]
        if s + 1 < S:
            rows = np.concatenate([own, rest[:n], own + NODE])
            whole[np.ix_(rows, rows)] += defects[s].T @ defects[s]
    states = whole[: S * NODE, : S * NODE]
    states[np.diag_indices_from(states)] += np.tile(_KNOWN, S)
    border = whole[: S * NODE, S * NODE :]
    return whole[S * NODE :, S * NODE :] - border.T @ np.linalg.solve(states, border)


def inverse(information: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m m"]:
    """Covariance of theta and offsets."""
    # Scaled first: information of a gyro's zero and of a thruster's curve are fifteen orders apart.
    scale = 1.0 / np.sqrt(np.diag(information))
    both = np.outer(scale, scale)
    return np.linalg.inv(information * both) * both


def with_anchors(parameters: Parameters, prior: Gaussian, anchors: Sequence[Mapping[str, Any]]) -> Gaussian:
    """The prior after static evidence such as bollard pulls, to first order about its mean; see `anchors`."""
    static = static_evidence(parameters, anchors)
    if static is None:
        return prior
    jacobian = np.asarray(jax.jacfwd(static)(jnp.asarray(prior.mean)))
    return Gaussian(prior.mean, np.linalg.inv(prior.information + jacobian.T @ jacobian))
