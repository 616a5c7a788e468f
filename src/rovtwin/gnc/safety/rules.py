"""What a supervisor watches, how long it has to last, what is done about it: a row for each of core.flow.REASONS."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core import flow
from rovtwin.core.flow import REASONS, Estimate, Host, Measurements, Slot
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.sensors import kind_of
from rovtwin.core.types import Flag, Index, Scalar, Vector2, Vector3, Vector6
from rovtwin.gnc.safety.control_authority import FINE
from rovtwin.gnc.safety.off_course import OffCourse

ACTIONS = ("ignore", "hold", "return", "surface", "stop")
IGNORE, HOLD_STATION, RETURN_HOME, SURFACE, STOP = range(len(ACTIONS))

NIS_WINDOW = 40.0  # innovations over which positions are compared with what the filter says of itself: 20 s at 1 Hz
FAR = 1e6  # from the floor, as long as no altimeter says [m]
FEW = 8.0  # innovations in it, below which nothing is said
REMEMBERED = ("leak", "battery", "altimeter")  # kinds whose last reading counts until the next one
VITAL = ("attitude", "pressure")  # sensors without which the filter does not know which way is up, or how deep it is


class Rule(NamedTuple):
    """A limit, how long it has to be passed [s], and one of ACTIONS. What the limit is of: see `RULES`."""

    limit: float
    after: float
    action: str


RULES: dict[str, Rule] = {
    "not a number": Rule(np.nan, 0.0, "stop"),
    "operator": Rule(np.nan, 0.0, "stop"),
    "depth limit": Rule(100.0, 0.0, "stop"),  # [m]
    "attitude limit": Rule(np.radians(60.0), 0.0, "stop"),  # tilt, of z of b from the vertical [rad]
    "estimate lost": Rule(10.0, 0.0, "stop"),  # standard deviation of any axis of the position [m]
    "leak": Rule(np.nan, 0.2, "surface"),
    "battery critical": Rule(0.10, 5.0, "surface"),  # charge of the emptiest battery, share
    "filter diverged": Rule(6.0, 10.0, "surface"),  # mean squared normalised innovation of a position, by axis
    "positions lost": Rule(120.0, 0.0, "surface"),  # since the last one that the filter accepted [s]
    "thruster failed": Rule(np.nan, 0.0, "surface"),  # and what is left is too little to go on
    "saturated": Rule(np.nan, 30.0, "surface"),  # wrench short of what the controller wants
    "link lost": Rule(5.0, 0.0, "surface"),  # since anything came from the vehicle [s]
    "deadline missed": Rule(5.0, 1.0, "surface"),  # lateness of ticks, in control periods
    "battery low": Rule(0.20, 5.0, "return"),
    "geofence": Rule(np.inf, 1.0, "return"),  # distance from the start [m]
    "altitude limit": Rule(0.0, 0.5, "hold"),  # least distance to the floor [m]
    "time out": Rule(np.inf, 0.0, "return"),  # since the mission began [s]
    "operator silent": Rule(60.0, 0.0, "hold"),  # since the operator's last sign of life [s]
    "no way home": Rule(60.0, 0.0, "surface"),  # since the vehicle last came nearer while it returns [s]
    "sensor silent": Rule(3.0, 0.0, "surface"),  # since attitude or depth was last reported [s]
    # Distance from the set-point beyond which the vehicle has to come nearer [m]: `off_course`, from the vehicle.
    "off course": Rule(np.inf, 30.0, "return"),
    "off depth": Rule(np.inf, 30.0, "return"),
}


class Rules(eqx.Module):
    """The table as arrays, a row for each of REASONS.

    Attributes:
        limit: Threshold of each row's condition.
        after: How long it has to hold [s].
        action: Index of ACTIONS.
        fence: Corners of a polygon in which the vehicle has to stay, n [m], or None.
        allowance: Part of each axis's wrench that may be short without counting as saturated [N, N m].
        nearer: Of a return: by how much nearer to home counts as nearer, and how near as there [m].
        step: Off course: by how much nearer to the set-point counts as nearer [m].
        sensors: Names of those on board, of which each of REMEMBERED is remembered by itself.
    """

    limit: Float[Array, " r"]
    after: Float[Array, " r"]
    action: Int[Array, " r"]
    fence: Float[Array, "m 2"] | None
    allowance: Vector6
    nearer: Scalar
    step: Scalar
    sensors: tuple[str, ...] = eqx.field(static=True, default=REMEMBERED)

    @classmethod
    def of(
        cls,
        changes: Mapping[str, Rule] = {},
        fence: Any = None,
        allowance: Any = np.inf,
        nearer: float = 0.5,
        sensors: Iterable[str] = REMEMBERED,
        step: float = 0.5,
    ) -> "Rules":
        """`RULES` with changes by name."""
        rows = [Rule(np.nan, 0.0, "ignore"), *(changes.get(name, RULES[name]) for name in REASONS[1:])]
        return cls(
            limit=as_array([row.limit for row in rows]),
            after=as_array([row.after for row in rows]),
            action=jnp.asarray([ACTIONS.index(row.action) for row in rows]),
            fence=None if fence is None else as_array(fence),
            allowance=as_array(np.broadcast_to(allowance, 6)),
            nearer=as_array(nearer),
            step=as_array(step),
            sensors=tuple(sensors),
        )

    def names_of(self, kind: str) -> list[str]:
        """Names of the sensors of a kind; the kind itself where none is on board."""
        return _of_kind(self.sensors, kind) or [kind]

    def only_stop(self) -> "Rules":
        """The same where nothing but switching thrusters off can be done: tests of a vehicle without a filter."""
        return eqx.tree_at(lambda r: r.action, self, jnp.where(self.action > IGNORE, STOP, IGNORE))


class SupervisorInput(eqx.Module):
    """What there is to judge.

    Attributes:
        estimate: The observer's.
        request: The operator's.
        measurements: As they came; sensors of the kinds position, REMEMBERED and VITAL are looked at.
        host: Ages and lateness.
        shortfall: Wrench that thrusters did not make in the last tick, b [N, N m].
        ability: FINE, UNABLE or HEAVE_LOST, see `control_authority`.
        saturated: Axes on which a limit cut what the controller asked for.
        desired_position: Place of the last tick's set-point, n [m]; NaN where there is none.
        failed: Whether a block of somebody else has given what is no number; None: there are none.
    """

    estimate: Estimate
    request: Index
    measurements: Measurements = eqx.field(default_factory=dict)
    host: Host = eqx.field(default_factory=Host)
    shortfall: Vector6 = eqx.field(default_factory=lambda: jnp.zeros(6))
    ability: Index = eqx.field(default_factory=lambda: jnp.asarray(FINE))
    saturated: Bool[Array, "6"] = eqx.field(default_factory=lambda: jnp.zeros(6, dtype=bool))
    desired_position: Vector3 = eqx.field(default_factory=lambda: jnp.full(3, jnp.nan))
    failed: Flag | None = None


class Watch(eqx.Module):
    """What is remembered to judge by.

    Attributes:
        lasting: How long each row's condition has held [s].
        home: Where it began, n [m].
        elapsed: Since the mission began [s].
        leak: Whether water was last said to come in by each sensor.
        charge: As each battery's sensor last said, share.
        altitude: As each altimeter last said [m].
        silence: Since a position was accepted [s].
        nearest: How near it came to home on its way there [m].
        stalled: Since it last came nearer [s].
        quiet: Since each of VITAL was received [s].
        nis: Fading sum of the positions' squared normalised innovations, and of their number.
        dof: See `nis`.
        course: How near the vehicle came to its set-point while it is off it.
    """

    lasting: Float[Array, " r"]
    home: Vector2
    elapsed: Scalar
    leak: Bool[Array, " k"]
    charge: Float[Array, " k"]
    altitude: Float[Array, " k"]
    silence: Scalar
    nearest: Scalar
    stalled: Scalar
    quiet: Vector2
    nis: Scalar
    dof: Scalar
    course: OffCourse

    @classmethod
    def at(cls, home: Vector2, rules: Rules) -> "Watch":
        """Nothing seen yet."""
        zero, quiet = jnp.zeros(()), jnp.zeros(len(VITAL))
        leaks, batteries, altimeters = (len(rules.names_of(kind)) for kind in REMEMBERED)
        no, full, high = jnp.zeros(leaks, dtype=bool), jnp.ones(batteries), jnp.full(altimeters, FAR)
        initial = no, full, high, zero, zero + FAR, zero, quiet, zero, zero
        return cls(jnp.zeros(len(REASONS)), home, zero, *initial, OffCourse.none())

    def step(self, rules: Rules, input: SupervisorInput, begun: Flag, returning: Flag, dt: float) -> "Watch":
        """A tick later; whether the mission has begun, and whether the vehicle is on its way home."""
        measurements, estimate = input.measurements, input.estimate
        received, squares = jnp.zeros(()), jnp.zeros(())
        names = sorted(measurements)
        positions = _of_kind(names, "position")
        for name in positions:
            k = names.index(name)
            received, squares = received + estimate.nis_dof[k], squares + estimate.nis[k]
        leaks, batteries, altimeters = (rules.names_of(kind) for kind in REMEMBERED)
        fade = jnp.exp(-received / NIS_WINDOW)  # by number, not by time: rare positions tell, too
        waited = jnp.where(begun, dt, 0.0) if positions else 0.0
        off = estimate.position[:2] - self.home
        off = jnp.sqrt(off @ off)
        nearer = off < self.nearest - rules.nearer
        limits = rules.limit[flow.OFF_COURSE : flow.OFF_DEPTH + 1]
        course, astray = self.course.step(input.desired_position, estimate, limits, rules.step)
        seen = Watch(
            lasting=self.lasting,
            home=self.home,
            # Who arms again winds the mission's clock up again.
            elapsed=jnp.where(input.request == flow.ARM, 0.0, self.elapsed + jnp.where(begun, dt, 0.0)),
            leak=_last(measurements, leaks, self.leak.astype(self.charge.dtype)) > 0.5,
            charge=_last(measurements, batteries, self.charge),
            altitude=_last(measurements, altimeters, self.altitude),
            silence=jnp.where(received > 0.0, 0.0, self.silence + waited),
            nearest=jnp.where(returning, jnp.where(nearer, off, self.nearest), FAR),
            stalled=jnp.where(returning & ~nearer & (off > rules.nearer), self.stalled + dt, 0.0),
            quiet=jnp.where(_spoke(measurements), 0.0, self.quiet + jnp.where(begun, dt, 0.0)),
            nis=fade * self.nis + squares,
            dof=fade * self.dof + received,
            course=course,
        )
        lasting = jnp.where(seen._conditions(rules, input, astray), self.lasting + dt, 0.0)
        return eqx.tree_at(lambda w: w.lasting, seen, lasting)

    def triggered(self, rules: Rules) -> Int[Array, " r"]:
        """Action that each row asks for now."""
        return jnp.where((self.lasting > 0.0) & (self.lasting > rules.after), rules.action, IGNORE)

    def _conditions(self, rules: Rules, input: SupervisorInput, astray: Bool[Array, "2"]) -> Bool[Array, " r"]:
        """Which rows hold now. A comparison with NaN is false: that row asks for it by name."""
        estimate, host = input.estimate, input.host
        spread = jnp.sqrt(jnp.max(jnp.diagonal(estimate.covariance)[:3]))
        place = estimate.position[:2]
        off = place - self.home
        half_sine = estimate.attitude[1:3]  # x and y of the quaternion: their length is the sine of half the tilt
        short = jnp.any(jnp.abs(input.shortfall) > rules.allowance)
        short = short | jnp.any(input.saturated & jnp.isfinite(rules.allowance))
        outside = jnp.sqrt(off @ off) > rules.limit[flow.GEOFENCE]
        if rules.fence is not None:
            outside = outside | ~inside(rules.fence, place)
        found: dict[int, Any] = {
            flow.NO_REASON: False,
            flow.NOT_A_NUMBER: ~is_finite(estimate) if input.failed is None else ~is_finite(estimate) | input.failed,
            flow.OPERATOR: input.request == flow.ABORT,
            flow.DEPTH_LIMIT: estimate.position[2] > rules.limit[flow.DEPTH_LIMIT],
            # The tilt and not roll or pitch, of which noise makes anything near a pitch of 90 degrees.
            flow.ATTITUDE_LIMIT: half_sine @ half_sine > jnp.sin(0.5 * rules.limit[flow.ATTITUDE_LIMIT]) ** 2,
            # A variance that is negative has no root, and is no knowledge either.
            flow.ESTIMATE_LOST: ~(spread <= rules.limit[flow.ESTIMATE_LOST]),
            flow.LEAK: jnp.any(self.leak),
            flow.BATTERY_CRITICAL: jnp.min(self.charge) < rules.limit[flow.BATTERY_CRITICAL],
            flow.FILTER_DIVERGED: (self.dof > FEW) & (self.nis > rules.limit[flow.FILTER_DIVERGED] * self.dof),
            flow.POSITIONS_LOST: self.silence > rules.limit[flow.POSITIONS_LOST],
            flow.THRUSTER_FAILED: input.ability != FINE,
            flow.SATURATED: short,
            flow.LINK_LOST: host.link_age > rules.limit[flow.LINK_LOST],
            flow.DEADLINE_MISSED: host.lateness > rules.limit[flow.DEADLINE_MISSED],
            flow.BATTERY_LOW: jnp.min(self.charge) < rules.limit[flow.BATTERY_LOW],
            flow.GEOFENCE: outside,
            flow.ALTITUDE_LIMIT: jnp.min(self.altitude) < rules.limit[flow.ALTITUDE_LIMIT],
            flow.TIME_OUT: self.elapsed > rules.limit[flow.TIME_OUT],
            flow.OPERATOR_SILENT: host.operator_age > rules.limit[flow.OPERATOR_SILENT],
            flow.NO_WAY_HOME: self.stalled > rules.limit[flow.NO_WAY_HOME],
            flow.SENSOR_SILENT: jnp.any(self.quiet > rules.limit[flow.SENSOR_SILENT]),
            flow.OFF_COURSE: astray[0],
            flow.OFF_DEPTH: astray[1],
        }
        return jnp.stack([jnp.asarray(found[row]) for row in range(len(REASONS))])


def inside(corners: Float[Array, "m 2"], place: Vector2) -> Flag:
    """Whether a place is within a polygon: does a ray to the east cross an odd number of edges."""
    ahead = jnp.roll(corners, -1, axis=0)
    crosses = (corners[:, 0] > place[0]) != (ahead[:, 0] > place[0])
    rise = jnp.where(crosses, ahead[:, 0] - corners[:, 0], 1.0)
    east = corners[:, 1] + (place[0] - corners[:, 0]) / rise * (ahead[:, 1] - corners[:, 1])
    return jnp.sum(crosses & (east > place[1])) % 2 == 1


def is_finite(estimate: Estimate) -> Flag:
    """Whether pose, velocity, disturbance, covariance and waves are all numbers."""
    parts = (estimate.position, estimate.attitude, estimate.nu, estimate.bias, estimate.covariance, estimate.wave)
    return jnp.all(jnp.array([jnp.all(jnp.isfinite(part)) for part in parts]))


def _spoke(measurements: Measurements) -> Bool[Array, "2"]:
    """Whether one of each of VITAL gave numbers in this tick; what is not on board is not missed."""
    reported = []
    for kind in VITAL:
        slots = [measurements[name] for name in _of_kind(measurements, kind)]
        numbers = [jnp.any(slot.valid & jnp.all(jnp.isfinite(slot.value), axis=1)) for slot in slots]
        reported.append(jnp.any(jnp.stack(numbers)) if numbers else jnp.asarray(True))
    return jnp.stack(reported)


def _of_kind(names: Iterable[str], kind: str) -> list[str]:
    return [name for name in names if kind_of(name) == kind]


def _last(measurements: Measurements, names: list[str], before: Float[Array, " k"]) -> Float[Array, " k"]:
    """First value of each sensor's newest reading that is a number; what it was before where none came."""
    return jnp.stack([_newest(measurements.get(name), before[i]) for i, name in enumerate(names)])


def _newest(slot: Slot | None, now: Scalar) -> Scalar:
    if slot is None:
        return now
    first = slot.value[:, 0]
    return Slot(first, slot.valid & jnp.isfinite(first), slot.t_valid).newest(now)
