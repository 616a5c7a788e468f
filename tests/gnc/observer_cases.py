"""Vehicle, truth and sensors for the tests of the observer: a tiny simulation of its own, with NumPy noise."""

from dataclasses import dataclass

import equinox as eqx
import numpy as np

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment, Measurements, Slot
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.thesis.ekf import Ekf
from rovtwin.gnc.thesis.ekf_tuning import SENSOR_STD
from rovtwin.vehicle.physics.dynamics import State, acceleration, plant_step
from rovtwin.vehicle.physics.model import Model, rigid_body_matrix
from rovtwin.vehicle.physics.thrusters import thrusters_from

DT = 0.02
RATE = {"position": 1.0, "pressure": 42.0, "gyro": 100.0, "attitude": 100.0, "dvl": 10.0, "accelerometer": 100.0}
# One reading a tick: what the noise between two readings of a tick does is not in the way of exact statistics.
ONE_A_TICK = RATE | {"gyro": 50.0, "attitude": 50.0}
STD = SENSOR_STD | {"accelerometer": 0.0308}
THESIS_SENSORS = ("position", "pressure", "gyro", "attitude")


def double_body(damping: str = "free_running", time_constant: float = 0.2) -> Model:
    """Two bodies side by side with three thrusters each; damping as free running or as towing gave in the thesis."""
    linear, quadratic = {
        "free_running": ([55.8, 44.8, 20.8, 3.78, 1.35, 0.18], [23.7, 0.0, 1197.9, 0.0, 0.0, 8.5]),
        "towing": ([6.5, 5.0, 10.0, 1.0, 1.0, 0.2], [159.0, 250.0, 800.0, 4.0, 4.0, 8.5]),
    }[damping]
    columns = []
    for y in (-0.28, 0.28):
        columns += [[1, 0, 0, 0, 0, -y], [0, 1, 0, 0, 0, 0], [0, 0, 1, y, 0, 0]]
    M_A = np.diag([15.0, 30.0, 60.0, 2.2, 0.6, 0.9])
    M_A[0, 4] = M_A[4, 0] = 0.4
    M_A[1, 3] = M_A[3, 1] = -0.4
    r_g = [0.0, 0.0, 0.02]
    return Model(
        rigid_body_mass=rigid_body_matrix(30.0, np.diag([2.83, 0.9, 3.11]), r_g),
        added_mass=M_A,
        linear_damping_ahead=np.diag(linear),
        quadratic_damping_ahead=np.diag(quadratic),
        weight=294.3,
        buoyancy=294.3,
        center_of_gravity=r_g,
        center_of_buoyancy=[0.0, 0.0, 0.0],
        thrusters=thrusters_from(
            jnp.array(columns, dtype=float).T,
            jnp.array([10.0, 5.0, 11.0] * 2),
            time_constant=jnp.full(6, time_constant),
        ),
    )


def at(model, position=(0.0, 0.0, 0.5), euler=(0.0, 0.0, 0.0), nu=None) -> State:
    nu = jnp.zeros(6) if nu is None else jnp.asarray(nu, dtype=float)
    q = quaternion_from_euler(jnp.asarray(euler, dtype=float))
    return State(jnp.asarray(position, dtype=float), q, nu, jnp.zeros(model.thrusters.count))


@eqx.filter_jit
def truth(model: Model, start: State, u, b, extra):
    """[eta, nu], shape (n, 12), and specific force, shape (n, 3), after each tick.

    Commands u (n, k); disturbance b (n, 6), force in n and moment in b; any other wrench in b, `extra` (n, 6).
    """
    calm = Environment.calm()

    def tick(state, inputs):
        command, bias, more = inputs

        def disturbed(state):
            force_b = rotation_from_quaternion(state.attitude).T @ bias[:3]
            return eqx.tree_at(lambda e: e.wrench, calm, jnp.concatenate([force_b, bias[3:]]) + more)

        def substep(state, _):
            return plant_step(model, state, Command(command), disturbed(state), DT / 4), None

        state, _ = jax.lax.scan(substep, state, None, length=4)
        tau = model.thrusters.configuration @ state.thrust
        nu_dot = acceleration(model, state.position, state.attitude, state.nu, tau, disturbed(state))
        R_nb = rotation_from_quaternion(state.attitude)
        specific = nu_dot[:3] + jnp.cross(state.nu[3:], state.nu[:3]) - 9.81 * R_nb[2]
        eta = jnp.concatenate([state.position, euler_from_quaternion(state.attitude)])
        return state, (jnp.concatenate([eta, state.nu]), specific)

    return jax.lax.scan(tick, start, (u, b, extra))[1]


@eqx.filter_jit
def track(ekf: Ekf, start: Start, slots: Measurements, u):
    """x (n, 18), P (n, 18, 18), NIS and its degrees of freedom (n, n_sensors), thrust (n, k): the filter over a run."""

    def tick(memory, inputs):
        memory, estimate = ekf.step(memory, ObserverInput(inputs[0], Command(inputs[1])), DT)
        return memory, (memory.x, memory.P, estimate.nis, estimate.nis_dof, memory.thrust)

    return jax.lax.scan(tick, ekf.init(jax.random.key(0), start), (slots, u))[1]


@dataclass(frozen=True)
class Run:
    """A true run: commands, [eta, nu], specific force and disturbance after each tick."""

    u: np.ndarray
    x: np.ndarray
    specific: np.ndarray
    b: np.ndarray

    @classmethod
    def of(cls, model, u, b=None, start=None, extra=None) -> "Run":
        n = len(u)
        b = np.zeros((n, 6)) if b is None else np.broadcast_to(np.asarray(b, dtype=float), (n, 6))
        extra = np.zeros((n, 6)) if extra is None else extra
        x, specific = truth(model, start or at(model), jnp.asarray(u), jnp.asarray(b), jnp.asarray(extra))
        return cls(np.asarray(u), np.asarray(x), np.asarray(specific), b)

    @property
    def state(self) -> np.ndarray:
        """[eta, nu, b] after each tick, shape (n, 18)."""
        return np.concatenate([self.x, self.b], axis=-1)


def manoeuvres(rng, seconds: float, hold: float = 5.0) -> np.ndarray:
    """Commands that drive ahead, turn, climb and sway, new every `hold` seconds, shape (n, 6)."""
    n, each = round(seconds / DT), round(hold / DT)
    u = rng.uniform(-0.5, 0.5, (n // each + 1, 6))
    u[:, [0, 3]] = rng.uniform(0.1, 0.6, (len(u), 2))
    u[:, 4] = u[:, 1]
    u[:, [2, 5]] *= 0.3
    return np.repeat(u, each, axis=0)[:n]


def random_walk(rng, n: int, intensity) -> np.ndarray:
    intensity = np.asarray(intensity)
    return np.cumsum(rng.normal(size=(n, len(intensity))) * intensity * np.sqrt(DT), axis=0)


def wrapped(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def readings(rng, run: Run, names=THESIS_SENSORS, rates=RATE, std=STD) -> Measurements:
    """Slots of each tick, leading axis n; sensors faster than the tick have two readings, the older half a tick ago."""
    x, n = run.x, len(run.x)
    clean = {
        "position": x[:, 0:2],
        "pressure": x[:, 2:3],
        "attitude": x[:, 3:6],
        "dvl": x[:, 6:9],
        "gyro": x[:, 9:12],
        "accelerometer": run.specific,
    }
    now = DT * np.arange(n)  # the filter's first tick is at time zero
    slots = {}
    for name in names:
        value, t_valid, valid = clean[name][:, None], now[:, None], np.ones((n, 1), bool)
        if rates[name] * DT > 1.5:
            before = np.concatenate([value[:1], value[:-1]])
            step = wrapped(value - before) if name == "attitude" else value - before
            value, t_valid = np.concatenate([value - 0.5 * step, value], 1), now[:, None] - [[DT / 2, 0.0]]
            valid = np.ones((n, 2), bool)
        else:
            valid[:, 0] = np.diff(np.floor(np.round(np.arange(n + 1) * DT * rates[name], 9))) > 0
        value = value + rng.normal(0, std[name], value.shape)
        value = wrapped(value) if name == "attitude" else value
        value = np.where(valid[..., None], value, 0.0)
        slots[name] = Slot(jnp.asarray(value), jnp.asarray(valid), jnp.asarray(t_valid))
    return slots


def silent(slots: Measurements, *names: str) -> Measurements:
    """The same slots, without readings of the named sensors."""
    return {
        name: Slot(jnp.zeros_like(s.value), jnp.zeros_like(s.valid), s.t_valid) if name in names else s
        for name, s in slots.items()
    }


def estimation_error(x_hat, state) -> np.ndarray:
    e = np.array(np.asarray(x_hat) - state)
    e[..., 3:6] = wrapped(e[..., 3:6])
    return e


def nees(error, P, states) -> np.ndarray:
    """e' P^-1 e of some of the states, shape (..., n)."""
    states = np.asarray(states)
    e, P = error[..., states], np.asarray(P)[..., states, :][..., states]
    return np.sum(e * np.linalg.solve(P, e[..., None])[..., 0], axis=-1)


def effective_samples(series) -> float:
    """Independent samples worth as much as runs (n_runs, n_times) correlated in time: pooled autocorrelation."""
    centred = series - series.mean()
    variance = np.mean(centred**2)
    factor, lag = 1.0, 1
    while lag < series.shape[1]:
        rho = np.mean(centred[:, lag:] * centred[:, :-lag]) / variance
        if rho < 0.05:
            break
        factor, lag = factor + 2 * rho, lag + 1
    return series.size / factor
