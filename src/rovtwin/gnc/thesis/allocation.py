"""Allocation: a desired wrench -> a command for each thruster, by the pseudo-inverse of the configuration matrix.

A rank-deficient vehicle is normal (the Double Blueye has no pitch): of a wrench that thrusters cannot make, the
least-squares part is made. Computed once when the block is built; nothing but mat-vecs is left for the loop.
"""

from typing import Any, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Configuration, PerThruster, PRNGKey, Vector6
from rovtwin.gnc.interfaces import Allocated, AllocationInput
from rovtwin.vehicle.physics.actuation import RANK_TOLERANCE
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import Thrusters, command_for_force, force_limits

Saturation = Literal["scale", "clip"]


class Allocation(Block):
    """Pseudo-inverse allocation with a choice of what happens at the thrusters' limits.

    `scale` shrinks the forces of all thrusters that share an axis by one factor, so that their wrench keeps its
    direction: too small, but pointing where it should. Thrusters without a common axis are left alone: surge at its
    limit does not cost depth. `clip` cuts each thruster by itself, as the thesis's normalised commands do: more
    thrust, but the wrench turns (full surge takes the yaw moment away).

    Attributes:
        thrusters: As the autopilot's model has them.
        effective: T with each column times the thruster's health: wrench per force asked for.
        pseudo_inverse: Of `effective`, weighted.
        lowest: Least force of each thruster [N], before health.
        highest: Greatest force of each thruster [N], before health.
        together: Whether two thrusters share an axis, directly or through others.
        saturation: "scale" or "clip".
    """

    thrusters: Thrusters
    effective: Configuration
    pseudo_inverse: Float[Array, "n 6"]
    lowest: PerThruster
    highest: PerThruster
    together: Bool[Array, "n n"]
    saturation: Saturation = eqx.field(static=True, default="scale")

    @classmethod
    def of(cls, model: Model, weights: Any = None, saturation: Saturation = "scale") -> "Allocation":
        """Allocation for a model.

        Args:
            model: Its thrusters are used.
            weights: Cost of each thruster's squared force, shape (n,), positive; None is equal.
            saturation: See the class.
        """
        if saturation not in ("scale", "clip"):
            raise ValueError(f"saturation is {saturation!r}, expected 'scale' or 'clip'")
        thrusters = model.thrusters
        effective = np.asarray(thrusters.configuration) * np.asarray(thrusters.health)
        sound = eqx.tree_at(lambda t: t.health, thrusters, as_array(np.ones(thrusters.count)))
        lowest, highest = force_limits(sound)
        inverse = weighted_pseudo_inverse(effective, weights)
        together = as_array(coupled(effective), bool)
        return cls(thrusters, as_array(effective), as_array(inverse), lowest, highest, together, saturation)

    def init(self, key: PRNGKey, start: Start) -> tuple[()]:
        return ()

    def step(self, memory: tuple[()], input: AllocationInput, dt: float) -> tuple[tuple[()], Allocated]:
        """Without memory; thrusters are as healthy as the model had them, whatever the input says."""
        command, made = self(input.tau)
        rest = input.tau - made
        force = jnp.abs(self.pseudo_inverse @ input.tau)
        limited = force >= jnp.where(self.pseudo_inverse @ input.tau >= 0, self.highest, -self.lowest)
        return memory, Allocated(command, made, rest, rest, limited)

    def __call__(self, tau: Vector6) -> tuple[Command, Vector6]:
        """Command for a desired wrench, and the wrench that it really asks for.

        Args:
            tau: Desired wrench, b at CO [N, N m].

        Returns:
            The command, and the wrench that sound thrusters settle at with it.

        Reference: Fossen (2021), sec. 11.2.1; thesis 7.1.
        """
        force = self.pseudo_inverse @ tau
        if self.saturation == "scale":
            force = force * self._share(force)
        force = jnp.clip(force, self.lowest, self.highest)
        return Command(command_for_force(self.thrusters, force)), self.effective @ force

    def _share(self, force: PerThruster) -> PerThruster:
        """Largest factor of each thruster, at most 1, that brings all that share an axis with it within limits."""
        limit = jnp.where(force >= 0, self.highest, -self.lowest)
        # A thruster that cannot push this way at all is left to the clip: it must not stop the others.
        asked = jnp.where(limit > 0, jnp.abs(force), 0.0)
        excess = asked / jnp.where(limit > 0, limit, 1.0)
        return 1.0 / jnp.maximum(jnp.max(jnp.where(self.together, excess, 0.0), axis=1, initial=0.0), 1.0)


def weighted_pseudo_inverse(T: Any, weights: Any = None) -> Float[np.ndarray, "n 6"]:
    """Of T, shape (6, n): least-squares wrench, then least weighted sum of squared forces.

    Reference: Fossen (2021), eq. 11.26, extended to rank-deficient T by the singular value decomposition.
    """
    T = np.asarray(T, dtype=float)
    root = np.ones(T.shape[1]) if weights is None else np.sqrt(np.asarray(weights, dtype=float))
    if root.shape != (T.shape[1],) or not np.all(root > 0):
        raise ValueError(f"weights are {weights!r}, expected {T.shape[1]} positive numbers, one per thruster")
    return np.linalg.pinv(T / root, rcond=RANK_TOLERANCE) / root[:, None]


def coupled(T: Any) -> Bool[np.ndarray, "n n"]:
    """Which thrusters of T, shape (6, n), share an axis, directly or through others."""
    T = np.asarray(T, dtype=float)
    acts = np.abs(T) > RANK_TOLERANCE * np.abs(T).max(initial=0.0)
    linked = (acts.T @ acts) | np.eye(T.shape[1], dtype=bool)
    for _ in range(T.shape[1]):
        linked = linked @ linked
    return linked
