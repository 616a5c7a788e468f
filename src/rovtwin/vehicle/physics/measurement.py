"""What ideal sensors read: noise-free measurement equations of a body-fixed sensor at any place and in any orientation.

Simulation, observers and identification use the same equations. A sensor sits at `lever` from CO, in b, and its own
axes are those of the sensor frame s; `R_bs` maps s to b (identity when the axes are aligned).

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 14.
"""

from rovtwin.core.frames import cross, rotation_from_quaternion
from rovtwin.core.numerics import jnp
from rovtwin.core.types import Matrix3, Scalar, Vector2, Vector3, Vector6
from rovtwin.vehicle.physics.dynamics import State
from rovtwin.vehicle.physics.model import GRAVITY


def position_at(state: State, lever: Vector3) -> Vector3:
    """Position of a point of the body, n [m]: p + R_nb r.

    Args:
        state: Of the vehicle.
        lever: r, the point seen from CO, b [m].
    """
    return state.position + rotation_from_quaternion(state.attitude) @ lever


def velocity_of_point(nu: Vector6, lever: Vector3) -> Vector3:
    """v + omega x r of a point of the body, b [m/s], of nu, b at CO."""
    return nu[:3] + cross(nu[3:], lever)


def acceleration_of_point(nu: Vector6, nu_dot: Vector6, lever: Vector3) -> Vector3:
    """Inertial acceleration of a point of the body, b [m/s2].

    `v_dot` is the rate of the body components, so that the inertial acceleration of CO is v_dot + omega x v.

    Args:
        nu: b at CO.
        nu_dot: Its rate [m/s2, rad/s2].
        lever: r, the point seen from CO, b [m].
    """
    v, omega = nu[:3], nu[3:]
    return nu_dot[:3] + cross(omega, v) + cross(nu_dot[3:], lever) + cross(omega, cross(omega, lever))


def depth(state: State, lever: Vector3) -> Scalar:
    """Depth of a point of the body below the origin of n [m], scalar: what a pressure sensor is calibrated to."""
    return state.position[2] + rotation_from_quaternion(state.attitude)[2] @ lever


def range_to_floor(state: State, lever: Vector3, R_bs: Matrix3, floor: Scalar, slope: Vector2 | None = None) -> Scalar:
    """Distance to a plane floor along a narrow beam, x of s [m], scalar: (floor - depth) / beam_z where it is level.

    Not finite for a beam that never meets it, negative for one that looks away from it, or from below the floor.

    Args:
        state: Of the vehicle.
        lever: r, the sensor seen from CO, b [m].
        R_bs: Mounting, maps s to b.
        floor: Its depth in n below CO [m].
        slope: By how much it gets deeper per metre north and east; None: level.
    """
    R_nb = rotation_from_quaternion(state.attitude)
    beam, away = R_nb @ R_bs[:, 0], floor - depth(state, lever)
    if slope is None:
        return away / beam[2]
    return (away + slope @ (R_nb @ lever)[:2]) / (beam[2] - slope @ beam[:2])


def specific_force(state: State, nu_dot: Vector6, lever: Vector3, R_bs: Matrix3) -> Vector3:
    """What an accelerometer reads, s [m/s2]: its acceleration relative to free fall.

        f = R_sb (v_dot + omega x v + omega_dot x r + omega x (omega x r) - R_bn g),    g = [0, 0, 9.81] in n

    At rest and level the reading is [0, 0, -9.81]. Fossen (2021), sec. 14.1 (inertial measurement unit; lever arms).

    Args:
        state: Of the vehicle.
        nu_dot: Rate of nu, b at CO [m/s2, rad/s2].
        lever: r, the sensor seen from CO, b [m].
        R_bs: Mounting, maps s to b.
    """
    inertial = acceleration_of_point(state.nu, nu_dot, lever)
    down_b = rotation_from_quaternion(state.attitude)[2]
    return (inertial - GRAVITY * down_b) @ R_bs


def angular_rate(state: State, R_bs: Matrix3) -> Vector3:
    """What a gyro reads, s [rad/s]: R_sb omega; the turning of the Earth (7e-5 rad/s) is left out."""
    return state.nu[3:] @ R_bs


def attitude_euler(state: State, R_bs: Matrix3) -> Vector3:
    """zyx Euler angles [phi, theta, psi] of the sensor's axes [rad], from R_ns = R_nb R_bs.

    psi is measured from the north of n: no magnetic declination. Fossen (2021), eq. 2.31 solved for the angles.
    """
    R_ns = rotation_from_quaternion(state.attitude) @ R_bs
    return jnp.array(
        [
            jnp.arctan2(R_ns[2, 1], R_ns[2, 2]),
            -jnp.arcsin(jnp.clip(R_ns[2, 0], -1.0, 1.0)),
            jnp.arctan2(R_ns[1, 0], R_ns[0, 0]),
        ]
    )


def velocity_over_ground_at(state: State, lever: Vector3, R_bs: Matrix3) -> Vector3:
    """What a DVL with bottom lock reads, s [m/s]: R_sb (v + omega x r)."""
    return velocity_of_point(state.nu, lever) @ R_bs
