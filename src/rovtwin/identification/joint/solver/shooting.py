"""The compiled part of the estimate: every segment simulated with its derivatives, and squared into normal equations.

For segment s the unknowns are the error of its node x_s (position 3, attitude 3, nu 6, push 6), the parameters theta
and constant offsets b of the sensors. A reading gives the residual h(x(t; x_s, theta)) + b - y, the end of a segment
the defect x_{s+1} - f(x_s, theta), which a disturbance of the vehicle may fill. What lasts longer than a segment is
the push, an acceleration that fades slowly (a latent force: Alvarez, Luengo and Lawrence 2013).

Reference: Bock (1983), Recent advances in parameter identification techniques for ODE; Schittkowski (2002), sec. 2.6.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.integrate import rk4_step
from rovtwin.core.frames import quaternion_normalise, quaternion_rate, rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Vector6
from rovtwin.identification.joint.model.loads import WRENCH, accelerated, thrust_history
from rovtwin.identification.joint.model.nodes import FADES, NODE, Nodes, difference, moved
from rovtwin.identification.joint.model.parameters import Parameters, Sensing
from rovtwin.identification.joint.solver.equation_error import Balance
from rovtwin.identification.joint.solver.readings import gaps_along, offsets_by_signal, squared
from rovtwin.identification.joint.solver.segments import Segments
from rovtwin.identification.joint.solver.sensitivities import sensitivities
from rovtwin.vehicle.physics.discrepancy import with_coefficients, without_discrepancy
from rovtwin.vehicle.physics.dynamics import learned_wrench
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import inflow_wrench

_OF_THRUSTERS = ("command", "held", "fresh")  # arrays of segments, as `thrust_history` takes them
_OF_RECORDS = (*_OF_THRUSTERS, "effects")
_CHUNK = 8  # segments at most that are simulated side by side, with all their derivatives: what fits into the cache


class OfEffects(NamedTuple):
    """What the normal equations have of C effects that are not estimated, see `unmodelled`; per segment.

    Attributes:
        readings: J'WJ_c per group with unit noise, shape (S, G, m + C, C); rows: as in `Blocks`, then the effects.
        slopes: J_c'Wr per group, shape (S, G, C).
        defect_jacobian: By the effects, shape (S, 18, C).
    """

    readings: Any
    slopes: Any
    defect_jacobian: Any


class Blocks(NamedTuple):
    """Normal equations of the readings and of the defects, per segment; G groups (signal components), m = 18 + n + G.

    Attributes:
        readings: J'WJ per group with unit noise, shape (S, G, m, m); columns: node, theta, offsets.
        slopes: J'Wr per group, shape (S, G, m).
        squares: Sum of w r^2 per group, shape (S, G).
        weights: Sum of w per group, shape (S, G).
        defect: x_{s+1} - f(x_s), shape (S, 18); zero where nothing follows.
        defect_jacobian: By node, theta and next node, shape (S, 18, 18 + n + 18).
        effects: The same of what is not estimated.
    """

    readings: Any
    slopes: Any
    squares: Any
    weights: Any
    defect: Any
    defect_jacobian: Any
    effects: OfEffects


class Shooting:
    """Residuals of segments at given parameters, compiled once for their shapes."""

    def __init__(self, parameters: Parameters, segments: Segments):
        """Nothing is compiled before the first call."""
        self.parameters, self.segments = parameters, segments
        self.balance = Balance(parameters, segments.grid)
        _, self._static = eqx.partition(parameters.model, eqx.is_inexact_array)
        self._names = list(segments.levers)
        model = parameters.model
        self._has_nonlinear = model.discrepancy is not None or model.thrusters.inflow_loss is not None
        self.blocks = jax.jit(self._blocks)
        self.residuals = jax.jit(self._residuals)
        self.trajectories = jax.jit(self._trajectories)
        self.scaled = jax.jit(parameters.scaled)
        self.scaled_by_theta = jax.jit(jax.jacfwd(parameters.scaled))
        self.scale_tangent = jax.jit(lambda theta: jax.jacfwd(parameters.scaled, argnums=1)(theta, 0.0))

    # Thrust: known from the commands alone, so that it is integrated once through each whole record.

    def _wrenches(self, parts: Any, arrays: dict[str, Any]) -> Float[Array, "S K 3 _"]:
        """Thrust at the start, middle and end of every step, see `thrust_history`."""
        model: Model = eqx.combine(parts[0], self._static)
        command, held, fresh = (arrays[key] for key in _OF_THRUSTERS)
        return thrust_history(model.thrusters, command, held, fresh, self.segments.grid.step, parts[1].delay)

    def _parts(self, theta: Float[Array, " n"]) -> Any:
        """What depends on theta: the model's arrays, and the test's own parameters."""
        model, extras = self.parameters.model_at(theta)
        return eqx.partition(model, eqx.is_inexact_array)[0], extras

    def _linearised(
        self, theta: Float[Array, " n"], arrays: dict[str, Any]
    ) -> tuple[Any, Any, Float[Array, "S K 3 w"], Float[Array, "S K 3 w m"]]:
        """Parts and thrust with derivatives by theta and C effects, m = n + C in all."""
        n, effects = len(self.parameters), jnp.asarray(arrays["effects"])
        every = n + effects.shape[-1]
        parts = self._parts(theta)
        d_parts = jax.vmap(lambda e: jax.jvp(self._parts, (theta,), (e,))[1])(jnp.eye(every, n))
        # Few parameters are the thrusters' own, or their commands'.
        of_thrust = [name.startswith(("thrusters.", "commands.")) for name in self.parameters.names]
        own = np.flatnonzero(of_thrust)
        wrenches = partial(self._wrenches, arrays=arrays)
        tau = wrenches(parts)
        d_own = jax.vmap(lambda d: jax.jvp(wrenches, (parts,), (d,))[1], out_axes=-1)(
            jax.tree.map(lambda x: x[own], d_parts)
        )
        d_tau = jnp.zeros((*tau.shape, every)).at[..., own].set(d_own)
        return parts, d_parts, tau, d_tau.at[..., :WRENCH, n:].set(effects)

    # One segment.

    def _model(self, own: dict[str, Any], parts: Any) -> Model:
        """The model of parts, with the ballast of a segment."""
        model: Model = eqx.combine(parts[0], self._static)
        if "ballast_mass" in own:
            model = model.replace(rigid_body_mass=model.rigid_body_mass + own["ballast_mass"])
        return model

    def _rate(self, own: dict[str, Any], parts: Any, x: Nodes, wrench: Float[Array, " _"]) -> Vector6:
        """nu_dot in a segment, of parts, state and the thrusters' wrench."""
        return accelerated(self._model(own, parts), parts[1], own, x, wrench) + x.push

    def _rate_of_equations(self, own: dict[str, Any], parts: Any, x: Nodes, wrench: Float[Array, " _"]) -> Vector6:
        """The same without what is not linear in the wrench: what the model has learned, and a loss to the inflow."""
        model = without_discrepancy(self._model(own, parts))
        return accelerated(model, parts[1], own, x, wrench[:WRENCH]) + x.push

    def _rate_nonlinear(self, own: dict[str, Any], parts: Any, x: Nodes, thrust: Float[Array, " _"]) -> Vector6:
        """What these two add to nu_dot."""
        model, basis = self._model(own, parts), self.parameters.model.discrepancy
        R_bn = rotation_from_quaternion(x.attitude).T
        nu_r = jnp.concatenate([x.nu[:3] - R_bn @ own["current"], x.nu[3:]])
        wrench = jnp.zeros(WRENCH)
        if basis is not None:
            assert model.discrepancy is not None
            # Of what it has learned only the coefficients are parameters: no derivatives by all the rest.
            found = with_coefficients(basis, model.discrepancy.coefficients)
            model = eqx.tree_at(lambda m: m.discrepancy, model, found)
            wrench = wrench + learned_wrench(model, nu_r, thrust[:WRENCH])
        if model.thrusters.inflow_loss is not None:
            wrench = wrench + inflow_wrench(model.thrusters.configuration, thrust[WRENCH:], nu_r)
        return model.inertia_inverse @ wrench

    def _path(
        self, parts: Any, tau: Float[Array, "K 3 _"], node: Nodes, own: dict[str, Any]
    ) -> tuple[Nodes, Float[Array, "points 6"] | None]:
        """States at the grid points of one segment, leading axis K + 1; nu_dot too where something measures it."""
        step = self.segments.grid.step
        rate = partial(self._rate, own, parts)

        def advance(x: Nodes, wrenches: Float[Array, "3 _"]) -> tuple[Nodes, Nodes]:
            at = {0.0: wrenches[0], 0.5 * step: wrenches[1], step: wrenches[2]}

            def derivative(elapsed: float, y: Nodes) -> Nodes:
                velocity = rotation_from_quaternion(y.attitude) @ y.nu[:3]
                return Nodes(velocity, quaternion_rate(y.attitude, y.nu[3:]), rate(y, at[elapsed]), -y.push / FADES)

            after = rk4_step(derivative, x, step)
            after = after._replace(attitude=quaternion_normalise(after.attitude))
            return after, after

        _, path = jax.lax.scan(advance, node, tau)
        path = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), node, path)
        if "accelerometer" not in self._names:
            return path, None
        return path, jax.vmap(rate)(path, jnp.concatenate([tau[:, 0], tau[-1:, 2]]))

    def _gaps(
        self, path: Nodes, rates: Float[Array, "points 6"] | None, own: dict[str, Any], sensing: Sensing
    ) -> dict[str, Float[Array, "_ _"]]:
        """Prediction less reading of one segment, by signal."""
        return gaps_along(path, rates, own, self.segments.levers, self.segments.grid.step, sensing)

    def _per_segment(self, nodes: Nodes, arrays: dict[str, Any]) -> tuple[Nodes, dict[str, Any]]:
        """Next nodes, and what belongs to each segment apart from commands."""
        following = jax.tree.map(lambda x: jnp.roll(x, -1, axis=0), nodes)
        own = {key: value for key, value in arrays.items() if key not in _OF_RECORDS}
        return following, own

    def _blocks(
        self,
        theta: Float[Array, " n"],
        offsets: Float[Array, " G"],
        nodes: Nodes,
        sigma: Float[Array, " G"],
        arrays: dict[str, Any],
    ) -> Blocks:
        """Normal equations at theta, offsets, nodes; sigma decides which readings are outliers."""
        parts, d_parts, tau, d_tau = self._linearised(theta, arrays)
        sensing = parts[1].sensing
        d_sensing = jax.tree.map(_of_theta, d_parts[1].sensing)
        following, own = self._per_segment(nodes, arrays)
        loads = arrays["effects"].shape[-1]

        def one(segment: Any) -> Blocks:
            node, next_node, tau, d_tau, own = segment
            path, rates = self._path(parts, tau, node, own)
            nonlinear = partial(self._rate_nonlinear, own) if self._has_nonlinear else None
            rate = partial(self._rate_of_equations, own)
            S, d_rates = sensitivities(
                rate, parts, d_parts, path, tau, d_tau, self.segments.grid.step, nonlinear, loads
            )

            def gaps(
                errors: Float[Array, "points 18"], more: Float[Array, "points 6"], other: Sensing
            ) -> dict[str, Float[Array, "_ _"]]:
                there = None if rates is None else rates + more
                return self._gaps(jax.vmap(moved)(path, errors), there, own, other)

            still = jnp.zeros(S.shape[:2]), jnp.zeros(d_rates.shape[:2]), sensing
            value, columns = jax.vmap(lambda *d: jax.jvp(gaps, still, d), in_axes=-1, out_axes=(None, -1))(
                S, d_rates, d_sensing
            )
            end = jax.tree.map(lambda x: x[-1], path)
            by_end, by_next = jax.jacfwd(
                lambda *errors: difference(moved(next_node, errors[1]), moved(end, errors[0])), argnums=(0, 1)
            )(jnp.zeros(NODE), jnp.zeros(NODE))
            defect_jacobian = own["linked"] * jnp.concatenate([by_end @ S[-1], by_next], axis=1)
            found = squared(self._names, value, columns, own, offsets, sigma)
            return self._apart(found, own["linked"] * difference(next_node, end), defect_jacobian)

        return _chunked(one, (nodes, following, tau, d_tau, own))

    def _apart(
        self,
        found: tuple[Float[Array, "G m m"], Float[Array, "G m"], Float[Array, " G"], Float[Array, " G"]],
        defect: Float[Array, "18"],
        defect_jacobian: Float[Array, "18 _"],
    ) -> Blocks:
        """Blocks of a segment, with what belongs to effects apart."""
        readings, slopes, squares, weights = found
        estimated = NODE + len(self.parameters)
        effects = np.arange(estimated, defect_jacobian.shape[1] - NODE)
        rest = np.delete(np.arange(readings.shape[-1]), effects)
        rows = np.concatenate([rest, effects])
        of_effects = OfEffects(readings[:, rows][:, :, effects], slopes[:, effects], defect_jacobian[:, effects])
        kept = readings[:, rest][:, :, rest], slopes[:, rest], squares, weights
        return Blocks(*kept, defect, jnp.delete(defect_jacobian, effects, axis=1), of_effects)

    def _residuals(
        self, theta: Float[Array, " n"], offsets: Float[Array, " G"], nodes: Nodes, arrays: dict[str, Any]
    ) -> tuple[dict[str, Float[Array, "S _ _"]], Float[Array, "S 18"]]:
        """Residuals by signal, prediction less reading, and defects."""
        parts = self._parts(theta)
        following, own = self._per_segment(nodes, arrays)

        def one(segment: Any) -> tuple[dict[str, Float[Array, "_ _"]], Float[Array, "18"]]:
            node, next_node, tau, own = segment
            path, rates = self._path(parts, tau, node, own)
            gaps = self._gaps(path, rates, own, parts[1].sensing)
            split = offsets_by_signal(self._names, gaps, offsets)
            residual = {name: gaps[name] + split[name] for name in self._names}
            return residual, own["linked"] * difference(next_node, jax.tree.map(lambda x: x[-1], path))

        return _chunked(one, (nodes, following, self._wrenches(parts, arrays), own))

    def _trajectories(self, theta: Float[Array, " n"], nodes: Nodes, arrays: dict[str, Any]) -> Nodes:
        """States at all grid points from each node, leading axes (S, K + 1)."""
        parts = self._parts(theta)
        _, own = self._per_segment(nodes, arrays)
        return _chunked(lambda s: self._path(parts, s[1], s[0], s[2])[0], (nodes, self._wrenches(parts, arrays), own))


def _of_theta(derivatives: Float[Array, "m ..."]) -> Float[Array, "... n"]:
    """Derivatives by theta as the last axis, behind zeros for the node, which what it is of does not depend on."""
    return jnp.moveaxis(jnp.pad(derivatives, [(NODE, 0)] + [(0, 0)] * (derivatives.ndim - 1)), 0, -1)


def _chunked(function: Any, segments: Any) -> Any:
    """`function` of every segment, some side by side; the last ones are padded so that one program serves all."""
    count = jax.tree.leaves(segments)[0].shape[0]
    chunks = -(-count // _CHUNK)
    side_by_side = -(-count // chunks)
    spare = chunks * side_by_side - count

    def folded(x: Array) -> Array:
        return jnp.concatenate([x, jnp.repeat(x[-1:], spare, axis=0)]).reshape(chunks, side_by_side, *x.shape[1:])

    out = jax.lax.map(jax.vmap(function), jax.tree.map(folded, segments))
    return jax.tree.map(lambda x: x.reshape(chunks * side_by_side, *x.shape[2:])[:count], out)
