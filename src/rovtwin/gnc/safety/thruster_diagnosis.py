"""Which thrusters still push: seen from the moments that are missing when they should.

What the model cannot explain of the momentum's change is an external wrench, which a first-order observer gives without
differentiating twice. A thruster that is lost leaves its own signature there, minus its force along its column of T.

    r_dot = K (M nu_dot - tau - tau_model - r),     x = r - slow part,     s_h = -T (lost_h f)
    loss_h = <s_h, x> / <s_h, s_h>,     explained_h = <s_h, x>^2 / (<s_h, s_h> <x, x>)

with exponentially forgetting means. The hypothesis that explains most wins, once it explains nearly all for a while.
A force alone may as well be a current or a caught tether, which feedback answers with just the force that seems to be
missing: so only thrusters with a moment of their own can be found, and moments weigh more than forces.

The flow's wrench is that of a current which is read off the disturbance force, so an error of that force is one of the
flow's moments too: on a slender hull 0.03 m/s across the bow are, by Munk's moment, as much as a lost thruster. So
<a, b> is a^T W b with the covariance of both, W^-1 = N + U U^T: N of the axes, U what a standard deviation of the
force, along the bow and across it, changes in the flow's wrench.

Reference: De Luca and Mattone (2003), Actuator failure detection and isolation using generalized momenta; Blanke et al.
(2016), Diagnosis and Fault-Tolerant Control, ch. 6.
"""

import dataclasses

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Command, Estimate
from rovtwin.core.frames import heading_rotation
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Configuration, Flag, PerThruster, PRNGKey, Scalar, Vector2, Vector6
from rovtwin.gnc.guidance.speed_limit import AchievableSpeed
from rovtwin.gnc.scales import YAW, VehicleScales
from rovtwin.vehicle.physics.actuation import wrench_limits
from rovtwin.vehicle.physics.dynamics import coriolis_wrench, damping_wrench, learned_wrench, restoring_wrench
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import lag, static_force

FORCE_NOISE, MOMENT_NOISE = 0.1, 0.03  # of an axis's largest wrench, that disturbances and errors of the model make
READ_NOISE = 0.04  # of an axis's largest force, that the force from which the current is read is wrong by
OWN_MOMENT = 0.1  # of the largest moment about any axis, below which a thruster has no signature of its own
MORE = 0.15  # that a unit has to explain more than the best of its thrusters


class HealthInput(eqx.Module):
    """The estimate and the command that the vehicle got last."""

    estimate: Estimate
    command: Command


class HealthMemory(eqx.Module):
    """What the monitor remembers; h hypotheses.

    Attributes:
        momentum: M nu of the last tick.
        force: Of the thrusters as they should push, and the same through the observer's lag [N].
        seen: See `force`.
        residual: External wrench [N, N m].
        baseline: Its slow part.
        energy: Mean of <s_h, s_h>.
        match: Mean of <s_h, x>.
        total: Mean of <x, x>.
        since: How long each hypothesis has held [s].
        health: 1 or 0 of each thruster.
        age: How long it has been watching [s].
    """

    momentum: Vector6
    force: PerThruster
    seen: PerThruster
    residual: Vector6
    baseline: Vector6
    energy: Float[Array, " h"]
    match: Float[Array, " h"]
    total: Float[Array, " h"]
    since: Float[Array, " h"]
    health: PerThruster
    age: Scalar

    def retried(self, again: Flag) -> "HealthMemory":
        """The same, with all thrusters counted as sound where they are to be tried again."""
        return eqx.tree_at(lambda m: m.health, self, jnp.where(again, 1.0, self.health))


class ThrusterHealth(Block):
    """Gives the health of each thruster, 1 or 0: lost is one that hardly pushes any more, or the wrong way.

    What is lost stays lost until the operator arms again.

    Attributes:
        model: What the vehicle is assumed to be.
        sustained: Tells the current.
        lost: Thrusters that each hypothesis takes for lost.
        signed: Columns of T with a moment of their own; the others zero.
        distinguishable: Whether a hypothesis has such a thruster.
        weight: One over the squared noise of each axis on which a hypothesis's thrusters push; zero on the others,
            where there is only what disturbs.
        force_std: Of the force from which the current is read, along the bow and across it [N].
        bandwidth: K, of the observer [rad/s].
        window: Of the means [s].
        memory: Time constant of what counts as slow [s].
        patience: How long it has to hold [s].
        least: Mean <s_h, s_h> below which nothing is said: squared signal over noise.
        share: Loss from which a thruster counts as lost.
        certainty: Share of <x, x> that has to be explained.
    """

    model: Model
    sustained: AchievableSpeed
    lost: Float[Array, "h n"]
    signed: Configuration
    distinguishable: Bool[Array, " h"]
    weight: Float[Array, "h 6"]
    force_std: Vector2
    bandwidth: Scalar = eqx.field(converter=as_array)
    window: Scalar = eqx.field(converter=as_array)
    memory: Scalar = eqx.field(converter=as_array)
    patience: Scalar = eqx.field(converter=as_array)
    least: Scalar = eqx.field(converter=as_array, default=4.0)
    share: Scalar = eqx.field(converter=as_array, default=0.7)
    certainty: Scalar = eqx.field(converter=as_array, default=0.72)

    @classmethod
    def of(cls, model: Model, units: tuple[tuple[int, ...], ...] = ()) -> "ThrusterHealth":
        """Hypotheses: each thruster alone, then each unit.

        Args:
            model: The vehicle.
            units: Thrusters that may fail together, as those of one vehicle of a pair.
        """
        n = model.thrusters.count
        lost = np.concatenate([np.eye(n), *(np.isin(np.arange(n), unit)[None, :] for unit in units)])
        lower, upper = (np.asarray(limit) for limit in wrench_limits(model.thrusters))
        T = np.asarray(model.thrusters.configuration)
        reach = np.max(np.abs(T[3:]), axis=0, initial=0.0)
        signed = np.where(reach > OWN_MOMENT * reach.max(initial=0.0), T, 0.0)
        distinguishable = np.any(lost[:, None, :] * signed != 0.0, axis=(1, 2))
        pushes = np.any(np.abs(lost[:, None, :] * signed) > 1e-6, axis=2)
        noise = np.repeat([FORCE_NOISE, MOMENT_NOISE], 3) * np.maximum(-lower, upper)
        weight = np.where(pushes, np.where(noise > 0.0, noise, np.inf) ** -2.0, 0.0)
        w = float(VehicleScales.of(model).bandwidth[YAW])  # moments tell, and yaw is what thrusters are busy with
        return cls(
            model=model,
            sustained=AchievableSpeed.of(model),
            bandwidth=3.0 * w,
            window=3.0 / w,
            memory=20.0 / w,
            patience=2.5 / w,
            lost=as_array(lost),
            signed=as_array(signed),
            distinguishable=as_array(distinguishable, bool),
            weight=as_array(weight),
            force_std=as_array(READ_NOISE * np.maximum(-lower, upper)[:2]),
        )

    def init(self, key: PRNGKey, start: Start) -> HealthMemory:
        n, h = self.model.thrusters.count, self.lost.shape[0]
        six, rest, none = jnp.zeros(6), jnp.zeros(n), jnp.zeros(h)
        health = jnp.ones(n)
        return HealthMemory(six, rest, rest, six, six, none, none, none, none, health, jnp.zeros(()))

    def step(self, memory: HealthMemory, input: HealthInput, dt: float) -> tuple[HealthMemory, PerThruster]:
        force = lag(self.model.thrusters, memory.force, static_force(self.model.thrusters, input.command.u), dt)
        momentum, external = self._external(memory, input.estimate, force, dt)
        quick = 1.0 - jnp.exp(-self.bandwidth * dt)
        residual = memory.residual + quick * (external - memory.residual)
        seen = memory.seen + quick * (force - memory.seen)
        # In a current that the filter has not learnt yet, the flow's moments are no thruster's. Nor are they a slow
        # part: a thruster that is dead from the start has to stand out when the current is known.
        learnt = memory.age > 0.5 * self.memory
        slow = jnp.where(learnt, dt / self.memory, 0.0)
        baseline = memory.baseline + slow * (residual - memory.baseline)

        x = residual - baseline
        # A sum, for XLA puts no product of such matrices into one piece with the rest of a tick (`in_one_piece`).
        s = -jnp.sum((self.lost * memory.health * seen)[:, None, :] * self.signed, axis=2)
        fade = dt / self.window
        weighed, x_weighed = self._weighed(input.estimate, s, jnp.broadcast_to(x, s.shape))
        energy = memory.energy + fade * (jnp.sum(weighed * s, axis=1) - memory.energy)
        match = memory.match + fade * (jnp.sum(weighed * x, axis=1) - memory.match)
        total = memory.total + fade * (jnp.sum(x_weighed * x, axis=1) - memory.total)
        holds = self._holds(energy, match, total) & learnt
        since = jnp.where(holds, memory.since + dt, 0.0)

        found = since > self.patience
        health = jnp.where(jnp.any(found), memory.health * (1.0 - self.lost[jnp.argmax(found)]), memory.health)
        # What the lost one left in the means and in the residual is no evidence against the others.
        sound = ~jnp.any(found)
        after = HealthMemory(
            momentum,
            force,
            seen,
            jnp.where(sound, residual, baseline),
            baseline,
            jnp.where(sound, energy, 0.0),
            jnp.where(sound, match, 0.0),
            jnp.where(sound, total, 0.0),
            jnp.where(sound, since, 0.0),
            health,
            memory.age + dt,
        )
        return jax.tree.map(lambda new, old: jnp.where(jnp.isfinite(new), new, old), after, memory), health

    def _external(
        self, memory: HealthMemory, estimate: Estimate, force: PerThruster, dt: float
    ) -> tuple[Vector6, Vector6]:
        """Momentum, and the wrench that is not the model's, b [N, N m]."""
        model, nu = self.model, estimate.nu
        down_b = estimate.R_nb[2]
        momentum = model.inertia @ nu
        tau = model.thrusters.configuration @ (memory.health * force)
        flow = self._flow(estimate) - learned_wrench(model, self.sustained.through_water(estimate), tau)
        known = tau - coriolis_wrench(model.rigid_body_mass, nu) - flow - restoring_wrench(model, down_b)
        return momentum, jnp.where(memory.age > 0.0, (momentum - memory.momentum) / dt - known, 0.0)

    def _flow(self, estimate: Estimate) -> Vector6:
        """Wrench of the water that flows past, b [N, N m]."""
        nu_r = self.sustained.through_water(estimate)
        return coriolis_wrench(self.model.added_mass, nu_r) + damping_wrench(self.model, nu_r)

    def _weighed(self, estimate: Estimate, *wrenches: Float[Array, "h 6"]) -> tuple[Float[Array, "h 6"], ...]:
        """W times wrenches: W = (N + U U^T)^-1, by Woodbury's identity."""
        to_n = heading_rotation(estimate.heading) * self.force_std  # columns: along the bow, across it

        def flow(force: Vector2) -> Vector6:
            return self._flow(dataclasses.replace(estimate, bias=estimate.bias.at[:2].add(force)))

        # By differences, not slopes: where hardly any water flows past, a small force is a large change of speed. And
        # one by one: XLA puts no product of two matrices into one piece with the rest of a tick (`in_one_piece`).
        U = jnp.stack([0.5 * (flow(to_n[:, i]) - flow(-to_n[:, i])) for i in (0, 1)])  # shape (2, 6)
        weighed_U = U * self.weight[:, None, :]  # shape (h, 2, 6)
        a, b, c = (jnp.sum(weighed_U[:, i] * U[j], axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
        determinant = (1.0 + a) * (1.0 + c) - b**2

        def through(y: Float[Array, "h 6"]) -> Float[Array, "h 6"]:
            p, q = (jnp.sum(weighed_U[:, i] * y, axis=1) for i in (0, 1))
            along, across = ((1.0 + c) * p - b * q) / determinant, ((1.0 + a) * q - b * p) / determinant
            return self.weight * y - along[:, None] * weighed_U[:, 0] - across[:, None] * weighed_U[:, 1]

        return tuple(through(y) for y in wrenches)

    def _holds(
        self, energy: Float[Array, " h"], match: Float[Array, " h"], total: Float[Array, " h"]
    ) -> Bool[Array, " h"]:
        """Whether a hypothesis is the best one, says enough and explains enough."""
        safe = jnp.maximum(energy, 1e-12)
        loss, explained = match / safe, match**2 / (safe * jnp.maximum(total, 1e-12))
        # A unit explains more than one of its thrusters by having more to explain with; the first of equals counts.
        several = jnp.sum(self.lost, axis=1) > 1.0
        best = jnp.argmax(jnp.where(self.distinguishable & (energy > self.least), explained - MORE * several, -1.0))
        fits = self.distinguishable & (energy > self.least) & (loss > self.share) & (explained > self.certainty)
        return fits & (jnp.arange(energy.shape[0]) == best)
