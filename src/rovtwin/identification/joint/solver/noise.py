"""The noise of a joint estimate: variance components of the readings and of what disturbs the vehicle.

They follow from their own residuals and redundancies (Foerstner 1979; Koch 1999, Parameter estimation and hypothesis
testing in linear models, sec. 3.6). Nothing is tuned by hand.
"""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.identification.joint.model.nodes import NODE
from rovtwin.identification.joint.solver.arrow import Arrow
from rovtwin.identification.joint.solver.problem import Noise, Problem
from rovtwin.identification.joint.solver.shooting import Blocks

_FLOOR = {"position": 1e-4, "horizontal": 1e-4, "depth": 1e-4, "attitude": 1e-5, "gyro": 1e-5, "velocity": 1e-5}
_FLOOR["accelerometer"] = 1e-3
_DEFECT_FLOOR = np.array([1e-4] * 6 + [1e-5] * 12)
_UNSEEN = 0.01  # disturbance of velocities that nothing measures, in a second [m/s, rad/s]; it grows as a random walk
_SEES = {"position": "uvw", "velocity": "uvw", "horizontal": "uv", "depth": "w", "attitude": "pqr", "gyro": "pqr"}
_PATIENCE = 4.0  # largest factor by which a noise changes at once


def seen_motions(signals: Iterable[str]) -> Bool[np.ndarray, "6"]:
    """Which components of nu some signal measures, directly or as a change."""
    seen = {axis for name in signals for axis in _SEES.get(name, "")}
    return np.array([axis in seen for axis in "uvwpqr"])


class Variances:
    """Variances of one problem, estimated step by step beside its unknowns."""

    def __init__(self, problem: Problem):
        """Starts without a history."""
        self._problem = problem
        self._floor = np.concatenate([[_FLOOR[name] for name, _ in problem.groups], _DEFECT_FLOOR])
        self._last = np.zeros(len(self._floor))

    def step(self, blocks: Blocks, arrow: Arrow, noise: Noise, near: bool) -> tuple[Noise, bool]:
        """Noise as the residuals say, not too far at once, and no less while the estimate still moves.

        A narrow valley is entered at its wide end. Variances that go to zero creep there, by a like factor each time
        (as any EM does: Dempster, Laird and Rubin 1977); Aitken's rule says where they are going.
        """
        target = self.target(blocks, arrow, noise)
        G = len(noise.sigma)
        now = np.concatenate([noise.sigma, noise.defect])
        step = np.log(np.concatenate([target.sigma, target.defect]) / now)
        least = -np.log(_PATIENCE) if near else 0.0
        # Every second one is taken that far: what follows one that went too far says nothing of where a row is going.
        before, self._last = self._last, step if near and not self._last.any() else np.zeros_like(step)
        rate = np.where(before != 0.0, step / np.where(before != 0.0, before, 1.0), 0.0)
        going = step / (1.0 - np.clip(rate, 0.0, 0.9))
        new = np.maximum(now * np.exp(np.clip(going, least, np.log(_PATIENCE))), self._floor)
        moved = np.abs(np.log(new / now))
        # Defects fade slowly to nothing, and what is left of them no longer matters.
        settled = near and bool(np.all(moved[:G] < 0.03) and np.all(moved[G:] < 0.2))
        return Noise(new[:G], new[G:]), settled

    def target(self, blocks: Blocks, arrow: Arrow, noise: Noise) -> Noise:
        """Variances as squares over redundancies say."""
        problem = self._problem
        n = len(problem.prior.mean)
        own, following, border, corner = arrow.factor().covariance()
        S, m = problem.segments.count, NODE + n + len(problem.groups)
        C = np.empty((S, m, m))
        C[:, :NODE, :NODE], C[:, :NODE, NODE:], C[:, NODE:, NODE:] = own, border, corner
        C[:, NODE:, :NODE] = np.swapaxes(border, 1, 2)
        fitted = np.einsum("sgab,sab->g", blocks.readings, C) / noise.sigma**2
        count = blocks.weights.sum(axis=0)
        redundancy = np.maximum(count - fitted, 0.02 * count)
        floor = np.array([_FLOOR[name] for name, _ in problem.groups])
        squares = blocks.squares.sum(axis=0)
        sigma = np.where(count > 10, np.sqrt(squares / np.maximum(redundancy, 1e-9)), noise.sigma)
        return Noise(np.maximum(sigma, floor), self._defects(blocks, own, following, border, corner, noise))

    def _defects(
        self,
        blocks: Blocks,
        own: Float[np.ndarray, "S 18 18"],
        following: Float[np.ndarray, "S 18 18"],
        border: Float[np.ndarray, "S 18 m"],
        corner: Float[np.ndarray, "m m"],
        noise: Noise,
    ) -> Float[np.ndarray, "18"]:
        """Disturbance in each direction of motion, from how far segments miss the next node."""
        problem = self._problem
        n = len(problem.prior.mean)
        links = np.flatnonzero(problem.segments.arrays["linked"])
        if len(links) == 0:
            return noise.defect
        J = blocks.defect_jacobian[links]
        C = np.zeros((len(links), 2 * NODE + n, 2 * NODE + n))
        a, t, z = slice(0, NODE), slice(NODE, NODE + n), slice(NODE + n, None)
        C[:, a, a], C[:, t, t], C[:, z, z] = own[links], corner[:n, :n], own[links + 1]
        C[:, a, t], C[:, z, t] = border[links][:, :, :n], border[links + 1][:, :, :n]
        C[:, a, z] = following[links]
        C[:, t, a], C[:, t, z] = np.swapaxes(C[:, a, t], 1, 2), np.swapaxes(C[:, z, t], 1, 2)
        C[:, z, a] = np.swapaxes(C[:, a, z], 1, 2)
        variance = np.einsum("sia,sab,sib->i", J, C, J)
        squares = np.sum(blocks.defect[links] ** 2, axis=0)
        redundancy = np.maximum(len(links) - variance / noise.defect**2, 0.02 * len(links))
        target = np.maximum(np.sqrt(squares / redundancy), _DEFECT_FLOOR)
        defect = _DEFECT_FLOOR.copy()
        defect[6:12] = _UNSEEN * np.sqrt(problem.segments.grid.span)
        # A disturbance of what nothing measures would only serve to explain the rest away.
        moves = seen_motions(problem.segments.levers)
        seen = np.concatenate([[False] * 3, moves[3:], moves, moves])
        defect[seen] = target[seen]
        return defect
