"""How a vehicle hangs and swings in the water: trim, stiffness, natural periods, stability at speed.

A body with more added mass in heave than in surge is turned across its path when it moves (Munk moment). In pitch the
righting moment B x BG works against it. Two speeds matter:

- with depth held (an autopilot keeps the path level, so w = u theta) pitch diverges above
  u = sqrt(k_theta / (A33 - A11)): the static criterion;
- left free, the vehicle heaves along with its pitch and the motion stays stable longer: eigenvalues tell.

Reference: Fossen (2021), ch. 4 and 6; Munk (1924), NACA report 184.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Environment
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.programs.compiled import jit_once
from rovtwin.core.programs.values import once_and_for_all
from rovtwin.core.types import Scalar
from rovtwin.vehicle.analysis.hydrostatics import floating
from rovtwin.vehicle.physics.actuation import pushed_axes, wrench_limits, wrench_of_forces
from rovtwin.vehicle.physics.dynamics import acceleration, speed_of_drag
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import inflow_damping, thrusters_from

SPEED_LIMIT = 3.0  # stability is looked for up to here [m/s]
LONGITUDINAL = (0, 2, 4, 7)  # u, w, q, theta in the state of `linearised`
LATERAL = (1, 3, 5, 6)  # v, p, r, phi


@dataclass(frozen=True)
class Hydrostatics:
    """How the vehicle rests in still water, thrusters off.

    Attributes:
        stiffness: Righting moment per angle about level, roll and pitch [N m/rad].
        metacentric_height: BG, how far CB is above CG along z [m].
        trim: Roll and pitch at which it comes to rest [rad]; NaN where weight and buoyancy give no moment.
        net_buoyancy: B - W, positive floats [N].
        periods: Undamped natural periods in roll and pitch [s]; NaN where there is no righting moment.
    """

    stiffness: Float[np.ndarray, "2"]
    metacentric_height: float
    trim: Float[np.ndarray, "2"]
    net_buoyancy: float
    periods: Float[np.ndarray, "2"]


def hang(model: Model) -> Hydrostatics:
    """Still water: trim, stiffness and natural periods."""
    r_g, r_b = np.asarray(model.center_of_gravity), np.asarray(model.center_of_buoyancy)
    rest = floating(float(model.weight), float(model.buoyancy), r_g, r_b)
    M = np.asarray(model.inertia)
    G = np.zeros((6, 6))
    G[3, 3], G[4, 4] = rest.stiffness
    squares, vectors = _eigen(np.linalg.solve(M, G))
    periods = np.full(2, np.nan)
    for square, vector in zip(np.real(squares), np.real(vectors).T, strict=True):
        if square > 1e-12:
            axis = 0 if abs(vector[3]) >= abs(vector[4]) else 1
            periods[axis] = 2 * np.pi / np.sqrt(square)
    return Hydrostatics(rest.stiffness, rest.metacentric_height, rest.trim, rest.net_buoyancy, periods)


def afloat(model: Model) -> float:
    """Depth of CO at which the level vehicle floats [m]; where it does not float, at which its top touches the surface.

    The rise of the hull's elements is piecewise linear and monotone: bisection finds it to rounding.
    """
    hull, r_b = model.hull, np.asarray(model.center_of_buoyancy)
    z, reach, shares = r_b[2] + np.asarray(hull.offsets)[:, 2], np.asarray(hull.reach), np.asarray(hull.shares)
    lowest, highest = float((-z - reach).min()), float((-z + reach).max())
    share = min(max(1.0 - float(model.weight) / float(model.buoyancy), 0.0), 1.0) if float(model.buoyancy) > 0 else 0.0
    for _ in range(60):
        middle = 0.5 * (lowest + highest)
        dry = shares @ np.clip(0.5 - 0.5 * (middle + z) / reach, 0.0, 1.0)
        lowest, highest = (middle, highest) if dry > share else (lowest, middle)
    return highest


def by_products(model: Model) -> Float[np.ndarray, "2 3"]:
    """Moment in roll and pitch about CG that comes with a force along X, Y and Z [m].

    Zero for an axis that has thrusters of its own: they balance it.
    """
    made = wrench_of_forces(model)
    about_cg = made[3:] - np.cross(np.asarray(model.center_of_gravity), made[:3], axisb=0, axisc=0)
    return np.where(pushed_axes(model)[3:5, None], 0.0, about_cg[:2])


def tilt_of_thrust(model: Model) -> Float[np.ndarray, "2 3"]:
    """Roll and pitch to which all thrust ahead, aside, and up or down brings it [rad].

    Zero where other thrusters balance it, and where nothing rights the vehicle.
    """
    moment = np.abs(by_products(model)) * np.abs(reach(model)[:3]).max(axis=1)
    stiffness = hang(model).stiffness[:, None]
    return np.where(stiffness > 0.0, np.arctan2(moment, np.maximum(stiffness, 1e-12)), 0.0)


def linearised(model: Model, surge_speed: Scalar) -> Float[Array, "8 8"]:
    """A of the small motions x = [nu, phi, theta] about level flight at a steady surge speed.

    The thrust that keeps the speed is held: it drops out of the differences.
    """

    def rate(x: Float[Array, "8"]) -> Float[Array, "8"]:
        zero = jnp.zeros(())
        q = quaternion_from_euler(jnp.stack([x[6], x[7], zero]))
        # Level at phi = theta = 0: theta_dot = q, phi_dot = p to first order.
        nu_dot = acceleration(model, jnp.zeros(3), q, x[:6], jnp.zeros(6), Environment.calm())
        return jnp.concatenate([nu_dot, x[3:5]])

    start = jnp.zeros(8).at[0].set(surge_speed)
    return jax.jacfwd(rate)(start)


_linearised_at = jit_once(jax.vmap(linearised, in_axes=(None, 0)))


def linearised_at(model: Model, surge_speeds: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 8 8"]:
    """A of `linearised` at several surge speeds."""
    # Thrust is held, so thrusters play no part: without them one compiled function serves all vehicles.
    bare = eqx.tree_at(lambda m: m.thrusters, model, thrusters_from(as_array(np.zeros((6, 0))), as_array(np.zeros(0))))
    return np.asarray(_linearised_at(bare, as_array(surge_speeds)))


def depth_held(model: Model, A: Float[np.ndarray, "8 8"], surge_speed: float) -> Float[np.ndarray, "8 8"]:
    """A of the same motions when a heave force keeps the depth: w = u theta."""
    push = np.concatenate([np.asarray(model.inertia_inverse)[:, 2], np.zeros(2)])
    kept = np.zeros(8)
    kept[2], kept[7] = 1.0, -surge_speed
    return (np.eye(8) - np.outer(push, kept) / (kept @ push)) @ A


@dataclass(frozen=True)
class Stability:
    """Up to which surge speed small motions die out; inf: everywhere up to SPEED_LIMIT.

    Attributes:
        munk_pitch: Heave less surge added mass, A33 - A11 [kg]: what turns the nose away when positive.
        munk_yaw: Sway less surge added mass, A22 - A11 [kg]; nothing rights a vehicle in yaw.
        munk_roll: Heave less sway added mass, A33 - A22 [kg]: what rolls it further when it goes sideways.
        roll_static: The same as `pitch_static` going sideways, sqrt(k_phi / (A33 - A22)) [m/s].
        pitch_static: sqrt(k_theta / (A33 - A11)) [m/s].
        pitch_depth_held: Lowest speed at which pitch grows while depth is held [m/s].
        pitch_free: Lowest speed at which pitch and heave grow when left free [m/s].
        yaw_free: Lowest speed at which yaw, sway and roll grow when left free [m/s].
    """

    munk_pitch: float
    munk_yaw: float
    munk_roll: float
    roll_static: float
    pitch_static: float
    pitch_depth_held: float
    pitch_free: float
    yaw_free: float


@once_and_for_all
def stability(model: Model, astern: bool = False) -> Stability:
    """Stability of straight level flight, thrust held; `astern`: of flight backwards."""
    sense = -1.0 if astern else 1.0
    M = np.asarray(model.added_mass)
    munk = M.diagonal()[1:3] - M[0, 0]
    across = float(M[2, 2] - M[1, 1])
    stiffness = np.maximum(hang(model).stiffness, 0.0)
    static = float(np.sqrt(stiffness[1] / munk[1])) if munk[1] > 0 else np.inf
    aside = float(np.sqrt(stiffness[0] / across)) if across > 0 else np.inf
    speeds = np.linspace(0.0, SPEED_LIMIT, 151)[1:]
    slow, fast = linearised_at(model, sense * np.array([0.5, 1.5]))

    def free(u: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 8 8"]:
        # Coriolis and quadratic damping are quadratic in nu: A is a straight line in the surge speed, each way.
        return slow + (u[:, None, None] - 0.5) * (fast - slow)

    def held(u: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k 8 8"]:
        return np.stack([depth_held(model, A, sense * speed) for A, speed in zip(free(u), u, strict=True)])

    return Stability(
        float(munk[1]),
        float(munk[0]),
        across,
        aside,
        static,
        _first_unstable(held, LONGITUDINAL, speeds),
        _first_unstable(free, LONGITUDINAL, speeds),
        _first_unstable(free, LATERAL, speeds),
    )


def _eigen(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Complex eigenvalues and eigenvectors."""
    values, vectors = np.linalg.eig(A)
    return np.asarray(values, dtype=complex), np.asarray(vectors, dtype=complex)


def growth(A: Float[np.ndarray, "n n"], states: tuple[int, ...]) -> float:
    """Largest real part [1/s] of the eigenvalues whose motion is mostly in some of the states."""
    values, vectors = _eigen(A)
    share = np.abs(vectors) ** 2
    mine = share[list(states)].sum(axis=0) >= 0.5 * share.sum(axis=0)
    return float(np.real(values)[mine].max()) if mine.any() else -np.inf


def _first_unstable(
    matrices: Callable[[Float[np.ndarray, " k"]], Float[np.ndarray, "k 8 8"]],
    states: tuple[int, ...],
    speeds: Float[np.ndarray, " k"],
) -> float:
    """The lowest speed at which something grows: a grid, refined twice around the first unstable one."""
    # Damping of zero and what the depth constraint removes leave eigenvalues that are zero but for rounding.
    neutral = 1e-7
    high = np.inf
    for _ in range(3):
        rates = np.array([growth(A, states) for A in matrices(speeds)])
        unstable = np.flatnonzero(rates > neutral)
        if not unstable.size:
            return high
        first = int(unstable[0])
        high = float(speeds[first])
        low = float(speeds[first - 1]) if first else 0.0
        speeds = np.linspace(low, high, speeds.size + 1)[1:]
    return high


def reach(model: Model) -> Float[np.ndarray, "6 2"]:
    """Largest forces and moments of all thrusters together: negative and positive [N, N m].

    Each direction by itself: what the same thrusters do elsewhere is not balanced.
    """
    return np.stack([np.asarray(limit) for limit in wrench_limits(model.thrusters)], axis=1)


def steady_speed(model: Model, axis: int, force: float, thrust: bool = True) -> float:
    """Speed at which damping, and what an inflow takes of the thrust, balance a force along one axis; inf without.

    Args:
        model: The vehicle.
        axis: Of nu; the speed is in m/s or rad/s.
        force: Along the axis [N, N m]; of thrusters, before the inflow, each giving the same share of its largest.
        thrust: Whether thrusters give it; False for buoyancy and the like, of which an inflow takes nothing.
    """
    ahead = force >= 0
    linear = model.linear_damping_ahead if ahead else model.linear_damping_astern
    quadratic = model.quadratic_damping_ahead if ahead else model.quadratic_damping_astern
    l, q = float(np.asarray(linear)[axis, axis]), float(np.asarray(quadratic)[axis, axis])
    size = abs(force)
    l += _lost_along(model, axis, force) if thrust else 0.0
    if size == 0.0:
        return 0.0
    if math.isinf(size) or (q <= 0.0 and l <= 0.0):
        return np.inf
    return float(speed_of_drag(l, max(q, 0.0), size))


def _lost_along(model: Model, axis: int, force: float) -> float:
    """What an inflow takes of a force along one axis for each m/s or rad/s [N s/m, N m s/rad]."""
    thrusters = model.thrusters
    if thrusters.inflow_loss is None or force == 0.0:
        return 0.0
    lever = math.copysign(1.0, force) * np.asarray(thrusters.configuration)[axis]
    full = np.where(lever >= 0, np.asarray(thrusters.force_ahead), np.asarray(thrusters.force_astern))
    most = float(np.abs(lever) @ full)
    share = min(abs(force) / most, 1.0) if most > 0 else 0.0
    damping = np.asarray(inflow_damping(thrusters, as_array(np.sign(lever) * share * full)))
    return float(lever**2 @ damping)
