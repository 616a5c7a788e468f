"""A 30 kg vehicle and a tiny closed loop with perfect feedback: real physics, no sensors, no filter."""

import equinox as eqx
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import AutopilotInput, Environment, Estimate, Slot
from rovtwin.core.frames import euler_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.gnc.guidance.mission import mission
from rovtwin.vehicle.physics.dynamics import State, plant_step
from rovtwin.vehicle.physics.model import Model, rigid_body_matrix
from rovtwin.vehicle.physics.thrusters import thrusters_from

DT = 0.02
ARM = 0.28

LAWNMOWER = [(6, 0), (6, 3), (0, 3), (0, 6), (6, 6), (6, 9), (0, 9)]  # thesis, table 8.3; depth 3 m
SQUARE = [(3, 0), (3, 3), (0, 3), (0, 0)]  # thesis 7.4; depth 3 m


def points(corners, depth=3.0, **others):
    return [{"x": x, "y": y, "depth": depth} | others for x, y in corners]


def route(corners, depth=3.0, **others):
    return mission(points(corners, depth, **others))


def two_bodies() -> np.ndarray:
    """T of two bodies side by side, each with a surge, a sway and a heave thruster (thesis 5.2, port first)."""
    columns = [[[1, 0, 0, 0, 0, -y], [0, 1, 0, 0, 0, 0], [0, 0, 1, y, 0, 0]] for y in (-ARM, ARM)]
    return np.array(columns, dtype=float).reshape(6, 6).T


def thirty_kg(lag: float = 0.2, T: np.ndarray | None = None, **changes) -> Model:
    """Towing-tank drag, a metacentric height of 30 mm, W = B; six thrusters of 10, 5 and 11 N unless T says others."""
    T = two_bodies() if T is None else T
    n = T.shape[1]
    force = np.resize([10.0, 5.0, 11.0], n)
    given = {
        "rigid_body_mass": rigid_body_matrix(30.0, np.diag([2.83, 0.9, 3.11]), [0.0, 0.0, 0.03]),
        "added_mass": np.diag([15.0, 30.0, 60.0, 2.2, 0.6, 0.9]),
        "linear_damping_ahead": np.diag([6.5, 5.0, 10.0, 1.0, 1.0, 0.2]),
        "quadratic_damping_ahead": np.diag([159.0, 250.0, 800.0, 4.0, 4.0, 8.5]),
        "weight": 294.3,
        "buoyancy": 294.3,
        "center_of_gravity": [0.0, 0.0, 0.03],
        "center_of_buoyancy": [0.0, 0.0, 0.0],
        "thrusters": thrusters_from(jnp.asarray(T), jnp.asarray(force), time_constant=jnp.full(n, lag)),
    }
    return Model(**(given | changes))


def aft(lever: float = 0.15) -> Model:
    """The same with its vertical thrusters a lever [m] behind CG, so that heave pitches it."""
    T = two_bodies()
    T[4] += lever * T[2]
    return thirty_kg(T=T)


def estimate_of(eta, nu=np.zeros(6), std=0.01) -> Estimate:
    eta, nu = jnp.asarray(eta, dtype=float), jnp.asarray(nu, dtype=float)
    return Estimate.from_euler(eta, nu, jnp.zeros(6), std**2 * jnp.eye(12), jnp.zeros(1), jnp.zeros(1))


class Perfect(Block):
    """Believes the slot `truth`: eta, nu and the standard deviation to claim."""

    def init(self, key: Array, start: Start) -> Array:
        return jnp.zeros(())

    def step(self, memory: Array, input, dt: float):
        truth = input.measurements["truth"].value[0]
        return memory + dt, estimate_of(truth[:6], truth[6:12], truth[12])


def truth_of(state: State) -> Array:
    return jnp.concatenate([state.position, euler_from_quaternion(state.attitude), state.nu])


def feel(truth: Array, request, std=0.01) -> AutopilotInput:
    value = jnp.append(truth, std)[None]
    return AutopilotInput({"truth": Slot(value, jnp.ones(1, dtype=bool), jnp.zeros(1))}, jnp.asarray(request))


def fly(autopilot, model, start, requests, disturbance=None, offset=None):
    """Truth (n, 12) and outputs of the autopilot over one request per tick, shape (n,).

    `disturbance` is a wrench on the vehicle, b (6,); `offset` is added to what the observer is given, shape (n, 12).
    """
    # Always arrays: one compilation for each length of flight.
    disturbance = jnp.zeros(6) if disturbance is None else jnp.asarray(disturbance, dtype=float)
    offset = jnp.zeros((len(requests), 12)) if offset is None else jnp.asarray(offset)
    return _fly(autopilot, model, start, jnp.asarray(requests), disturbance, offset)


@eqx.filter_jit
def _fly(autopilot, model, start, requests, disturbance, offset):
    environment = eqx.tree_at(lambda e: e.wrench, Environment.calm(), disturbance)

    def tick(carry, inputs):
        memory, state = carry
        request, off = inputs
        truth = truth_of(state)
        memory, output = autopilot.step(memory, feel(truth + off, request), DT)
        return (memory, plant_step(model, state, output.command, environment, DT)), (truth, output)

    begin = autopilot.init(jax.random.key(0), start), State.at(model, start)
    return jax.lax.scan(tick, begin, (requests, offset))[1]


def run_lengths(values) -> list[int]:
    """The values without repeats."""
    values = np.asarray(values)
    return [int(v) for v in values[np.flatnonzero(np.diff(values, prepend=values[0] - 1))]]
