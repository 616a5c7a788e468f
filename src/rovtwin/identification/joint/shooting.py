"""The compiled part of the estimate: every segment simulated with its derivatives, and squared into normal equations.

For segment s the unknowns are the error of its node x_s (position 3, attitude 3, nu 6), the parameters theta and
constant offsets b of the sensors. A reading gives the residual h(x(t; x_s, theta)) + b - y, the end of a segment the
defect x_{s+1} - f(x_s, theta), which a disturbance of the vehicle may fill.

Reference: Bock (1983), Recent advances in parameter identification techniques for ODE; Schittkowski (2002), sec. 2.6.
"""

from functools import partial
from typing import Any, NamedTuple

import equinox as eqx

from rovtwin.core.flow import Environment
from rovtwin.core.frames import quaternion_normalise, quaternion_rate, rotation_from_quaternion
from rovtwin.core.integrate import rk4_step
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.identification.joint.balance import Balance
from rovtwin.identification.joint.loads import load_wrench, thrust_history
from rovtwin.identification.joint.nodes import NODE, Nodes, difference, moved
from rovtwin.identification.joint.parameters import Extras, Parameters
from rovtwin.identification.joint.readings import gaps_along, offsets_by_signal, squared
from rovtwin.identification.joint.segments import Segments
from rovtwin.vehicle.dynamics import acceleration
from rovtwin.vehicle.model import Model

_CHUNK = 8  # segments at most that are simulated side by side, with all their derivatives: what fits into the cache


class Blocks(NamedTuple):
    """Normal equations of the readings and of the defects, per segment; G groups (signal components), m = 12 + n + G.

    Attributes:
        readings: J'WJ per group with unit noise, shape (S, G, m, m); columns: node, theta, offsets.
        slopes: J'Wr per group, shape (S, G, m).
        squares: Sum of w r^2 per group, shape (S, G).
        weights: Sum of w per group, shape (S, G).
        defect: x_{s+1} - f(x_s), shape (S, 12); zero where nothing follows.
        defect_jacobian: By node, theta and next node, shape (S, 12, 12 + n + 12).
    """

    readings: Any
    slopes: Any
    squares: Any
    weights: Any
    defect: Any
    defect_jacobian: Any


class Shooting:
    """Residuals of segments at given parameters, compiled once for their shapes."""

    def __init__(self, parameters: Parameters, segments: Segments):
        """Nothing is compiled before the first call."""
        self.parameters, self.segments = parameters, segments
        self.balance = Balance(parameters, segments.grid)
        _, self._static = eqx.partition(parameters.model, eqx.is_inexact_array)
        self._names = list(segments.levers)
        self.blocks = jax.jit(self._blocks)
        self.residuals = jax.jit(self._residuals)
        self.trajectories = jax.jit(self._trajectories)
        self.scaled = jax.jit(parameters.scaled)
        self.scaled_by_theta = jax.jit(jax.jacfwd(parameters.scaled))
        self.scale_tangent = jax.jit(lambda theta: jax.jacfwd(parameters.scaled, argnums=1)(theta, 0.0))

    # Thrust: known from the commands alone, so that it is integrated once through each whole record.

    def _wrenches(self, theta: Array, arrays: dict[str, Any]) -> Array:
        """Wrench of the thrusters at the start, middle and end of every step, shape (S, K, 3, 6)."""
        model, _ = self.parameters.model_at(theta)
        return thrust_history(model.thrusters, arrays["command"], arrays["fresh"], self.segments.grid.step)

    def _linearised(self, theta: Array, arrays: dict[str, Any]) -> tuple[Any, Any, Array, Array]:
        """Model arrays and wrenches with their derivatives by theta, leading axis n; wrench derivatives (S, n, ...)."""

        def parts(theta: Array) -> Any:
            model, extras = self.parameters.model_at(theta)
            return eqx.partition(model, eqx.is_inexact_array)[0], extras

        unit = jnp.eye(len(self.parameters))
        flexible = parts(theta)
        d_flexible = jax.vmap(lambda e: jax.jvp(parts, (theta,), (e,))[1])(unit)
        wrench = partial(self._wrenches, arrays=arrays)
        tau = wrench(theta)
        d_tau = jax.vmap(lambda e: jax.jvp(wrench, (theta,), (e,))[1], out_axes=1)(unit)
        return flexible, d_flexible, tau, d_tau

    # One segment.

    def _simulated(
        self, error: Array, flexible: Any, tau: Array, node: Nodes, own: dict[str, Any]
    ) -> tuple[dict[str, Array], Nodes]:
        """Prediction less reading of one segment, by signal (R, k), and the state at its end."""
        path, rates = self._path(error, flexible, tau, node, own)
        gaps = gaps_along(path, rates, own, self.segments.levers, self.segments.grid.step)
        return gaps, jax.tree.map(lambda x: x[-1], path)

    def _path(
        self, error: Array, flexible: Any, tau: Array, node: Nodes, own: dict[str, Any]
    ) -> tuple[Nodes, Array | None]:
        """States at the grid points of one segment, leading axis K + 1; nu_dot too where something measures it."""
        model: Model = eqx.combine(flexible[0], self._static)
        extras: Extras = flexible[1]
        if "ballast_mass" in own:
            heavier = model.rigid_body_mass + own["ballast_mass"]
            model = model.replace(rigid_body_mass=heavier)
        calm = Environment.calm(velocity=own["current"])
        step = self.segments.grid.step

        def rate(x: Nodes, wrench: Array) -> Array:
            extra = load_wrench(x, own, extras)
            return acceleration(model, x.position, x.attitude, x.nu, wrench + extra, calm)

        def advance(x: Nodes, wrenches: Array) -> tuple[Nodes, Nodes]:
            at = {0.0: wrenches[0], 0.5 * step: wrenches[1], step: wrenches[2]}

            def derivative(elapsed: float, y: Nodes) -> Nodes:
                velocity = rotation_from_quaternion(y.attitude) @ y.nu[:3]
                return Nodes(velocity, quaternion_rate(y.attitude, y.nu[3:]), rate(y, at[elapsed]))

            after = rk4_step(derivative, x, step)
            after = after._replace(attitude=quaternion_normalise(after.attitude))
            return after, after

        start = moved(node, error)
        _, path = jax.lax.scan(advance, start, tau)
        path = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), start, path)
        if "accelerometer" not in self._names:
            return path, None
        wrench = jnp.concatenate([tau[:, 0], tau[-1:, 2]])
        return path, jax.vmap(rate)(path, wrench)

    def _per_segment(self, nodes: Nodes, arrays: dict[str, Any]) -> tuple[Nodes, dict[str, Any]]:
        """Next nodes, and what belongs to each segment apart from commands."""
        following = jax.tree.map(lambda x: jnp.roll(x, -1, axis=0), nodes)
        own = {key: value for key, value in arrays.items() if key not in ("command", "fresh")}
        return following, own

    def _blocks(self, theta: Array, offsets: Array, nodes: Nodes, sigma: Array, arrays: dict[str, Any]) -> Blocks:
        """Normal equations at theta (n,), offsets (G,), nodes; sigma (G,) decides which readings are outliers."""
        flexible, d_flexible, tau, d_tau = self._linearised(theta, arrays)
        following, own = self._per_segment(nodes, arrays)

        def one(segment: Any) -> Blocks:
            node, next_node, tau, d_tau, own = segment

            def outputs(error: Array, flexible: Any, tau: Array) -> tuple[dict[str, Array], Array]:
                gaps, end = self._simulated(error, flexible, tau, node, own)
                return gaps, difference(next_node, end)

            zero = jnp.zeros(NODE)
            value, columns = jax.vmap(
                lambda de, df, dt: jax.jvp(outputs, (zero, flexible, tau), (de, df, dt)), out_axes=(None, -1)
            )(*_directions(d_flexible, d_tau))
            by_next = jax.jacfwd(lambda e: value[1] + difference(moved(next_node, e), next_node))(zero)
            defect_jacobian = own["linked"] * jnp.concatenate([columns[1], by_next], axis=1)
            found = squared(self._names, value[0], columns[0], own, offsets, sigma)
            return Blocks(*found, own["linked"] * value[1], defect_jacobian)

        return _chunked(one, (nodes, following, tau, d_tau, own))

    def _residuals(
        self, theta: Array, offsets: Array, nodes: Nodes, arrays: dict[str, Any]
    ) -> tuple[dict[str, Array], Array]:
        """Residuals by signal (S, R, k), prediction less reading, and defects (S, 12)."""
        flexible, tau = self._plain(theta, arrays)
        following, own = self._per_segment(nodes, arrays)

        def one(segment: Any) -> tuple[dict[str, Array], Array]:
            node, next_node, tau, own = segment
            gaps, end = self._simulated(jnp.zeros(NODE), flexible, tau, node, own)
            split = offsets_by_signal(self._names, gaps, offsets)
            residual = {name: gaps[name] + split[name] for name in self._names}
            return residual, own["linked"] * difference(next_node, end)

        return _chunked(one, (nodes, following, tau, own))

    def _plain(self, theta: Array, arrays: dict[str, Any]) -> tuple[Any, Array]:
        """Model arrays and wrenches."""
        model, extras = self.parameters.model_at(theta)
        return (eqx.partition(model, eqx.is_inexact_array)[0], extras), self._wrenches(theta, arrays)

    def _trajectories(self, theta: Array, nodes: Nodes, arrays: dict[str, Any]) -> Nodes:
        """States at all grid points from each node, leading axes (S, K + 1)."""
        flexible, tau = self._plain(theta, arrays)
        _, own = self._per_segment(nodes, arrays)
        return _chunked(lambda s: self._path(jnp.zeros(NODE), flexible, s[1], s[0], s[2])[0], (nodes, tau, own))


def _directions(d_flexible: Any, d_tau: Array) -> tuple[Array, Any, Array]:
    """All directions to differentiate along, one after the other: the node's error, then theta."""
    count = d_tau.shape[0]
    d_error = jnp.concatenate([jnp.eye(NODE), jnp.zeros((count, NODE))])

    def after_nodes(x: Array) -> Array:
        return jnp.concatenate([jnp.zeros((NODE, *x.shape[1:])), x])

    return d_error, jax.tree.map(after_nodes, d_flexible), after_nodes(d_tau)


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
