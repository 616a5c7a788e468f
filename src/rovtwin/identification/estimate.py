"""The joint estimate: maximum a posteriori by multiple shooting, with the noise estimated along the way.

Minimised are the weighted squares of readings, of defects between segments, of static evidence and of the distance from
the prior. Each signal component has a variance of its own and so has the disturbance in each direction of motion; they
follow from their own residuals and redundancies (Foerstner 1979; Koch 1999, Parameter estimation and hypothesis testing
in linear models, sec. 3.6). Nothing is tuned by hand.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.identification.arrow import Arrow, Factored
from rovtwin.identification.balance import balanced
from rovtwin.identification.gaussian import Gaussian
from rovtwin.identification.nodes import NODE, Nodes, difference, moved
from rovtwin.identification.segments import nodes_from_data
from rovtwin.identification.shooting import HUBER, Blocks, Shooting

# Where nobody declared it: noise of a reading to start from, and how far a sensor may be off throughout.
_SIGMA = {"position": 0.03, "horizontal": 0.03, "depth": 0.01, "attitude": 0.005, "gyro": 0.005, "velocity": 0.02}
_SIGMA["accelerometer"] = 0.1
_OFFSET = {"gyro": [0.01] * 3, "accelerometer": [0.1] * 3, "attitude": [0.01, 0.01, 0.0]}
_HELD = 1e-6  # offset of a sensor whose own zero is the reference
_FLOOR = {"position": 1e-4, "horizontal": 1e-4, "depth": 1e-4, "attitude": 1e-5, "gyro": 1e-5, "velocity": 1e-5}
_FLOOR["accelerometer"] = 1e-3

_NODE_ROWS = {"position": 0, "attitude": 3, "velocity": 6, "gyro": 9}  # where a reading is a part of the state itself
FIRST_NODE = np.array([10.0] * 3 + [0.5] * 3 + [1.0] * 6)  # what is known of a start, without readings
# To start from. That of the position stays, it is kinematics; that of the attitude takes up resets of its filter.
_DEFECT = np.array([1e-2] * 6 + [0.2] * 6)
_DEFECT_FLOOR = np.array([1e-4] * 6 + [1e-5] * 6)
_UNSEEN = 0.02  # of velocities that nothing measures
_SEES_VELOCITY, _SEES_RATE = {"position", "horizontal", "velocity"}, {"attitude", "gyro"}
_CAUTION = 5.0  # readings are trusted so much less at first, while the model is far from them
_PATIENCE = 4.0  # largest factor by which a noise changes at once
_NEAR = 0.02  # relative decrease of the cost below which the noise is looked at
_REACH = 1.0  # standard deviations of the prior by which a parameter moves at most in one step
_NODES = 1e4  # damping of theta from which nodes are held back too
_SMALL = 0.01  # change in standard deviations at which the estimate is done
_GAIN = 0.01  # of the cost by two steps in a row, below which it is done too: a standard deviation costs 1


Static = Callable[[Array], Array]
"""Evidence that is no motion (a bollard pull, a towing table): whitened residuals (k,) at theta; differentiable."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations: of every reading (G,) and of the defects of a segment (12,)."""

    sigma: np.ndarray
    defect: np.ndarray


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is estimated: theta (n,), offsets (G,) and the nodes."""

    theta: np.ndarray
    offsets: np.ndarray
    nodes: Nodes


@dataclass(frozen=True, eq=False)
class Solution:
    """The estimate.

    Attributes:
        unknowns: At the maximum.
        noise: As estimated.
        covariance: Of theta, shape (n, n).
        information: Of theta from the readings and static evidence alone, without the prior, shape (n, n).
        offset_std: Standard deviation of the offsets, shape (G,).
        nodes_covariance: Of the nodes, shape (S, 12, 12).
        redundancy: Readings less what they were fitted with, shape (G,).
        converged: Whether the last step was below a hundredth of a standard deviation, or gained nothing.
        steps: Gauss-Newton steps taken.
        cost: Sum of squares at the end.
    """

    unknowns: Unknowns
    noise: Noise
    covariance: np.ndarray
    information: np.ndarray
    offset_std: np.ndarray
    nodes_covariance: np.ndarray
    redundancy: np.ndarray
    converged: bool
    steps: int
    cost: float


class Problem:
    """One estimation: compiled residuals, prior and static evidence."""

    def __init__(
        self, shooting: Shooting, prior: Gaussian, static: Static | None = None, measured_starts: bool = False
    ):
        """`shooting` may be used for several problems of equal shape; it is compiled once.

        With `measured_starts` every segment begins at its readings, within their declared noise: starts that are free
        take up part of what a model lacks, and parameters then come out too small.
        """
        self.shooting, self.prior, self.static = shooting, prior, static
        self.segments = shooting.segments
        self.guess = Nodes(**nodes_from_data(self.segments, exact=measured_starts))
        self.groups = self.segments.groups
        self._information, self._width = prior.information, np.sqrt(np.diag(prior.covariance))
        self.offset_information = np.array([self._offset_width(name, i) for name, i in self.groups]) ** -2.0
        self.start_information = self._start_widths(measured_starts) ** -2.0
        self._floor = np.concatenate([[_FLOOR[name] for name, _ in self.groups], _DEFECT_FLOOR])
        self._last = np.zeros(len(self._floor))
        self._static = None if static is None else jax.jit(lambda theta: (static(theta), jax.jacfwd(static)(theta)))

    def _offset_width(self, name: str, i: int) -> float:
        # Depth next to a full position has a zero of its own; every other position says where the origin is.
        if name == "depth" and "position" in self.segments.levers:
            return 0.1
        return max(_OFFSET.get(name, [0.0] * 3)[i], _HELD)

    def _start_widths(self, measured: bool) -> np.ndarray:
        """How well the guess of each node is known apart from the readings that follow, shape (S, 12)."""
        width = np.full((self.segments.count, NODE), np.inf)
        if measured:
            for name, i in self.groups:
                if name in _NODE_ROWS:
                    width[:, _NODE_ROWS[name] + i] = self._declared(name, i)
        first = np.array(self.segments.first)
        width[first] = np.minimum(width[first], FIRST_NODE)
        return width

    def _declared(self, name: str, i: int) -> float:
        sigma = self.segments.sigma[name][i]
        return float(sigma) if np.isfinite(sigma) else _SIGMA[name]

    def start(self) -> tuple[Unknowns, Noise]:
        """Parameters at which the forces balance, nodes from smoothed readings, declared or usual noise."""
        sigma = [self.segments.sigma[name][i] for name, i in self.groups]
        usual = [_SIGMA[name] for name, _ in self.groups]
        # A gyro of 1e-5 rad/s makes a valley too narrow to be walked from afar.
        sigma = np.where(np.isfinite(sigma), np.maximum(_CAUTION * np.asarray(sigma), usual), usual)
        theta = balanced(self.shooting.balance, self.segments, self.prior, self._static)
        unknowns = Unknowns(theta, np.zeros(len(self.groups)), self.guess)
        return unknowns, Noise(sigma, _DEFECT.copy())

    def blocks(self, unknowns: Unknowns, noise: Noise) -> Blocks:
        """Of the readings and defects, as NumPy arrays."""
        found = self.shooting.blocks(
            unknowns.theta, unknowns.offsets, unknowns.nodes, noise.sigma, self.segments.arrays
        )
        return jax.tree.map(np.asarray, found)

    def assembled(self, blocks: Blocks, unknowns: Unknowns, noise: Noise) -> tuple[Arrow, float]:
        """Normal equations of a step, and the cost here."""
        S, n, G = self.segments.count, len(self.prior.mean), len(self.groups)
        weight = noise.sigma**-2.0
        H = np.einsum("g,sgab->sab", weight, blocks.readings)
        b = -np.einsum("g,sga->sa", weight, blocks.slopes)
        own, border, corner = H[:, :NODE, :NODE].copy(), H[:, :NODE, NODE:].copy(), H[:, NODE:, NODE:].sum(axis=0)
        b_node, b_corner = b[:, :NODE].copy(), b[:, NODE:].sum(axis=0)
        cost = float(weight @ blocks.losses.sum(axis=0))
        # Defects tie each node to the next.
        J = blocks.defect_jacobian / noise.defect[:, None]
        d = blocks.defect / noise.defect
        here, by_theta, there = J[:, :, :NODE], J[:, :, NODE : NODE + n], J[:, :, NODE + n :]
        own += _gram(here, here)
        own[1:] += _gram(there, there)[:-1]
        border[:, :, :n] += _gram(here, by_theta)
        border[1:, :, :n] += _gram(there, by_theta)[:-1]
        corner[:n, :n] += _gram(by_theta, by_theta).sum(axis=0)
        b_node -= np.einsum("sia,si->sa", here, d)
        b_node[1:] -= np.einsum("sia,si->sa", there, d)[:-1]
        b_corner[:n] -= np.einsum("sia,si->a", by_theta, d)
        cost += float(np.sum(d**2))
        # Starts, prior, offsets, static evidence.
        off = np.asarray(_differences(unknowns.nodes, self.guess))
        own[:, range(NODE), range(NODE)] += self.start_information
        b_node -= self.start_information * off
        gap = unknowns.theta - self.prior.mean
        corner[:n, :n] += self._information
        b_corner[:n] -= self._information @ gap
        corner[n:, n:] += np.diag(self.offset_information)
        b_corner[n:] -= self.offset_information * unknowns.offsets
        cost += self.start_cost(unknowns.nodes) + float(gap @ self._information @ gap)
        cost += float(self.offset_information @ unknowns.offsets**2)
        if self._static is not None:
            r, Jr = (np.asarray(x) for x in self._static(jnp.asarray(unknowns.theta)))
            corner[:n, :n] += Jr.T @ Jr
            b_corner[:n] -= Jr.T @ r
            cost += float(r @ r)
        assert border.shape == (S, NODE, n + G)
        return Arrow(own, _gram(here, there), border, corner, b_node, b_corner), cost

    def start_cost(self, nodes: Nodes) -> float:
        """Squares of how far nodes are from where the readings put them, where that counts."""
        return float(np.sum(self.start_information * np.asarray(_differences(nodes, self.guess)) ** 2))

    def noise_from(self, blocks: Blocks, arrow: Arrow, noise: Noise) -> tuple[Noise, np.ndarray]:
        """Variances from squares over redundancies, and the redundancies of the readings."""
        n = len(self.prior.mean)
        own, following, border, corner = arrow.factor().covariance()
        S, m = self.segments.count, NODE + n + len(self.groups)
        C = np.empty((S, m, m))
        C[:, :NODE, :NODE], C[:, :NODE, NODE:], C[:, NODE:, NODE:] = own, border, corner
        C[:, NODE:, :NODE] = np.swapaxes(border, 1, 2)
        fitted = np.einsum("sgab,sab->g", blocks.readings, C) / noise.sigma**2
        count = blocks.weights.sum(axis=0)
        redundancy = np.maximum(count - fitted, 0.02 * count)
        floor = np.array([_FLOOR[name] for name, _ in self.groups])
        squares = blocks.squares.sum(axis=0)
        sigma = np.where(count > 10, np.sqrt(squares / np.maximum(redundancy, 1e-9)), noise.sigma)
        return Noise(np.maximum(sigma, floor), self._defects(blocks, own, following, border, corner, noise)), redundancy

    def _defects(
        self,
        blocks: Blocks,
        own: np.ndarray,
        following: np.ndarray,
        border: np.ndarray,
        corner: np.ndarray,
        noise: Noise,
    ) -> np.ndarray:
        """Disturbance in each direction of motion, from how far segments miss the next node."""
        n = len(self.prior.mean)
        links = np.flatnonzero(self.segments.arrays["linked"])
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
        wanted = np.maximum(np.sqrt(squares / redundancy), _DEFECT_FLOOR)
        defect = _DEFECT_FLOOR.copy()
        defect[6:] = _UNSEEN
        # A disturbance of what nothing measures would only serve to explain the rest away.
        moves, turns = (bool(kind & set(self.segments.levers)) for kind in (_SEES_VELOCITY, _SEES_RATE))
        seen = np.array([False] * 3 + [turns] * 3 + [moves] * 3 + [turns] * 3)
        defect[seen] = wanted[seen]
        return defect

    def solve(
        self,
        start: tuple[Unknowns, Noise] | None = None,
        fixed_noise: bool = False,
        max_steps: int = 60,
        progress: Callable[[int, float], None] | None = None,
    ) -> Solution:
        """Levenberg-Marquardt steps; after each accepted one the noise is estimated anew.

        Args:
            start: Where to begin; None: `start()`.
            fixed_noise: Keep the noise of the start.
            max_steps: Of Gauss-Newton.
            progress: Called with the number of steps and the largest change in standard deviations.

        Raises:
            IdentificationError: The readings are not numbers, or the model cannot be integrated at the start.
        """
        here, noise = self.start() if start is None else start
        damping, change, steps, settled, idle = 1.0, np.inf, 0, fixed_noise, 0
        redundancy, fresh = np.ones(len(self.groups)), True
        blocks = self.blocks(here, noise)
        arrow, _ = self.assembled(blocks, here, noise)
        cost = self.cost(here, noise)
        if not np.isfinite(cost):
            raise IdentificationError("the model cannot follow these readings at all: check units, frames and commands")
        while steps < max_steps and not (settled and (change < _SMALL or idle >= 2)):
            steps += 1
            found = self._better(here, noise, arrow, cost, damping)
            if found is None:
                if fresh:
                    break
                # What counts as an outlier was still that of the noise before.
                blocks, fresh = self.blocks(here, noise), True
                arrow, _ = self.assembled(blocks, here, noise)
                damping = 1.0
                continue
            before, (here, cost, damping, change) = cost, found
            here, cost = self._rescaled(here, noise, cost)
            idle = idle + 1 if before - cost < _GAIN else 0
            blocks = self.blocks(here, noise)
            arrow, _ = self.assembled(blocks, here, noise)
            if not fixed_noise:
                fresh = False
                noise, redundancy, settled = self._noise_step(blocks, arrow, noise, cost > (1.0 - _NEAR) * before)
                arrow, _ = self.assembled(blocks, here, noise)
                cost = self.cost(here, noise)
            if progress:
                progress(steps, change)
        done = settled and (change < _SMALL or idle >= 2)
        return self._solution(here, noise, arrow, redundancy, done, steps, cost)

    def _better(
        self, here: Unknowns, noise: Noise, arrow: Arrow, cost: float, damping: float
    ) -> tuple[Unknowns, float, float, float] | None:
        """Unknowns of lower cost, that cost, the damping to go on with, and the largest change in standard deviations.

        Steps are damped in the measure of the prior: what the readings hardly see stays where it is.
        """
        factored = arrow.factor()
        std = np.sqrt(np.diag(factored.covariance()[3]))
        while damping < 1e9:
            corner, held_back = self._within_reach(factored, damping)
            # Nodes follow; where theta hardly moves any more, they are what went too far.
            trial = self._stepped(here, min(1.0, _NODES / max(damping, 1e-9)) * factored.nodes(corner), corner)
            new = self.cost(trial, noise)
            change = float(np.max(np.abs(corner) / std))
            if np.isfinite(new) and new <= cost * (1 + 1e-9):
                change = np.inf if held_back or damping > 1e-2 else change
                return trial, new, damping / 10 if damping > 1e-3 else 0.0, change
            if damping == 0.0 and change < _SMALL:
                return here, cost, 0.0, change  # nothing is left but rounding
            damping = max(10 * damping, 0.1)
        return None

    def _within_reach(self, factored: Factored, damping: float) -> tuple[np.ndarray, bool]:
        """Step of theta and offsets, and whether one of them had to be held back more than the others."""
        n = len(self._width)
        more = np.concatenate([damping * self._width**-2.0, np.zeros(len(self.groups))])
        corner, held_back = factored.border(more), False
        while (far := np.abs(corner[:n]) > _REACH * self._width).any():
            more[:n][far] = np.maximum(3.0 * more[:n][far], 0.1 * self._width[far] ** -2.0)
            corner, held_back = factored.border(more), True
        return corner, held_back

    def _noise_step(self, blocks: Blocks, arrow: Arrow, noise: Noise, near: bool) -> tuple[Noise, np.ndarray, bool]:
        """Noise as the residuals say, not too far at once, and no less while the estimate still moves.

        A narrow valley is entered at its wide end. Variances that go to zero creep there, by a like factor each time
        (as any EM does: Dempster, Laird and Rubin 1977); Aitken's rule says where they are going.
        """
        wanted, redundancy = self.noise_from(blocks, arrow, noise)
        G = len(noise.sigma)
        now = np.concatenate([noise.sigma, noise.defect])
        step = np.log(np.concatenate([wanted.sigma, wanted.defect]) / now)
        least = -np.log(_PATIENCE) if near else 0.0
        before, self._last = self._last, step if near else np.zeros_like(step)
        rate = np.where(before != 0.0, step / np.where(before != 0.0, before, 1.0), 0.0)
        rate[:G] = 0.0
        going = step / (1.0 - np.clip(rate, 0.0, 0.9))
        new = np.maximum(now * np.exp(np.clip(going, least, np.log(_PATIENCE))), self._floor)
        moved = np.abs(np.log(new / now))
        # Defects fade slowly to nothing, and what is left of them no longer matters.
        settled = near and bool(np.all(moved[:G] < 0.03) and np.all(moved[G:] < 0.2))
        return Noise(new[:G], new[G:]), redundancy, settled

    def cost(self, unknowns: Unknowns, noise: Noise) -> float:
        """The sum of squares alone, without derivatives."""
        gaps, defects = self.shooting.residuals(unknowns.theta, unknowns.offsets, unknowns.nodes, self.segments.arrays)
        total, group = float(np.sum((np.asarray(defects) / noise.defect) ** 2)), 0
        for name in self.segments.levers:
            gap = np.abs(np.asarray(gaps[name]))
            k = gap.shape[-1]
            r = gap / noise.sigma[group : group + k] * self.segments.arrays[name]["used"][..., None]
            total += float(np.sum(np.where(r > HUBER, 2.0 * HUBER * r - HUBER**2, r * r)))
            group += k
        total += self.start_cost(unknowns.nodes)
        return total + float(self.offset_information @ unknowns.offsets**2) + self._static_cost(unknowns.theta)

    def _static_cost(self, theta: np.ndarray) -> float:
        """Of the prior and of static evidence."""
        gap = theta - self.prior.mean
        r = np.zeros(0) if self._static is None else np.asarray(self._static(jnp.asarray(theta))[0])
        return float(gap @ self._information @ gap + r @ r)

    def _rescaled(self, here: Unknowns, noise: Noise, cost: float) -> tuple[Unknowns, float]:
        """The same motion at the common scale of all forces that prior and static evidence like best.

        Along that scale the readings say nothing, and it is a curve in theta: steps along its tangent leave the narrow
        valley and would be refused one after the other.
        """
        scaled = self.shooting.parameters.scaled
        best: Any = minimize_scalar(
            lambda s: self._static_cost(scaled(here.theta, s)), bounds=(-0.7, 0.7), method="bounded"
        )
        trial = replace(here, theta=scaled(here.theta, float(best.x)))
        new = self.cost(trial, noise)
        return (trial, new) if new < cost else (here, cost)

    def _stepped(self, here: Unknowns, x: np.ndarray, corner: np.ndarray) -> Unknowns:
        n = len(here.theta)
        nodes = jax.tree.map(np.asarray, _moved_all(here.nodes, x))
        return replace(here, theta=here.theta + corner[:n], offsets=here.offsets + corner[n:], nodes=nodes)

    def _solution(
        self,
        here: Unknowns,
        noise: Noise,
        arrow: Arrow,
        redundancy: np.ndarray,
        converged: bool,
        steps: int,
        cost: float,
    ) -> Solution:
        n = len(here.theta)
        factored = arrow.factor()
        own, _, _, corner = factored.covariance()
        # What is known of theta without its prior, the offsets eliminated too.
        reduced = factored.corner
        rest = np.linalg.solve(reduced[n:, n:], reduced[n:, :n])
        information = reduced[:n, :n] - reduced[:n, n:] @ rest - self._information
        information = 0.5 * (information + information.T)
        std = np.sqrt(np.diag(corner)[n:])
        return Solution(here, noise, corner[:n, :n], information, std, own, redundancy, converged, steps, cost)


def _gram(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a' b per segment."""
    return np.swapaxes(a, 1, 2) @ b


_moved_all = jax.jit(jax.vmap(moved))
_differences = jax.jit(jax.vmap(difference))
