"""What flows through the loop: Measurement -> Estimate; Mission -> Setpoint -> Reference -> Wrench -> Command.

All are immutable pytrees of arrays, SI and radians. `nu = [u, v, w, p, q, r]` and `tau = [X, Y, Z, K, M, N]` (b at CO).
Attitude is a unit quaternion `[w, x, y, z]` that maps b to n. For files, screens and the thesis's blocks there is
`eta = [x, y, z, phi, theta, psi]` (n, zyx Euler angles), in which a pitch of 90 degrees is singular.
"""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rovtwin.core.arrays.small_matrices import summed_product
from rovtwin.core.frames import (
    body_rates_from_euler_rates,
    euler_from_quaternion,
    euler_rate_matrix,
    heading_of,
    level_attitude,
    quaternion_from_euler,
    rotation_from_quaternion,
)
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import (
    Flag,
    HostArray,
    Index,
    Matrix3,
    PerThruster,
    Quaternion,
    Scalar,
    Vector2,
    Vector3,
    Vector6,
)

PHASES = (
    *("idle", "dive", "turn", "go", "hold", "paused", "finished", "aborted"),
    *("held", "returning", "returned", "surfacing", "surfaced", "piloted"),
)
IDLE, DIVE, TURN, GO, HOLD, PAUSED, FINISHED, ABORTED = range(8)
HELD, RETURNING, RETURNED, SURFACING, SURFACED, PILOTED = range(8, 14)
FAIL_SAFE_PHASES = ("aborted", "held", "returning", "returned", "surfacing", "surfaced")
ENDS = (FINISHED, ABORTED, RETURNED, SURFACED)  # after which nothing more happens unless an operator wants it

REASONS = (  # the gravest first
    *("", "not a number", "operator", "depth limit", "attitude limit", "estimate lost", "leak", "battery critical"),
    *("filter diverged", "positions lost", "thruster failed", "saturated", "link lost", "deadline missed"),
    *("battery low", "geofence", "altitude limit", "time out", "operator silent", "sensor silent"),
    *("no way home", "off course", "off depth"),
)
NO_REASON, NOT_A_NUMBER, OPERATOR, DEPTH_LIMIT, ATTITUDE_LIMIT, ESTIMATE_LOST, LEAK, BATTERY_CRITICAL = range(8)
FILTER_DIVERGED, POSITIONS_LOST, THRUSTER_FAILED, SATURATED, LINK_LOST, DEADLINE_MISSED = range(8, 14)
BATTERY_LOW, GEOFENCE, ALTITUDE_LIMIT, TIME_OUT, OPERATOR_SILENT, SENSOR_SILENT, NO_WAY_HOME = range(14, 21)
OFF_COURSE, OFF_DEPTH = range(21, 23)

PROGRESS = ("", "going", "waiting", "limited", "again", "missed", "swept", "heading given up")
NO_PROGRESS, GOING, WAITING, LIMITED, AGAIN, MISSED, SWEPT, HEADING_GIVEN_UP = range(len(PROGRESS))

NO_REQUEST, PAUSE, RESUME, ABORT, ARM, PILOT = range(6)

FEW_ROWS = 32  # of a mission: up to here a masked sum picks a row faster than an index


@dataclass(frozen=True)
class Measurement:
    """One reading as a Link delivers it (host side): sensor name, value [SI], and when it was valid [s]."""

    sensor: str
    value: Float[np.ndarray, " n"]
    t_valid: float


class Slot(eqx.Module):
    """Room for the readings of one sensor in one control tick, of declared capacity.

    Absent is `valid = False` with a finite filler: never NaN, never a repeat.

    Attributes:
        value: Readings in order of arrival [SI].
        valid: Whether the row holds a reading.
        t_valid: When the reading was valid, by the sensor's own clock [s].
    """

    value: Float[HostArray, "capacity n"]
    valid: Bool[HostArray, " capacity"]
    t_valid: Float[HostArray, " capacity"]

    @classmethod
    def empty(cls, capacity: int, size: int) -> "Slot":
        return cls(jnp.zeros((capacity, size)), jnp.zeros(capacity, dtype=bool), jnp.zeros(capacity))

    def newest(self, before: Float[Array, " n"]) -> Float[Array, " n"]:
        """The last reading; what is known from before where there is none."""
        for row in range(self.valid.shape[0]):
            before = jnp.where(self.valid[row], self.value[row], before)
        return before


Measurements = dict[str, Slot]


def pack(readings: list[Measurement], empty: Measurements) -> Measurements:
    """A link's list of readings in slots like `empty`; of more readings than a slot holds the newest are kept.

    Args:
        readings: In order of arrival; readings of sensors that `empty` lacks are left out.
        empty: Slot of each sensor the autopilot knows (only shapes are used).

    Returns:
        Slots on the host (NumPy arrays), with the structure of `empty`.
    """
    packed = {}
    for name, slot in empty.items():
        capacity, size = slot.value.shape
        value, valid, t_valid = np.zeros((capacity, size)), np.zeros(capacity, dtype=bool), np.zeros(capacity)
        newest = [r for r in readings if r.sensor == name][-capacity:]
        for row, reading in enumerate(newest):
            value[row], valid[row], t_valid[row] = reading.value, True, reading.t_valid
        packed[name] = Slot(value, valid, t_valid)  # type: ignore[arg-type]  (NumPy: the compiled step takes both)
    return packed


class Posed(eqx.Module):
    """What has a pose.

    Attributes:
        position: In n [m].
        attitude: Unit quaternion [w, x, y, z], maps its own axes to n.
    """

    position: Vector3
    attitude: Quaternion

    @property
    def eta(self) -> Float[Array, "*axes 6"]:
        """Pose with zyx Euler angles [m, rad]."""
        return jnp.concatenate([self.position, euler_from_quaternion(self.attitude)], axis=-1)

    @property
    def heading(self) -> Float[Array, "*axes"]:
        """See `frames.heading_of` [rad]."""
        return heading_of(self.attitude)


class Estimate(Posed):
    """The observer's estimate.

    Attributes:
        position: CO in n [m].
        attitude: Unit quaternion [w, x, y, z], maps b to n.
        nu: Body velocity over ground [m/s, rad/s].
        bias: Slowly varying disturbance wrench b [N, N m]; force in n, moment in b (J^-1 b of thesis 2.36).
        covariance: Of the errors of position in n, attitude and nu; the attitude's is a small rotation
            seen from b: R_true = R exp(S(error)).
        nis: Normalised innovation squared summed per sensor in this tick, in sorted order of the sensors'
            names; 0 where none came.
        nis_dof: Number of scalar innovations in each sum.
        wave: Part of the motion that is of wave frequency, n: displacement [m] and velocity [m/s]; zero
            from observers that do not tell it.
        bias_std: Standard deviation of the horizontal disturbance force [N]; zero from observers that do not
            tell it.
    """

    nu: Vector6
    bias: Vector6
    covariance: Float[Array, "12 12"]
    nis: Float[Array, " sensors"]
    nis_dof: Float[Array, " sensors"]
    wave: Vector6 = eqx.field(default_factory=lambda: jnp.zeros(6))
    bias_std: Scalar = eqx.field(default_factory=lambda: jnp.zeros(()))

    @classmethod
    def from_euler(
        cls, eta: Vector6, nu: Vector6, bias: Vector6, covariance: Float[Array, "12 12"], *others: Array, **named: Array
    ) -> "Estimate":
        """Of a pose with Euler angles, and the covariance of [eta, nu]; the rest as it is."""
        W = body_rates_from_euler_rates(eta[3:])

        def turned(rows: Float[Array, "12 12"]) -> Float[Array, "12 12"]:
            return jnp.concatenate([rows[:3], summed_product(W, rows[3:6]), rows[6:]])

        attitude = quaternion_from_euler(eta[3:])
        return cls(eta[:3], attitude, nu, bias, turned(turned(covariance).T), *others, **named)

    @property
    def R_nb(self) -> Matrix3:
        """Maps b to n."""
        return rotation_from_quaternion(self.attitude)

    @property
    def slow_position(self) -> Vector3:
        """Where CO is but for the waves, n [m]."""
        return self.position - self.wave[:3]

    def slow_velocity(self, to_b: Float[Array, "n n"]) -> Float[Array, " n"]:
        """Velocity over ground but for the waves, b [m/s]; R_bn or its level part given."""
        n = to_b.shape[0]
        return self.nu[:n] - to_b @ self.wave[3 : 3 + n]

    def slow_velocity_n(self, to_n: Float[Array, "n n"]) -> Float[Array, " n"]:
        """The same in n; R_nb or its level part given."""
        n = to_n.shape[0]
        return to_n @ self.nu[:n] - self.wave[3 : 3 + n]


class Waypoint(eqx.Module):
    """One row of a Mission; fields as there."""

    position: Vector3
    speed: Scalar
    acceptance: Scalar
    hold_time: Scalar
    heading: Scalar
    fixed_heading: Flag


class Mission(eqx.Module):
    """Way-points of a mission, in order.

    Attributes:
        position: x, y and depth in n [m].
        speed: Desired speed along the leg [m/s].
        acceptance: Radius within which a way-point is reached [m].
        hold_time: Time to stay after reaching it [s].
        heading: Heading to keep [rad]; used where `fixed_heading`.
        fixed_heading: Whether the heading is given rather than along the leg.
        count: How many rows are way-points; rows beyond it are padding, so that missions share one shape.
        altitude: Distance to the floor to keep [m]; 0 where the depth holds; None where it does everywhere.
    """

    position: Float[Array, "n 3"]
    speed: Float[Array, " n"]
    acceptance: Float[Array, " n"]
    hold_time: Float[Array, " n"]
    heading: Float[Array, " n"]
    fixed_heading: Bool[Array, " n"]
    count: Index
    altitude: Float[Array, " n"] | None = None

    def at(self, index: Index) -> Waypoint:
        """The way-point of an index, within the rows."""
        rows = self.position.shape[0]
        chosen = jnp.arange(rows) == index

        def row(column: Shaped[Array, " n *axes"]) -> Shaped[Array, " *axes"]:
            if rows > FEW_ROWS:
                return column[index]
            # A sum over few rows costs less than a gather once a batch makes the index an array.
            return jnp.sum(jnp.where(chosen.reshape(-1, *[1] * (column.ndim - 1)), column, 0), axis=0)

        return Waypoint(
            position=row(self.position),
            speed=row(self.speed),
            acceptance=row(self.acceptance),
            hold_time=row(self.hold_time),
            heading=row(self.heading),
            fixed_heading=row(self.fixed_heading) > 0,
        )


class Progress(eqx.Module):
    """How guidance gets on, for whoever has to say why a vehicle does not arrive.

    Attributes:
        state: One of PROGRESS. Going: as fast as the leg asks. Waiting: for a vehicle that is behind. Limited: to
            what thrusters can keep up. Again: at a way-point that was passed outside its acceptance; missed: so often
            that it counts as such, though it is tried further. Swept: the current is more than thrusters can stem.
            Heading given up: the place is kept, but not with the heading that was asked for.
        misses: How often the way-point was passed so.
        possible: Speed over ground along the path that thrusters can keep up [m/s]; negative: swept back.
        current: That would disturb the vehicle as much as what the filter estimates, n [m/s].
    """

    state: Index
    misses: Index
    possible: Scalar
    current: Vector2

    @classmethod
    def unreported(cls) -> "Progress":
        """Of guidance that does not tell."""
        none = jnp.zeros((), dtype=int)
        return cls(none, none, jnp.zeros(()), jnp.zeros(2))


class Setpoint(Posed):
    """What guidance asks for.

    Attributes:
        position: Desired place of CO, n [m].
        attitude: Desired attitude, a unit quaternion; `level_attitude` of `core.frames` makes one of a
            heading.
        nu: Desired velocity along the axes of the desired attitude.
        leg_start: Start of the current leg [m].
        leg_end: Its end, the way-point aimed at [m].
        on_leg: Whether the vehicle follows a leg (phase go).
        waypoint: Index of the way-point aimed at.
        phase: One of PHASES.
        reason: One of REASONS.
        fixed_heading: Whether the heading was asked for, and is not just that of the path.
        progress: How guidance gets on.
    """

    nu: Vector6
    leg_start: Vector3
    leg_end: Vector3
    on_leg: Flag
    waypoint: Index
    phase: Index
    reason: Index
    fixed_heading: Flag = eqx.field(default_factory=lambda: jnp.asarray(False))
    progress: Progress = eqx.field(default_factory=Progress.unreported)

    @classmethod
    def level(cls, position: Vector3, heading: Scalar, *others: Any, **named: Any) -> "Setpoint":
        """At a place, level, with a heading [rad]; the rest as it is."""
        return cls(position, level_attitude(heading), *others, **named)


class Reference(Posed):
    """The smooth path to the set-point. Its own axes d are those that `attitude` maps to n.

    Attributes:
        position: In n [m].
        attitude: Unit quaternion, maps d to n.
        velocity: Of the position, n [m/s].
        angular_velocity: Of d, seen from d [rad/s].
        acceleration: Of the position, n [m/s2].
        angular_acceleration: Rate of the angular velocity, d [rad/s2].
    """

    velocity: Vector3
    angular_velocity: Vector3
    acceleration: Vector3
    angular_acceleration: Vector3

    @classmethod
    def from_euler(cls, eta: Vector6, eta_dot: Vector6, eta_ddot: Vector6) -> "Reference":
        """Of a pose with Euler angles and its rates."""
        euler, rate, change = eta[3:], eta_dot[3:], eta_ddot[3:]
        omega, omega_dot = jax.jvp(lambda e, r: body_rates_from_euler_rates(e) @ r, (euler, rate), (rate, change))
        return cls(eta[:3], quaternion_from_euler(euler), eta_dot[:3], omega, eta_ddot[:3], omega_dot)

    @property
    def eta_dot(self) -> Vector6:
        """Its rate [m/s, rad/s]."""
        T = euler_rate_matrix(euler_from_quaternion(self.attitude))
        return jnp.concatenate([self.velocity, T @ self.angular_velocity])


class Wrench(eqx.Module):
    """tau requested by a controller [N, N m], b at CO; `saturated`, where a limit cut it."""

    tau: Vector6
    saturated: Bool[Array, "6"]


class Command(eqx.Module):
    """Normalised thruster commands u in [-1, 1]."""

    u: Float[HostArray, " n"]


class Walls(eqx.Module):
    """Planes that a hull cannot pass: floor and walls of a tank, the seabed. A place x is inside where n . x <= d.

    Attributes:
        normals: Unit normals that point out of the water, in n.
        offsets: d of each plane [m].
    """

    normals: Float[Array, "k 3"]
    offsets: Float[Array, " k"]


class Environment(eqx.Module):
    """What surrounds a vehicle during one physics step: the water to first order about CO, and what else acts there.

    Water velocity at a place x, e seconds into the step: `velocity + e rate + gradient @ (x - place)`. What is None is
    not there: the structure is static, so that nothing is compiled for what is switched off.

    Attributes:
        velocity: Water velocity at `place` at the start of the step, n [m/s].
        rate: Its rate at a fixed place, the local part of D v_c / Dt, n [m/s2].
        wrench: External wrench (force waves, tethers), b at CO [N, N m]; held over the step.
        place: Where the water was looked at, CO at the start of the step, n [m].
        gradient: d v_i / d x_j in n [1/s], or None in water that moves as one.
        head: Dynamic pressure of waves at `place`, as a height of water [m], or None.
        surface: Depth z in n of the surface above CO [m], negative under a crest, or None without a surface.
        walls: Planes, or None in open water.
        floor: Depth z in n of the floor below `place`, for instruments that look at it [m], or None; its plane is among
            the walls.
        slope: By how much the floor gets deeper per metre north and east, or None where it is level.
    """

    velocity: Vector3
    rate: Vector3
    wrench: Vector6
    place: Vector3
    gradient: Matrix3 | None = None
    head: Scalar | None = None
    surface: Scalar | None = None
    walls: Walls | None = None
    floor: Scalar | None = None
    slope: Vector2 | None = None

    @classmethod
    def calm(cls, **changes: Any) -> "Environment":
        """Still, endless water; `changes` by field name."""
        zero = jnp.zeros(3)
        still: dict[str, Any] = {"velocity": zero, "rate": zero, "wrench": jnp.zeros(6), "place": zero}
        return cls(**(still | changes))


class Host(eqx.Module):
    """What the computer that runs the autopilot knows of itself and of its lines.

    Attributes:
        link_age: Since anything came from the vehicle [s].
        operator_age: Since the operator last gave a sign of life [s].
        lateness: By how much the last tick was late, in control periods.
    """

    link_age: Float[HostArray, ""] = eqx.field(default_factory=lambda: jnp.zeros(()))
    operator_age: Float[HostArray, ""] = eqx.field(default_factory=lambda: jnp.zeros(()))
    lateness: Float[HostArray, ""] = eqx.field(default_factory=lambda: jnp.zeros(()))


class AutopilotInput(eqx.Module):
    """What one autopilot tick takes.

    Attributes:
        measurements: Readings since the last tick.
        request: The operator's.
        host: Ages and lateness.
        pilot: Desired velocity over ground along the heading, surge, sway, heave [m/s], and turn rate [rad/s];
            counts while the vehicle is piloted.
    """

    measurements: Measurements
    request: Int[HostArray, ""]
    host: Host = eqx.field(default_factory=Host)
    pilot: Float[HostArray, "4"] = eqx.field(default_factory=lambda: jnp.zeros(4))


class AutopilotOutput(eqx.Module):
    """All that one autopilot tick produces, for the link (command) and for the log (the rest).

    `health` is the estimate of what each thruster still gives, a share. `failed` says which part
    of somebody else's gave what is no number: 0 none, else 1 and its place in gnc.guard.PLACES; None: all
    are ours.
    """

    command: Command
    estimate: Estimate
    setpoint: Setpoint
    reference: Reference
    wrench: Wrench
    health: PerThruster
    failed: Index | None = None
