"""The sum of squares of a joint estimate, and its normal equations.

Added up are the weighted squares of readings, of defects between segments, of static evidence and of the distance from
the prior. Each signal component has a variance of its own and so has the disturbance in each direction of motion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.nodes import FADES, NODE, Nodes, difference, moved, undisturbed
from rovtwin.identification.joint.solver.arrow import Arrow
from rovtwin.identification.joint.solver.equation_error import balanced
from rovtwin.identification.joint.solver.readings import HUBER
from rovtwin.identification.joint.solver.segments import Segments, nodes_from_data
from rovtwin.identification.joint.solver.shooting import Blocks, Shooting

# Where nobody declared it: noise of a reading to start from, and how far a sensor may be off throughout.
_SIGMA = {"position": 0.03, "horizontal": 0.03, "depth": 0.01, "attitude": 0.005, "gyro": 0.005, "velocity": 0.02}
_SIGMA["accelerometer"] = 0.1
_OFFSET = {"gyro": [0.01] * 3, "accelerometer": [0.1] * 3, "attitude": [0.02] * 3}
_HELD = 1e-6  # offset of a sensor whose own zero is the reference

_NODE_ROWS = {"position": 0, "attitude": 3, "velocity": 6, "gyro": 9}  # where a reading is a part of the state itself
# What is known of a start, without readings; of its push, as much as of every other.
_FIRST_NODE = np.array([10.0] * 3 + [0.5] * 3 + [1.0] * 6)
# To start from. That of the position stays, it is kinematics; that of the attitude takes up resets of its filter.
_DEFECT = np.array([1e-2] * 6 + [0.2] * 6 + [0.1] * 6)
_NO_PUSH = 1e-4  # [m/s2, rad/s2]
_CAUTION = 5.0  # readings are trusted so much less at first, while the model is far from them


Static = Callable[[Float[Array, " n"]], Float[Array, " k"]]
"""Evidence that is no motion (a bollard pull, a towing table): whitened residuals at theta; differentiable."""


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations: of every reading and of the defects of a segment."""

    sigma: Float[np.ndarray, " G"]
    defect: Float[np.ndarray, "18"]

    def push(self, span: float) -> Float[np.ndarray, "6"]:
        """Standard deviations of the push at any time [m/s2, rad/s2]; segments last for `span` [s]."""
        return self.defect[12:] / np.sqrt(1.0 - np.exp(-2.0 * span / FADES))


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is estimated: theta, offsets and the nodes."""

    theta: Float[np.ndarray, " n"]
    offsets: Float[np.ndarray, " G"]
    nodes: Nodes

    def moved(self, nodes: Float[np.ndarray, "S 18"], corner: Float[np.ndarray, " m"]) -> "Unknowns":
        """Others, by errors of the nodes and by steps of theta and offsets."""
        n = len(self.theta)
        there = jax.tree.map(np.asarray, _moved_all(self.nodes, nodes))
        return Unknowns(self.theta + corner[:n], self.offsets + corner[n:], there)


def offset_widths(groups: Sequence[tuple[str, int]]) -> Float[np.ndarray, " G"]:
    """How far the zero of each (signal, component) may be off throughout; of a reference hardly at all."""
    placed = any(name == "position" for name, _ in groups)
    widths = [_OFFSET.get(name, [0.0] * 3)[i] for name, i in groups]
    # Depth next to a full position has a zero of its own; every other position says where the origin is.
    widths = [0.1 if name == "depth" and placed else w for (name, _), w in zip(groups, widths, strict=True)]
    return np.maximum(widths, _HELD)


class Problem:
    """One estimation: compiled residuals, prior and static evidence."""

    def __init__(
        self, shooting: Shooting, prior: Gaussian, static: Static | None = None, measured_starts: bool = False
    ):
        """`shooting` may be used for several problems of equal shape; it is compiled once.

        With `measured_starts` every segment begins at its readings, within their declared noise, and nothing pushes:
        starts and pushes that are free take up part of what a model lacks, and parameters then come out too small.
        """
        self.shooting, self.prior, self.static, self.measured_starts = shooting, prior, static, measured_starts
        self.segments = shooting.segments
        self.guess = undisturbed(**nodes_from_data(self.segments, exact=measured_starts))
        self.groups = self.segments.groups
        self.information, self.width = prior.information, np.sqrt(np.diag(prior.covariance))
        self.offset_information = offset_widths(self.groups) ** -2.0
        self._start_information = self._start_widths(measured_starts) ** -2.0
        self.static_linear = (
            None if static is None else jax.jit(lambda theta: (static(theta), jax.jacfwd(static)(theta)))
        )

    def with_prior(self, prior: Gaussian) -> "Problem":
        """The same readings and static evidence with another prior; nothing is compiled again."""
        return Problem(self.shooting, prior, self.static, self.measured_starts)

    def _start_widths(self, measured: bool) -> Float[np.ndarray, "S 18"]:
        """How well the guess of each node is known apart from the readings that follow."""
        width = np.full((self.segments.count, NODE), np.inf)
        if measured:
            for name, i in self.groups:
                if name in _NODE_ROWS:
                    width[:, _NODE_ROWS[name] + i] = self._declared(name, i)
            width[:, 12:] = _NO_PUSH
        first = np.array(self.segments.first)
        width[first, :12] = np.minimum(width[first, :12], _FIRST_NODE)
        return width

    def start_information(self, noise: Noise) -> Float[np.ndarray, "S 18"]:
        """Of the guess of each node apart from the readings that follow."""
        if self.measured_starts:
            return self._start_information
        known = self._start_information.copy()
        known[np.array(self.segments.first), 12:] = noise.push(self.segments.grid.span) ** -2.0
        return known

    def _declared(self, name: str, i: int) -> float:
        sigma = self.segments.sigma[name][i]
        return float(sigma) if np.isfinite(sigma) else _SIGMA[name]

    def start(self) -> tuple[Unknowns, Noise]:
        """Parameters at which the forces balance, nodes from smoothed readings, declared or usual noise."""
        sigma = [self.segments.sigma[name][i] for name, i in self.groups]
        usual = [_SIGMA[name] for name, _ in self.groups]
        # A gyro of 1e-5 rad/s makes a valley too narrow to be walked from afar.
        sigma = np.where(np.isfinite(sigma), np.maximum(_CAUTION * np.asarray(sigma), usual), usual)
        theta = balanced(self.shooting.balance, self.segments, self.prior, self.static_linear)
        unknowns = Unknowns(theta, np.zeros(len(self.groups)), self.guess)
        return unknowns, Noise(sigma, _DEFECT.copy())

    def blocks(self, unknowns: Unknowns, noise: Noise, segments: Segments | None = None) -> Blocks:
        """Of the readings and defects, as NumPy arrays; segments: with other readings or effects."""
        arrays = (segments or self.segments).arrays
        found = self.shooting.blocks(unknowns.theta, unknowns.offsets, unknowns.nodes, noise.sigma, arrays)
        return jax.tree.map(np.asarray, found)

    def assembled(self, blocks: Blocks, unknowns: Unknowns, noise: Noise) -> Arrow:
        """Normal equations of a step."""
        S, n, G = self.segments.count, len(self.prior.mean), len(self.groups)
        weight = noise.sigma**-2.0
        H = np.einsum("g,sgab->sab", weight, blocks.readings)
        b = -np.einsum("g,sga->sa", weight, blocks.slopes)
        own, border, corner = H[:, :NODE, :NODE].copy(), H[:, :NODE, NODE:].copy(), H[:, NODE:, NODE:].sum(axis=0)
        b_node, b_corner = b[:, :NODE].copy(), b[:, NODE:].sum(axis=0)
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
        # Starts, prior, offsets, static evidence.
        off = np.asarray(_differences(unknowns.nodes, self.guess))
        known = self.start_information(noise)
        own[:, range(NODE), range(NODE)] += known
        b_node -= known * off
        gap = unknowns.theta - self.prior.mean
        corner[:n, :n] += self.information
        b_corner[:n] -= self.information @ gap
        corner[n:, n:] += np.diag(self.offset_information)
        b_corner[n:] -= self.offset_information * unknowns.offsets
        if self.static_linear is not None:
            r, Jr = (np.asarray(x) for x in self.static_linear(jnp.asarray(unknowns.theta)))
            corner[:n, :n] += Jr.T @ Jr
            b_corner[:n] -= Jr.T @ r
        assert border.shape == (S, NODE, n + G)
        return Arrow(own, _gram(here, there), border, corner, b_node, b_corner)

    def start_cost(self, nodes: Nodes, noise: Noise) -> float:
        """Squares of how far nodes are from where the readings put them, where that counts."""
        return float(np.sum(self.start_information(noise) * np.asarray(_differences(nodes, self.guess)) ** 2))

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
        total += self.start_cost(unknowns.nodes, noise)
        return total + float(self.offset_information @ unknowns.offsets**2) + self.static_cost(unknowns.theta)

    def static_information(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n n"]:
        """Of the prior and of static evidence."""
        if self.static_linear is None:
            return self.information
        J = np.asarray(self.static_linear(jnp.asarray(theta))[1])
        return self.information + J.T @ J

    def static_cost(self, theta: Float[np.ndarray, " n"]) -> float:
        """Of the prior and of static evidence."""
        gap = theta - self.prior.mean
        r = np.zeros(0) if self.static_linear is None else np.asarray(self.static_linear(jnp.asarray(theta))[0])
        return float(gap @ self.information @ gap + r @ r)


def _gram(a: Float[np.ndarray, "S m a"], b: Float[np.ndarray, "S m b"]) -> Float[np.ndarray, "S a b"]:
    """a' b per segment."""
    return np.swapaxes(a, 1, 2) @ b


_differences = jax.jit(jax.vmap(difference))
_moved_all = jax.jit(jax.vmap(moved))
