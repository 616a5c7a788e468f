"""What a test would tell: Fisher information of its readings through the derivatives of the twin.

The expected covariance of a test is what the joint estimate would report of it, with the state at the start of each
segment and the offsets of the sensors unknown too, and a disturbance between segments. Information adds up over tests.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.joint.anchors import static_evidence
from rovtwin.identification.joint.gaussian import Gaussian
from rovtwin.identification.joint.nodes import NODE, Nodes
from rovtwin.identification.joint.parameters import Parameters
from rovtwin.identification.joint.problem import offset_widths
from rovtwin.identification.joint.segments import Grid, Segments, cut
from rovtwin.identification.joint.shooting import Shooting
from rovtwin.identification.logs.record import Record

GRID = Grid(step=0.05, steps=100, rate=20.0)
# What a segment of 5 s may miss the next node by: kinematics; 5 mm/s, 5 mrad/s of disturbance nobody models.
DEFECT = np.array([1e-4] * 6 + [5e-3] * 6)
# What readings of a real vehicle miss any model by, whatever the data sheet says: a gyro of 0.03 mrad/s would otherwise
# promise thrust curves to a part in ten thousand.
MISFIT = {"horizontal": 0.01, "position": 0.01, "depth": 0.005, "attitude": 0.005, "gyro": 0.005, "velocity": 0.01}
MISFIT["accelerometer"] = 0.1


@dataclass(frozen=True, eq=False)
class Information:
    """What tests tell: about theta and the offsets of sensors, which is what adds up.

    Attributes:
        matrices: Of each test, the states eliminated, shape (tests, n + G, n + G).
        offsets: Prior information of the offsets, shape (G,).
        seconds: How long each test takes, shape (tests,).
    """

    matrices: np.ndarray
    offsets: np.ndarray
    seconds: np.ndarray

    def covariance(self, prior: Gaussian, times: np.ndarray) -> np.ndarray:
        """Expected covariance of theta after each test was flown so many times, shapes (tests,) -> (n, n)."""
        return _covariance(prior, np.tensordot(times, self.matrices, 1), self.offsets)


@dataclass(frozen=True, eq=False)
class Path:
    """Where the vehicle was: t (n,) [s], position (n, 3), attitude (n, 4), nu (n, 6)."""

    t: np.ndarray
    position: np.ndarray
    attitude: np.ndarray
    nu: np.ndarray

    def at(self, t: np.ndarray) -> Nodes:
        """States at times of the path, shape (k,)."""
        rows = np.clip(np.searchsorted(self.t, t - 1e-6), 0, len(self.t) - 1)
        return Nodes(*(np.asarray(x)[rows] for x in (self.position, self.attitude, self.nu)))  # type: ignore[arg-type]  (NumPy)


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of everything that tests measure, squared by signal component; what noise there is, is said later.

    Attributes:
        readings: J'J per segment and component, shape (S, G, 12 + n + G, ...).
        defects: Jacobian of the defects, shape (S, 12, 12 + n + 12).
        segments: How the Records were cut.
        counts: Records of each test.
        seconds: How long each test takes.
    """

    readings: np.ndarray
    defects: np.ndarray
    segments: Segments
    counts: tuple[int, ...]
    seconds: np.ndarray

    def information(self, defect: np.ndarray = DEFECT, misfit: Mapping[str, float] = MISFIT) -> Information:
        """What the tests tell.

        Args:
            defect: By how much a segment misses the next state, standard deviations, shape (12,).
            misfit: What a model misses each signal by, besides the declared noise; {}: nothing.

        Raises:
            IdentificationError: A sensor's noise is not declared.
        """
        groups = self.segments.groups
        sigma = np.array([self.segments.sigma[name][i] for name, i in groups])
        if not np.all(np.isfinite(sigma) & (sigma > 0)):
            raise IdentificationError("the noise of every sensor must be declared: without it no test can be judged")
        sigma = np.hypot(sigma, [misfit.get(name, 0.0) for name, _ in groups])
        readings = np.einsum("g,sgab->sab", sigma**-2.0, self.readings)
        defects = self.defects / defect[:, None]
        bounds = [*self.segments.first, self.segments.count]
        of_record = [_reduced(readings[a:b], defects[a:b]) for a, b in pairwise(bounds)]
        matrices = [np.sum(of_record[a:b], axis=0) for a, b in pairwise(np.cumsum([0, *self.counts]))]
        widths = offset_widths(groups)
        return Information(np.stack(matrices), widths**-2.0, self.seconds)


def sensitivities(
    parameters: Parameters,
    tests: Sequence[Sequence[Record]],
    paths: Sequence[Path],
    seconds: Sequence[float],
    grid: Grid = GRID,
) -> Sensitivities:
    """Of tests that were simulated, at the starting values of the parameters.

    Args:
        parameters: Free ones.
        tests: The Records of each, all with the same signals; only commands and times of readings count.
        paths: Where the vehicle is in each test.
        seconds: How long each takes, with what leaves no Record.
        grid: How Records are cut; a state is free at the start of each segment.
    """
    segments = cut([record for test in tests for record in test], grid)
    starts = segments.starts()
    owner = np.repeat(np.arange(len(tests)), [len(test) for test in tests])
    states = [paths[owner[r]].at(starts[a:b]) for r, (a, b) in enumerate(pairwise([*segments.first, segments.count]))]
    nodes = Nodes(*(np.concatenate(parts) for parts in zip(*states, strict=True)))  # type: ignore[arg-type]  (NumPy)
    components = len(segments.groups)
    # Sigma decides only how far out a reading is an outlier: here none is.
    found = Shooting(parameters, segments).blocks(
        np.zeros(len(parameters)), np.zeros(components), nodes, np.full(components, 1e6), segments.arrays
    )
    return Sensitivities(
        np.asarray(found.readings),
        np.asarray(found.defect_jacobian),
        segments,
        tuple(len(test) for test in tests),
        np.asarray(seconds, dtype=float),
    )


def _reduced(readings: np.ndarray, defects: np.ndarray) -> np.ndarray:
    """Information of [theta, offsets] of one record, its states eliminated, shape (n + G, n + G).

    Args:
        readings: J'WJ by segment, columns node, theta, offsets, shape (S, 12 + n + G, ...).
        defects: Whitened Jacobian of the defects by node, theta and next node, shape (S, 12, 12 + n + 12).
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
    # States that nothing measures would make it singular: what a metre, a radian and their rates are is enough.
    states[np.diag_indices_from(states)] += 1e-4
    border = whole[: S * NODE, S * NODE :]
    return whole[S * NODE :, S * NODE :] - border.T @ np.linalg.solve(states, border)


def _covariance(prior: Gaussian, told: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    n = len(prior.mean)
    total = told + np.diag(np.concatenate([np.zeros(n), offsets]))
    total[:n, :n] += prior.information
    # Scaled first: information of a gyro's zero and of a thruster's curve are fifteen orders apart.
    scale = 1.0 / np.sqrt(np.diag(total))
    return (np.linalg.inv(total * np.outer(scale, scale)) * np.outer(scale, scale))[:n, :n]


def with_anchors(parameters: Parameters, prior: Gaussian, anchors: Sequence[Mapping[str, Any]]) -> Gaussian:
    """The prior after static evidence such as bollard pulls, to first order about its mean; see `anchors`."""
    static = static_evidence(parameters, anchors)
    if static is None:
        return prior
    jacobian = np.asarray(jax.jacfwd(static)(jnp.asarray(prior.mean)))
    return Gaussian(prior.mean, np.linalg.inv(prior.information + jacobian.T @ jacobian))
