"""What each sensor says of the error: residual, its derivative, its noise, and whether it is accepted.

Readings of a tick are averaged; each is compared with the state when it was taken.
"""

import equinox as eqx
from jaxtyping import Bool, Float

from rovtwin.core.arrays.small_matrices import product
from rovtwin.core.flow import Slot
from rovtwin.core.frames import (
    cross,
    quaternion_conjugate,
    quaternion_from_euler,
    quaternion_from_rotation,
    quaternion_multiply,
    rotation_between,
    rotation_from_quaternion,
    skew,
)
from rovtwin.core.numerics import Array, jnp
from rovtwin.core.types import Flag, Index, Scalar, ScalarLike, Vector2, Vector3
from rovtwin.gnc.mounting import Mount
from rovtwin.gnc.navigation.prediction import Acceleration, side_by_side
from rovtwin.gnc.navigation.state import (
    ATTITUDE,
    GYRO_BIAS,
    POSITION,
    VELOCITY,
    WAVE_PLACE,
    WAVE_VELOCITY,
    NavigationState,
)


class Innovation(eqx.Module):
    """Scalar measurements of the error, residual = slope @ error + noise.

    Attributes:
        residual: Measured less expected.
        slope: Its derivative by the error of the state.
        variance: Of the noise.
        used: Whether they are there and accepted.
    """

    residual: Float[Array, " n"]
    slope: Float[Array, "n 31"]
    variance: Float[Array, " n"]
    used: Bool[Array, " n"]


class Mean(eqx.Module):
    """Average of a slot's readings, their number, and how long ago they were taken on average [s]."""

    value: Float[Array, " n"]
    count: Index
    age: Scalar


class Joined(eqx.Module):
    """What several sensors of three axes say together, along those of b.

    Attributes:
        value: Weighted mean of their readings. That of specific forces is the one at the mean place.
        lever: That place, seen from CO, b [m].
        variance: Of the noise.
        received: Whether there was a reading.
    """

    value: Vector3
    lever: Vector3
    variance: Vector3
    received: Flag


def joined(values: list[Vector3], counts: list[Index], mounts: list[Mount]) -> Joined:
    """Means of the readings of sensors, each weighted by how many they are and how good.

    Args:
        values: Mean of each sensor's readings in its own axes.
        counts: How many they are.
        mounts: Of the sensors.
    """
    n = [jnp.maximum(count, 1) for count in counts]
    turned = [mount.rotation @ value for value, mount in zip(values, mounts, strict=True)]
    variances = [mount.variance / number for mount, number in zip(mounts, n, strict=True)]
    if len(mounts) == 1:
        return Joined(turned[0], mounts[0].lever, variances[0], counts[0] > 0)
    weights = [count / jnp.mean(mount.variance) for count, mount in zip(counts, mounts, strict=True)]
    weight = jnp.stack(weights)
    received = jnp.any(weight > 0.0)
    share = weight / jnp.where(received, jnp.sum(weight), 1.0)
    levers = jnp.stack([mount.lever for mount in mounts])
    return Joined(share @ jnp.stack(turned), share @ levers, share**2 @ jnp.stack(variances), received)


def age_of(t_valid: Float[Array, "*rows"], now: Scalar, max_age: ScalarLike) -> Float[Array, "*rows"]:
    """How long ago readings were taken [s]; one with a stamp ahead of the clock, or too old, counts as new."""
    age = now - t_valid
    return jnp.where((age > 0.0) & (age <= max_age), age, 0.0)


def averaged(slot: Slot, now: Scalar, max_age: ScalarLike) -> Mean:
    """Of what a slot holds; zero where it holds nothing."""
    count = jnp.sum(slot.valid)
    share = slot.valid / jnp.maximum(count, 1)
    return Mean(share @ slot.value, count, share @ age_of(slot.t_valid, now, max_age))


def attitude(
    x: NavigationState, slot: Slot, mount: Mount, omega: Vector3, now: Scalar, max_age: ScalarLike
) -> Innovation:
    """zyx Euler angles of the sensor's axes, as a small rotation from where the vehicle is assumed to have been."""
    q_sb = quaternion_conjugate(quaternion_from_rotation(mount.rotation))
    total, count = jnp.zeros(3), jnp.sum(slot.valid)
    for row in range(slot.valid.shape[0]):
        read = quaternion_multiply(quaternion_from_euler(slot.value[row]), q_sb)
        age = age_of(slot.t_valid[row], now, max_age)
        turned = rotation_between(read, x.attitude) + age * omega
        total = total + jnp.where(slot.valid[row], turned, 0.0)
    n = jnp.maximum(count, 1)
    slope = side_by_side(3, (ATTITUDE, jnp.eye(3)))
    return Innovation(total / n, slope, mount.variance / n, jnp.full(3, count > 0))


def pressure(
    x: NavigationState, slot: Slot, mount: Mount, v_n: Vector3, slip: Scalar, now: Scalar, max_age: ScalarLike
) -> Innovation:
    """Depth of the sensor, without the motion of the waves: particles of the water move along surfaces of one pressure,
    and a vehicle of neutral buoyancy moves with them, but for a slip of some variance [m2].
    """
    mean = averaged(slot, now, max_age)
    R_nb = rotation_from_quaternion(x.attitude)
    ahead = x.position[2] + R_nb[2] @ mount.lever
    slope = side_by_side(1, (POSITION, jnp.array([[0.0, 0.0, 1.0]])), (ATTITUDE, -product(R_nb, skew(mount.lever))[2:]))
    residual = mean.value + mean.age * v_n[2:] - ahead
    n = jnp.maximum(mean.count, 1)
    return Innovation(residual, slope, jnp.broadcast_to(mount.std**2 / n + slip, 1), jnp.full(1, mean.count > 0))


def position(x: NavigationState, value: Vector2, age: Scalar, travelled: Vector2, mount: Mount) -> Innovation:
    """One reading of north and east, perhaps seconds old.

    Args:
        x: State now.
        value: Reading [m].
        age: Of it [s].
        travelled: North and east since then, by dead reckoning [m].
        mount: Of the sensor.
    """
    R_nb = rotation_from_quaternion(x.attitude)
    turned = skew(mount.lever) - age * skew(x.velocity)
    slope = side_by_side(
        2,
        (POSITION, jnp.eye(2, 3)),
        (VELOCITY, -age * R_nb[:2]),
        (ATTITUDE, -product(R_nb, turned)[:2]),
        (WAVE_PLACE, jnp.eye(2, 3)),
        (WAVE_VELOCITY, -age * jnp.eye(2, 3)),
    )
    place = (x.position + x.wave_place + R_nb @ mount.lever)[:2]
    residual = value + travelled - place
    if mount.sight is None:
        return Innovation(residual, slope, jnp.broadcast_to(mount.std**2, 2), jnp.full(2, True))
    reach = jnp.sqrt(place @ place)
    north, east = jnp.where(reach > 0.0, place / jnp.maximum(reach, 1e-9), jnp.array([1.0, 0.0]))
    axes = jnp.array([[north, east], [-east, north]])  # along the line of sight, and across it
    along, across, bearing = mount.sight
    variance = jnp.stack([along**2, across**2 + (bearing * reach) ** 2])
    return Innovation(product(axes, residual[:, None])[:, 0], product(axes, slope), variance, jnp.full(2, True))


def dvl(
    x: NavigationState,
    slot: Slot,
    mount: Mount,
    omega: Vector3,
    rate_variance: Vector3,
    v_dot: Vector3,
    now: Scalar,
    max_age: ScalarLike,
) -> Innovation:
    """Velocity over ground in the sensor's axes; what the gyro errs by moves the sensor about CO."""
    mean = averaged(slot, now, max_age)
    R_bn = rotation_from_quaternion(x.attitude).T
    there = x.velocity + R_bn @ x.wave_velocity + cross(omega, mount.lever) - mean.age * v_dot
    n = jnp.maximum(mean.count, 1)
    swing = skew(mount.lever)
    slope = side_by_side(3, (VELOCITY, jnp.eye(3)), (WAVE_VELOCITY, R_bn), (GYRO_BIAS, swing))
    residual = mount.rotation @ mean.value - there
    variance = mount.variance / n + (swing * swing) @ rate_variance
    return Innovation(residual, slope, variance, jnp.full(3, mean.count > 0))


def disagreement(difference: Acceleration, density: Vector3, variance: Vector3, used: Flag, dt: float) -> Innovation:
    """Of accelerometer and prediction: what should be zero, read with the noise of all. See `prediction`.

    Args:
        difference: Accelerometer's less predicted acceleration, b.
        density: Of the white noise that is not in the prediction [m2/s3].
        variance: Of the reading [m2/s4].
        used: Whether there is one.
        dt: Tick [s].
    """
    return Innovation(difference.value, -difference.slope, density / dt + variance, jnp.full(3, used))
