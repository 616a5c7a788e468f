"""Vehicle, truth and sensors for the tests of the observer: a tiny simulation of its own, with NumPy noise."""

import equinox as eqx
import numpy as np

from rovtwin.core.flow import Command, Environment, Slot
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.ekf_tuning import SENSOR_STD
from rovtwin.vehicle.dynamics import State, acceleration, plant_step
from rovtwin.vehicle.model import Model, rigid_body_matrix
from rovtwin.vehicle.thrusters import thrusters_from

DT = 0.02
RATE = {"position": 1.0, "pressure": 42.0, "gyro": 100.0, "attitude": 100.0, "dvl": 10.0, "accelerometer": 100.0}
ACCELEROMETER_STD = 0.0308


def double_body(damping="free_running", lag=0.2) -> Model:
    """Two bodies side by side with three thrusters each, damping as free running or as towing in the thesis."""
    linear, quadratic = {
        "free_running": ([55.8, 44.8, 20.8, 3.78, 1.35, 0.18], [23.7, 0.0, 1197.9, 0.0, 0.0, 8.5]),
        "towing": ([6.5, 5.0, 10.0, 1.0, 1.0, 0.2], [159.0, 250.0, 800.0, 4.0, 4.0, 8.5]),
    }[damping]
    columns = []
    for y in (-0.28, 0.28):
        columns += [[1, 0, 0, 0, 0, -y], [0, 1, 0, 0, 0, 0], [0, 0, 1, y, 0, 0]]
    force = jnp.array([10.0, 5.0, 11.0] * 2)
    r_g = [0.0, 0.0, 0.02]
    return Model(
        rigid_body_mass=rigid_body_matrix(30.0, np.diag([2.83, 0.9, 3.11]), r_g),
        added_mass=np.diag([15.0, 30.0, 60.0, 2.2, 0.6, 0.9]) + _coupling(),
        linear_damping_ahead=np.diag(linear),
        quadratic_damping_ahead=np.diag(quadratic),
        weight=294.3,
        buoyancy=294.3,
        center_of_gravity=r_g,
        center_of_buoyancy=[0.0, 0.0, 0.0],
        thrusters=thrusters_from(jnp.array(columns, dtype=float).T, force, time_constant=jnp.full(6, lag)),
    )


def _coupling():
    A = np.zeros((6, 6))
    A[0, 4] = A[4, 0] = 0.4
    A[1, 3] = A[3, 1] = -0.4
    return A


@eqx.filter_jit
def truth(model: Model, start: State, u, force_n, moment_b, extra=None):
    """[eta, nu] and specific force after each tick, (n, 12) and (n, 3).

    Commands u (n, k), disturbance force in n and moment in b, (n, 3) each, any other wrench in b (n, 6).
    """
    calm = Environment.calm()
    extra = jnp.zeros((u.shape[0], 6)) if extra is None else extra

    def tick(state, inputs):
        command, force, moment, more = inputs

        def disturbed(state):
            force_b = rotation_from_quaternion(state.attitude).T @ force
            return eqx.tree_at(lambda e: e.wrench, calm, jnp.concatenate([force_b, moment]) + more)

        def fine(state, _):
            return plant_step(model, state, Command(command), disturbed(state), DT / 4), None

        state, _ = jax.lax.scan(fine, state, None, length=4)
        tau = model.thrusters.configuration @ state.thrust
        nu_dot = acceleration(model, state.attitude, state.nu, tau, disturbed(state))
        R_nb = rotation_from_quaternion(state.attitude)
        specific = nu_dot[:3] + jnp.cross(state.nu[3:], state.nu[:3]) - 9.81 * R_nb[2]
        eta = jnp.concatenate([state.position, euler_from_quaternion(state.attitude)])
        return state, (jnp.concatenate([eta, state.nu]), specific)

    return jax.lax.scan(tick, start, (u, force_n, moment_b, extra))[1]


def at(model, position=(0.0, 0.0, 0.5), euler=(0.0, 0.0, 0.0), nu=None):
    velocity = jnp.zeros(6) if nu is None else jnp.asarray(nu, dtype=float)
    return State(
        jnp.asarray(position, dtype=float),
        quaternion_from_euler(jnp.asarray(euler, dtype=float)),
        velocity,
        jnp.zeros(model.thrusters.count),
    )


def random_walk(rng, n, intensity, size=3):
    return np.cumsum(rng.normal(0, intensity * np.sqrt(DT), (n, size)), axis=0)


def readings(rng, x, specific, names, std=None, accelerometer_bias=0.0):
    """Slots of each tick, leading axis n; sensors faster than the tick have two readings, the older half a tick ago."""
    std = SENSOR_STD | {"accelerometer": ACCELEROMETER_STD} | (std or {})
    clean = {
        "position": x[:, 0:2],
        "pressure": x[:, 2:3],
        "attitude": x[:, 3:6],
        "dvl": x[:, 6:9],
        "gyro": x[:, 9:12],
        "accelerometer": specific + accelerometer_bias,
    }
    n = len(x)
    time = DT * np.arange(n)  # the filter's first tick is at time zero
    slots = {}
    for name in names:
        value = clean[name]
        count = np.floor(np.round(np.arange(n + 1) * DT * RATE[name], 9))
        came = np.diff(count)
        if RATE[name] * DT > 1.5:
            before = np.vstack([value[:1], value[:-1]])
            halfway = 0.5 * (value + before)
            if name == "attitude":
                halfway = before + 0.5 * ((value - before + np.pi) % (2 * np.pi) - np.pi)
            value, valid = np.stack([halfway, value], 1), np.ones((n, 2), bool)
            t_valid = np.stack([time - DT / 2, time], 1)
        else:
            value, valid, t_valid = value[:, None], (came > 0)[:, None], time[:, None]
        value = value + rng.normal(0, std[name], value.shape)
        if name == "attitude":
            value = (value + np.pi) % (2 * np.pi) - np.pi
        value = np.where(valid[..., None], value, 0.0)
        slots[name] = Slot(jnp.asarray(value), jnp.asarray(valid), jnp.asarray(t_valid))
    return slots
