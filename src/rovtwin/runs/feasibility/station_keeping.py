"""Whether a vehicle can hold its place in a sea and a current: required against available force, before anything flies.

Two questions, with two answers:

- What would keep it dead still? The wrench of the thrusters that makes nu_dot = 0 at nu = 0, time sample by time
  sample, from the same equations of motion that the twin flies: drag of the whole orbital velocity, Froude-Krylov and
  added-mass force of the whole acceleration.
- What keeps it there on average? A neutral vehicle that does not fight the waves is carried round with the water, and
  feels no force of them to first order. Left is the mean flow: the current, and the Stokes drift of what is carried
  round.

A vehicle whose thrusters meet the first holds its place if its autopilot can use them. One that meets only the second
stays about its place, swept to and fro by the waves as far as the water is. One that meets neither, but would with bow
or side turned into the mean flow, holds its place but not the heading: so does a vehicle without thrust in sway, and
one that a flow along its nose would tip over. One that does not even then drifts away, or, where neither righting
moment nor control stands up to the flow, pitches over, whatever its thrust.

Reference: Fossen (2021), ch. 10; Newman (1977), Marine Hydrodynamics, sec. 6.4 (Stokes drift).
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.block import Start
from rovtwin.core.flow import Environment
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import PRNGKey, Vector3, Vector6
from rovtwin.simulation.environment.airy import AirySea
from rovtwin.simulation.environment.world import World
from rovtwin.vehicle.analysis.stability import stability, steady_speed
from rovtwin.vehicle.physics.actuation import RANK_TOLERANCE, share_of_limits, wrench_limits
from rovtwin.vehicle.physics.dynamics import State, acceleration
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import Thrusters, force_limits

Verdict = Literal["holds", "swept", "turns", "drifts", "capsizes"]
HELD = np.array([0, 1, 2, 5])  # X, Y, Z, N: roll and pitch are left to the righting moment
SURGE, HEAVE = np.eye(6)[0], np.eye(6)[2]
NOTHING = 1e-3  # force or moment that need not be met [N, N m]
ROUNDING = 1e-9  # what weight and buoyancy leave of nothing [N, N m]
DRAGLESS = 20.0  # no current is looked for beyond this speed [m/s]
STILL = 99.0  # share of the time in which the thrusters must meet the waves for the vehicle to hold still [%]


@dataclass(frozen=True)
class Holding:
    """What one place and heading ask of a vehicle.

    Attributes:
        place: CO in n [m].
        heading: [rad].
        t: Time [s].
        required: Wrench that keeps the vehicle dead still, b at CO [N, N m].
        share: The largest share of its limit that any thruster needs for that; above 1 it cannot.
        mean_required: Wrench that keeps it there on average, in the mean current and Stokes drift.
        mean_share: The same share for it, in the 95th percentile of a current that varies.
        mean_flow: Current and Stokes drift, n [m/s].
        sweep: Rms of the water's way to and fro, horizontal and vertical [m].
        drift: Speed at which the vehicle is carried off in spite of full thrust [m/s]; 0 where it is not.
        available: Largest force along the horizontal force required, the way it is required or the lesser of both [N];
            in surge where none is.
        available_heave: Largest force in heave, both ways [N].
        other: Heading with the bow, or the side, into the mean flow, whichever is the easier to hold [rad].
        share_other: The share for the mean with that heading; inf where the flow tips the vehicle over.
        side: Whether it is the side.
        upright: Flow up to which righting moment and control keep it level, from where the mean flow comes, or along
            the nose where there is none [m/s].
        asked: Whether somebody asks for this heading; else it is the one that the vehicle starts with.
    """

    place: Float[np.ndarray, "3"]
    heading: float
    t: Float[np.ndarray, " n"]
    required: Float[np.ndarray, "n 6"]
    share: Float[np.ndarray, " n"]
    mean_required: Float[np.ndarray, "6"]
    mean_share: float
    mean_flow: Float[np.ndarray, "3"]
    sweep: Float[np.ndarray, "2"]
    drift: float
    available: float
    available_heave: float
    upright: float
    other: float
    share_other: float
    side: bool
    asked: bool = True

    @property
    def tips(self) -> bool:
        """Whether the flow, as far as it does not carry it off, tips it over."""
        stood_up_to = 1.0 - self.drift / max(float(np.linalg.norm(self.mean_flow)), 1e-9)
        return float(np.hypot(*self.mean_flow[:2])) * stood_up_to > self.upright

    @property
    def verdict(self) -> Verdict:
        """`holds`, `swept` (holds on average), `turns` (holds with another heading), `drifts` or `capsizes`."""
        if self.tips or self.mean_share > 1.0:
            return "turns" if self.share_other <= 1.0 else "capsizes" if self.tips else "drifts"
        return "holds" if at_most(self.share, STILL) <= 1.0 else "swept"

    @property
    def horizontal(self) -> Float[np.ndarray, " n"]:
        """Size of the horizontal force required [N]."""
        return np.hypot(self.required[:, 0], self.required[:, 1])


def holding(
    model: Model,
    world: World,
    key: PRNGKey,
    place: Any,
    heading: float,
    duration: float = 600.0,
    dt: float = 0.1,
    controlled: tuple[float, float] | None = None,
) -> Holding:
    """What it takes to hold a place and heading, level.

    Args:
        model: The vehicle.
        world: Current, waves and surface.
        key: Seeds the waves and a current that wanders.
        place: CO in n [m], shape (3,).
        heading: [rad].
        duration: Of the record [s].
        dt: Between its samples [s].
        controlled: Largest flows along the nose and from the side that the autopilot goes against [m/s], semi-axes of
            an ellipse, and it turns to whichever it stands up to; None: what rights it in pitch limits, and nothing
            turns it but its bow into the flow.
    """
    start = Start.at(place, heading)
    steps = max(2, round(duration / dt))
    state = State.at(model, start)
    required, current, wrench = (np.asarray(x) for x in _held(model, replace(world, walls=None), key, state, steps, dt))
    required = np.where(np.abs(required) < ROUNDING, 0.0, required)
    flow = current + _stokes_drift(world, float(start.position[2]))
    mean = flow.mean(axis=0)
    means = np.asarray(_in_mean_flow(model, state, jnp.asarray(flow), jnp.asarray(wrench.mean(axis=0))))
    most = at_most(thrust_share(model.thrusters, means), 95.0)
    upright = _upright(model, mean, heading, controlled)
    share, other, side = most, heading, False
    if most > 1.0 or float(np.hypot(*mean[:2])) > upright:
        share, other, side = _elsewhere(model, place, flow, heading, controlled)
    return Holding(
        place=np.asarray(start.position),
        heading=heading,
        t=np.arange(steps) * dt,
        required=required,
        share=thrust_share(model.thrusters, required),
        mean_required=means.mean(axis=0),
        mean_share=most,
        mean_flow=mean,
        sweep=_sweep(world, float(start.position[2])),
        drift=_drift(model, state, mean, wrench.mean(axis=0)),
        available=_force_along(model.thrusters, _mostly(required)),
        available_heave=_force_along(model.thrusters, np.stack([HEAVE, -HEAVE])),
        upright=upright,
        other=other,
        share_other=share,
        side=side,
    )


def _upright(
    model: Model, flow: Float[np.ndarray, "*axes 3"], heading: float, controlled: tuple[float, float] | None
) -> float:
    """As `Holding.upright`; a flow so large that thrust gives way first is for `Holding.tips` to judge."""
    from_astern = float(flow[0] * np.cos(heading) + flow[1] * np.sin(heading))
    if not np.any(flow[:2]):
        ahead, aside = 1.0, 0.0
    else:
        ahead = abs(from_astern) / float(np.hypot(*flow[:2]))
        aside = math.sqrt(max(1.0 - ahead**2, 0.0))
    if controlled is not None:
        return 1.0 / math.hypot(ahead / controlled[0], aside / controlled[1])
    # Water that runs towards the nose comes from astern: to it the vehicle goes backwards.
    return stability(model, astern=from_astern > 0).pitch_depth_held / ahead if ahead > 1e-6 else math.inf


def at_most(values: Float[np.ndarray, " n"], percent: float) -> float:
    """The least of the values that so many percent of them do not exceed; values may be infinite."""
    return float(np.sort(values)[max(math.ceil(0.01 * percent * len(values)) - 1, 0)])


def _elsewhere(
    model: Model, place: Any, flow: Float[np.ndarray, "n 3"], heading: float, controlled: tuple[float, float] | None
) -> tuple[float, float, bool]:
    """The share that flows (n, 3), as large as they come, take with bow or side into them, that heading, and which."""
    mean, speed = flow.mean(axis=0), at_most(np.hypot(flow[:, 0], flow[:, 1]), 95.0)
    into = float(np.arctan2(-mean[1], -mean[0]))
    level = controlled or (stability(model).pitch_depth_held, 0.0)
    found = [(math.inf, into, False)]
    for side, turned in ((False, 0.0), (True, 0.5 * math.pi), (True, -0.5 * math.pi)):
        if speed > level[side]:
            continue
        ahead = jnp.asarray([[-speed * math.cos(into), -speed * math.sin(into), float(mean[2])]])
        state = State.at(model, Start.at(place, into + turned))
        means = np.asarray(_in_mean_flow(model, state, ahead, jnp.zeros(6)))
        found.append((float(thrust_share(model.thrusters, means)[0]), into + turned, side))
    # With equal ease it turns to the nearer one.
    return min(found, key=lambda f: (round(f[0], 6), -math.cos(f[1] - heading)))


def stemmed(model: Model, directions: Any, controlled: tuple[float, float] | None = None) -> Float[np.ndarray, " n"]:
    """Largest steady currents that thrusters stem, level, other axes and the heading held too [m/s], shape (n,).

    Args:
        model: The vehicle.
        directions: From which each comes, off the bow to starboard [rad], shape (n,).
        controlled: As in `holding`.
    """
    directions, stems = np.asarray(directions, dtype=float), stemmed_by_thrust(model, directions)
    ahead, aside = np.abs(np.cos(directions)), np.abs(np.sin(directions))
    if controlled is not None:  # an ellipse, as the autopilot's level speeds
        return np.minimum(stems, 1.0 / np.maximum(np.hypot(ahead / controlled[0], aside / controlled[1]), 1e-6))
    upright = [stability(model, astern=bool(np.cos(d) < 0.0)).pitch_depth_held for d in directions]
    return np.minimum(stems, np.asarray(upright) / np.maximum(ahead, 1e-6))


def stemmed_by_thrust(model: Model, directions: Any) -> Float[np.ndarray, " n"]:
    """The same if nothing tipped the vehicle over, shape (n,); arguments are those of `stemmed`."""
    directions, speeds = np.asarray(directions, dtype=float), np.linspace(0.0, _fastest(model), 201)
    state = State.at(model, Start.at((0.0, 0.0, 10.0 * float(model.hull.radius) + 1.0), 0.0))
    from_there = -np.stack([np.cos(directions), np.sin(directions), np.zeros_like(directions)], axis=1)
    flow = (from_there[:, None] * speeds[:, None]).reshape(-1, 3)
    tau = np.asarray(_in_mean_flow(model, state, jnp.asarray(flow), jnp.zeros(6)))
    within = thrust_share(model.thrusters, tau).reshape(len(directions), -1) <= 1.0
    first_beyond = np.where(within.all(axis=1), len(speeds), np.argmin(within, axis=1))
    return np.where(first_beyond > 0, speeds[np.maximum(first_beyond - 1, 0)], 0.0)


def _fastest(model: Model) -> float:
    """More than any top speed in surge or sway [m/s]."""
    low, high = (np.asarray(limit) for limit in wrench_limits(model.thrusters))
    tops = [steady_speed(model, axis, float(force)) for axis in (0, 1) for force in (low[axis], high[axis])]
    return 1.05 * min(max(tops), DRAGLESS)


@eqx.filter_jit
def _held(
    model: Model, world: World, key: PRNGKey, state: State, steps: int, dt: float
) -> tuple[Float[Array, "steps 6"], Float[Array, "steps 3"], Float[Array, "steps 6"]]:
    """Required wrench (steps, 6), current (steps, 3) in n and external wrench (steps, 6) on a vehicle held still."""

    def step(memory: Any, _: None) -> tuple[Any, tuple[Vector6, Vector3, Vector6]]:
        current = jnp.zeros(3)
        if world.current is not None:
            current = world.current.step(memory.current, state.position, dt)[1].velocity
        memory, environment = world.step(memory, state, dt)
        return memory, (_required(model, state, environment), current, environment.wrench)

    begin = world.init(key, Start(state.position, state.attitude, state.nu))
    return jax.lax.scan(step, begin, None, length=steps)[1]


def _required(model: Model, state: State, environment: Environment) -> Vector6:
    """-M nu_dot at nu = 0 without thrust: exact, for nu_dot is linear in the thrusters' wrench."""
    nu_dot = acceleration(model, state.position, state.attitude, jnp.zeros(6), jnp.zeros(6), environment)
    return -model.inertia @ nu_dot


@jax.jit
def _in_mean_flow(model: Model, state: State, flow: Float[Array, "n 3"], wrench: Vector6) -> Float[Array, "n 6"]:
    """Required wrench (n, 6) in steady flows (n, 3) in n."""

    def one(velocity: Vector3) -> Vector6:
        return _required(model, state, Environment.calm(velocity=velocity, wrench=wrench, place=state.position))

    return jax.vmap(one)(flow)


def thrust_share(thrusters: Thrusters, tau: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, " n"]:
    """Largest share of its limit that any thruster needs for each wrench.

    Forces and yaw moment only, shared out as well as can be; inf where thrusters cannot push that way at all.
    """
    T = (np.asarray(thrusters.configuration) * np.asarray(thrusters.health))[HELD]
    required = np.asarray(tau)[:, HELD]
    met = required @ (T @ np.linalg.pinv(T, rcond=RANK_TOLERANCE)).T
    low, high = (np.asarray(limit) for limit in force_limits(_sound(thrusters)))
    unmet = _beyond(required, met, slice(0, 3)) | _beyond(required, met, slice(3, 4))
    return np.where(unmet, np.inf, share_of_limits(T, low, high, met))


def _beyond(required: Float[np.ndarray, "n 4"], met: Float[np.ndarray, "n 4"], part: slice) -> Bool[np.ndarray, " n"]:
    """Whether more than 1 % of the forces, or of the moment, is missing."""
    missing, whole = (np.abs(x[:, part]).max(axis=1) for x in (required - met, required))
    return missing > 0.01 * whole + NOTHING


def _sound(thrusters: Thrusters) -> Thrusters:
    return eqx.tree_at(lambda t: t.health, thrusters, jnp.ones_like(thrusters.health))


def _mostly(required: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "ways 6"]:
    """Unit wrenches in which the horizontal force mostly points, to and fro if it does.

    Surge, both ways, where there is none.
    """
    push = required[:, :2]
    if np.abs(push).max() < NOTHING:
        return np.stack([SURGE, -SURGE])
    axis = np.concatenate([np.linalg.eigh(push.T @ push)[1][:, -1], np.zeros(4)])
    along = push @ axis[:2]
    return np.stack([way * axis for way in (1.0, -1.0) if (way * along).max() > NOTHING])


def _force_along(thrusters: Thrusters, units: Float[np.ndarray, "n 6"]) -> float:
    """Largest force along unit wrenches (n, 6), the least of them [N]."""
    return float((1.0 / thrust_share(thrusters, units)).min())


def _drift(model: Model, state: State, flow: Float[np.ndarray, "3"], wrench: Float[np.ndarray, "6"]) -> float:
    """What is left of the mean flow after the largest share of it that full thrust can stand up to [m/s]."""
    shares = np.linspace(0.0, 1.0, 201)
    tau = np.asarray(_in_mean_flow(model, state, jnp.asarray(shares[:, None] * flow), jnp.asarray(wrench)))
    within = np.flatnonzero(thrust_share(model.thrusters, tau) <= 1.0)
    kept = shares[within[-1]] if within.size else 0.0
    return float((1.0 - kept) * np.linalg.norm(flow))


def _stokes_drift(world: World, z: float) -> Float[np.ndarray, "3"]:
    """Mean velocity of water particles in waves, n [m/s]."""
    sea = world.waves
    if not isinstance(sea, AirySea):
        return np.zeros(3)
    a, omega, k, direction = (np.asarray(x) for x in (sea.amplitude, sea.omega, sea.wavenumber, sea.direction))
    C, S = (np.asarray(x) for x in sea.decay(as_array(max(z, 0.0))))
    speed = 0.5 * a**2 * omega * k * (C**2 + S**2)  # cosh 2x = cosh^2 x + sinh^2 x
    return np.array([speed @ np.cos(direction), speed @ np.sin(direction), 0.0])


def _sweep(world: World, z: float) -> Float[np.ndarray, "2"]:
    """Rms of the displacement of water particles, horizontal and vertical [m]."""
    sea = world.waves
    if not isinstance(sea, AirySea):
        return np.zeros(2)
    a = np.asarray(sea.amplitude)
    return np.array([np.sqrt(0.5 * np.sum((a * np.asarray(x)) ** 2)) for x in sea.decay(as_array(max(z, 0.0)))])
