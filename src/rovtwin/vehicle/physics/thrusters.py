"""Thrusters: command -> force curve -> lag -> wrench, for any number of thrusters anywhere, in any direction."""

from typing import TypeAlias

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.numerics import Array, as_array, in_numpy, jnp, module_for
from rovtwin.core.types import Configuration, HostArray, PerThruster, ScalarLike, Vector6

Forces: TypeAlias = Float[Array, "... n"]  # of n thrusters, at one instant or at many

_STRAIGHT = 1e-3  # share of the full force


class Thrusters(eqx.Module):
    """Parameters of n thrusters. Commands are normalised, u in [-1, 1].

    The static force is `sign(u) F_max shape(x)`, with `x = (|u| - dead_band) / (1 - dead_band)`, F_max ahead or astern,
    and shape either `x ** exponent` (1: linear, about 2: propeller) or, for a table, interpolated.

    Attributes:
        configuration: T: the wrench of unit forces, b at CO. Fossen (2021), eq. 9.7.
        force_ahead: Force at u = 1 [N].
        force_astern: Size of the force at u = -1 [N].
        exponent: Of the curve.
        dead_band: |u| up to which there is no force, in [0, 1).
        time_constant: Of the first-order lag of the force [s]; 0 is no lag.
        rate_limit: Largest |force rate| [N/s]; inf is none.
        quantisation: Step to which commands are rounded; 0 is none.
        health: Share of the force left: 1 sound, 0 dead.
        table_command: Commands of the tables, increasing; k = 2 with zeros where no thruster has one.
        table_force: Forces at them [N].
        tabulated: Whether the table holds for this thruster.
        inflow_loss: Share of the full force that is lost at full force for each m/s of water that comes along the push
            [s/m]; None: nothing is lost, and nothing is computed.
    """

    configuration: Configuration
    force_ahead: PerThruster
    force_astern: PerThruster
    exponent: PerThruster
    dead_band: PerThruster
    time_constant: PerThruster
    rate_limit: PerThruster
    quantisation: PerThruster
    health: PerThruster
    table_command: Float[Array, " k"]
    table_force: Float[Array, "n k"]
    tabulated: Bool[Array, " n"]
    inflow_loss: PerThruster | None = None

    @property
    def count(self) -> int:
        return self.configuration.shape[1]


def thrusters_from(
    configuration: Configuration,
    force_ahead: PerThruster,
    force_astern: PerThruster | None = None,
    **others: Array,
) -> Thrusters:
    """Thrusters with neutral values for what is not given: linear, no dead band, no lag, no limits, sound, no table."""
    n = configuration.shape[1]
    zeros, ones = as_array(np.zeros(n)), as_array(np.ones(n))
    neutral = {
        "exponent": ones,
        "dead_band": zeros,
        "time_constant": zeros,
        "rate_limit": as_array(np.full(n, np.inf)),
        "quantisation": zeros,
        "health": ones,
        "table_command": as_array([-1.0, 1.0]),
        "table_force": as_array(np.zeros((n, 2))),
        "tabulated": as_array(np.zeros(n), bool),
    }
    astern = force_ahead if force_astern is None else force_astern
    return Thrusters(configuration, force_ahead, astern, **(neutral | others))


def _has_tables(thrusters: Thrusters) -> bool:
    # A two-point table stands for "none": shapes are static, so no table code is compiled for such vehicles.
    return thrusters.table_command.shape[-1] > 2


def static_force(thrusters: Thrusters, u: PerThruster) -> PerThruster:
    """Force that each thruster settles at [N] for commands u; beyond +-1 they are clipped."""
    thrusters, u = in_numpy((thrusters, u))
    xp = module_for(thrusters, u)
    step = xp.where(thrusters.quantisation > 0, thrusters.quantisation, 1.0)
    u = xp.where(thrusters.quantisation > 0, xp.round(u / step) * step, u)
    u = xp.clip(u, -1.0, 1.0)  # last: rounding must not ask for more than there is
    x = (xp.abs(u) - thrusters.dead_band) / (1.0 - thrusters.dead_band)
    moving = x > 0.0
    # The inner `where` keeps the gradient of a power finite at zero.
    shape = xp.where(moving, xp.where(moving, x, 1.0) ** thrusters.exponent, 0.0)
    force = xp.where(u >= 0, thrusters.force_ahead, -thrusters.force_astern) * shape
    if _has_tables(thrusters):
        force = xp.where(thrusters.tabulated, _interpolate(thrusters.table_command, thrusters.table_force, u), force)
    return jnp.asarray(thrusters.health * force)


def _interpolate(
    grid: Float[HostArray, " k"], table: Float[HostArray, "n k"], u: Float[HostArray, " n"]
) -> Float[HostArray, " n"]:
    """Row i of the table at u_i, linearly on the increasing grid."""
    xp = module_for(grid, table, u)
    upper = xp.clip(xp.sum(grid[None, :] <= u[:, None], axis=1), 1, grid.shape[0] - 1)
    cell = xp.arange(grid.shape[0])[None, :]
    left, right = cell == upper[:, None] - 1, cell == upper[:, None]

    def pick(values: Float[HostArray, "#n k"], which: Bool[HostArray, "n k"]) -> Float[HostArray, " n"]:
        return xp.sum(xp.where(which, values, 0.0), axis=1)

    x0, x1 = pick(grid[None, :], left), pick(grid[None, :], right)
    f0, f1 = pick(table, left), pick(table, right)
    return f0 + (f1 - f0) * (u - x0) / (x1 - x0)


def command_for_force(thrusters: Thrusters, force: PerThruster) -> PerThruster:
    """Command that settles at the desired force: the inverse of `static_force` for sound thrusters.

    Forces beyond the limits give +-1; zero force gives zero command, any other one that clears the dead band.
    Health is not undone here: an autopilot does not know of a fault unless its model says so.
    """
    limit = jnp.where(force >= 0, thrusters.force_ahead, thrusters.force_astern)
    share = jnp.clip(jnp.abs(force) / jnp.where(limit > 0, limit, 1.0), 0.0, 1.0)
    some = share > 1e-9
    x = jnp.where(some, share, 1.0) ** (1.0 / thrusters.exponent)
    u = jnp.where(some, jnp.sign(force) * (thrusters.dead_band + (1.0 - thrusters.dead_band) * x), 0.0)
    if _has_tables(thrusters):
        u = jnp.where(thrusters.tabulated, _invert_tables(thrusters, force), u)
    return u


def _invert_tables(thrusters: Thrusters, force: PerThruster) -> PerThruster:
    """Command at a force, per thruster; a table is non-decreasing, and within its dead band the answer is zero."""
    grid, table = thrusters.table_command, thrusters.table_force
    f0, f1 = table[:, :-1], table[:, 1:]
    u0, u1 = grid[None, :-1], grid[None, 1:]
    rising = f1 > f0
    f = jnp.clip(force, table[:, 0], table[:, -1])[:, None]
    inside = rising & (f0 <= f) & (f <= f1)
    # Of the cells that hold the force, the one nearest zero command.
    cost = jnp.where(inside, jnp.minimum(jnp.abs(u0), jnp.abs(u1)), jnp.inf)
    chosen = jnp.arange(f0.shape[1])[None, :] == jnp.argmin(cost, axis=1)[:, None]
    u = u0 + (u1 - u0) * (f - f0) / jnp.where(rising, f1 - f0, 1.0)
    return jnp.where(jnp.abs(force) > 1e-9, jnp.sum(jnp.where(chosen, u, 0.0), axis=1), 0.0)


def lag(thrusters: Thrusters, force: Forces, target: Forces, dt: ScalarLike) -> Forces:
    """Force after dt [N]: exact first-order response to a constant target, then the rate limit.

    The thesis's (5.1) is the implicit Euler step of the same lag; this is exact at any step.
    """
    slow = thrusters.time_constant > 0
    decay = jnp.where(slow, jnp.exp(-dt / jnp.where(slow, thrusters.time_constant, 1.0)), 0.0)
    change = (1.0 - decay) * (target - force)
    room = thrusters.rate_limit * dt
    return force + jnp.clip(change, -room, room)


def force_just_after(thrusters: Thrusters, force: Forces, target: Forces) -> Forces:
    """Force right after a new target [N]: a thruster without lag and rate limit jumps, others stay."""
    jumps = (thrusters.time_constant <= 0) & jnp.isinf(thrusters.rate_limit)
    return jnp.where(jumps, target, force)


def half_steps(thrusters: Thrusters, force: Forces, target: Forces, dt: ScalarLike) -> tuple[Forces, Forces, Forces]:
    """Forces right after a new target, half of dt later, and dt later [N]: the lag is exact at each.

    Args:
        thrusters: With their lag.
        force: Before [N].
        target: That they settle at [N].
        dt: [s].
    """
    begin = force_just_after(thrusters, force, target)
    middle = lag(thrusters, begin, target, 0.5 * dt)
    return begin, middle, lag(thrusters, middle, target, 0.5 * dt)


def force_limits(thrusters: Thrusters) -> tuple[PerThruster, PerThruster]:
    """Lowest and highest force that commands reach [N]."""
    ones = np.ones(thrusters.force_ahead.shape, thrusters.force_ahead.dtype)
    return static_force(thrusters, jnp.asarray(-ones)), static_force(thrusters, jnp.asarray(ones))


def inflow_damping(thrusters: Thrusters, force: Forces) -> Forces:
    """Force that each thruster loses for each m/s of water along its push [N s/m], at forces [N].

    A propeller gives T_nn n|n| - T_nv |n| u: with n ~ sqrt(f) the loss grows with the square root of the force. Below a
    thousandth of the full force the root is straightened, so that its slope stays finite.

    Reference: Fossen (2021), sec. 9.1 (propeller thrust, linear in the advance speed).
    """
    assert thrusters.inflow_loss is not None
    full = jnp.where(force >= 0, thrusters.force_ahead, thrusters.force_astern)
    share = jnp.abs(force) / jnp.where(full > 0, full, 1.0)
    return thrusters.inflow_loss * full * share / jnp.sqrt(share + _STRAIGHT)


def inflow_wrench(configuration: Configuration, damping: PerThruster, nu_r: Vector6) -> Vector6:
    """What an inflow takes of the thrusters' wrench, b at CO [N, N m]: -T diag(d) T' nu_r, never a gain.

    T' nu_r is the speed of each thruster along its push, by the principle of work.

    Args:
        configuration: T.
        damping: d, see `inflow_damping`.
        nu_r: Velocity through the water, b at CO [m/s, rad/s].
    """
    return -configuration @ (damping * (configuration.T @ nu_r))
