"""The bare plant: steps per second of one vehicle, of many, and the gradient of a roll-out."""

from typing import Any

import numpy as np
from tests import oracle

from benchmarks import reference
from benchmarks.timing import in_turns, rates, ratio
from rovtwin.core.arrays.batch import batched
from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle import Model, load_vehicle
from rovtwin.vehicle.physics.dynamics import State, plant_step, rollout

DT = 0.002
CURRENT = np.array([0.1, -0.05, 0.0])
SIZES = {1: 2_000, 32: 2_000, 1_000: 250, 10_000: 50}  # vehicles, and how many steps each
LANES = 8
GRADIENT_STEPS = 2000


def vehicle() -> Model:
    return load_vehicle("double_blueye").model()


def water() -> Environment:
    return Environment.calm(velocity=jnp.asarray(CURRENT))


def commands(model: Model, steps: int, seed: int = 0) -> np.ndarray:
    """New commands every half second, shape (steps, n)."""
    rng = np.random.default_rng(seed)
    every = 250
    return np.repeat(rng.uniform(-0.6, 0.6, (steps // every + 1, model.thrusters.count)), every, axis=0)[:steps]


def fly(model: Model, state: State, u: Any, environment: Environment) -> State:
    """Last state after all commands; nothing is kept on the way, as in the versions in C and in NumPy."""

    def step(state, u):
        return plant_step(model, state, Command(u), environment, DT), None

    return jax.lax.scan(step, state, u)[0]


def numpy_fly(plant: oracle.Plant, u: np.ndarray) -> np.ndarray:
    """The same in plain NumPy, from the same start: [eta, nu]."""
    x, thrust = np.zeros(12), np.zeros(u.shape[1])
    for command in u:
        x, thrust = oracle.step(plant, x, thrust, command, DT, CURRENT)
    return x


def as_row(state: State) -> np.ndarray:
    """[position, attitude, nu, thrust], shape (..., 13 + n), as the version in C has it."""
    return np.concatenate([state.position, state.attitude, state.nu, state.thrust], axis=-1)


def single(quick: bool) -> dict[str, Any]:
    """One vehicle: RK4 steps per second, compiled against C and NumPy; all end in the same place."""
    steps, few, rounds = (5_000, 100, 3) if quick else (100_000, 1_000, 11)
    model, environment = vehicle(), water()
    plant = oracle.plant_of(model)
    u, start = commands(model, steps), State.at(model, Start.at())
    run = jax.jit(fly)
    u_device = jnp.asarray(u)
    same = np.asarray(run(model, start, u_device[:few], environment).position)
    np.testing.assert_allclose(same, numpy_fly(plant, u[:few])[:3], atol=1e-7)
    actions = {
        "compiled": lambda: run(model, start, u_device, environment).position.block_until_ready(),
        "numpy": lambda: numpy_fly(plant, u[:few]),
    }
    if reference.compiler():
        in_c = reference.Reference([model], [start], CURRENT)
        laid = in_c.commands(u[None])
        end = as_row(run(model, start, u_device, environment))
        np.testing.assert_allclose(in_c.fly(laid, DT)[0], end, atol=1e-9)
        actions["c"] = lambda: in_c.fly(laid, DT)
    times = in_turns(actions, rounds)
    found: dict[str, Any] = {
        "compiled_steps_per_s": rates(times["compiled"], steps),
        "numpy_steps_per_s": rates(times["numpy"], few),
        "ratio": ratio(times["compiled"], times["numpy"], steps, few),
    }
    if "c" not in times:
        return found | {"c": reference.NO_COMPILER}
    return found | {
        "c": reference.description(),
        "c_steps_per_s": rates(times["c"], steps),
        "share_of_c": ratio(times["compiled"], times["c"], steps, steps),
    }


def open_tcp_server(n: int, steps: int, dtype: Any = float) -> tuple[Model, State, Any]:
    """n vehicles with parameters, starts and commands of their own."""
    model = vehicle()
    scale = jnp.linspace(0.9, 1.1, n)
    models = jax.vmap(lambda s: model.replace(added_mass=s * model.added_mass))(scale)
    starts = jax.vmap(lambda s: State.at(model, Start.at((s, 0.0, 1.0))))(scale)
    different = np.stack([commands(model, steps, seed) for seed in range(min(n, 500))])
    u = jnp.asarray(np.resize(different, (n, *different.shape[1:])))
    return jax.tree.map(lambda leaf: leaf.astype(dtype) if leaf.dtype == float else leaf, (models, starts, u))


def batch(quick: bool) -> dict[str, Any]:
    """Many vehicles: vehicle-steps per second, in chunks as `batched` does it, and of the largest crowd all at once."""
    sizes, rounds = ({1: 100, 32: 50}, 3) if quick else (SIZES, 7)
    environment, largest = water(), max(sizes)

    def alone(model: Model, state: State, u: Any) -> State:
        return fly(model, state, u, environment)

    in_chunks, side_by_side = jax.jit(batched(alone)), jax.jit(jax.vmap(alone))
    crowds = {n: open_tcp_server(n, steps) for n, steps in sizes.items()}

    def action(run: Any, n: int) -> Any:
        return lambda: run(*crowds[n]).position.block_until_ready()

    actions = {f"vehicles_{n}": action(in_chunks, n) for n in sizes}
    actions[f"vehicles_{largest}_unchunked"] = action(side_by_side, largest)
    work = {f"vehicles_{n}": n * steps for n, steps in sizes.items()}
    work[f"vehicles_{largest}_unchunked"] = work[f"vehicles_{largest}"]
    times = in_turns(actions, rounds)
    return {name: rates(times[name], work[name]) for name in actions}


def lanes(quick: bool) -> dict[str, Any]:
    """An engine of another kind: the plant in C, eight vehicles in the lanes of its vectors, against ours."""
    if not reference.compiler():
        return {"c": reference.NO_COMPILER}
    steps, rounds = (100, 3) if quick else (1_000, 11)
    environment = water()
    models, starts, u = open_tcp_server(LANES, steps)
    run = jax.jit(batched(lambda *one: fly(*one, environment)))
    pick = [jax.tree.map(lambda leaf, i=i: leaf[i], (models, starts)) for i in range(LANES)]
    in_c = reference.Reference([m for m, _ in pick], [s for _, s in pick], CURRENT)
    laid = in_c.commands(np.asarray(u))
    np.testing.assert_allclose(in_c.fly(laid, DT), as_row(run(models, starts, u)), atol=1e-9)
    many = 8 if quick else 1_000
    few = steps // 10 or 1
    ours = open_tcp_server(many, few)
    times = in_turns({"c": lambda: in_c.fly(laid, DT), "ours": lambda: run(*ours).position.block_until_ready()}, rounds)
    return {
        "c": reference.description(),
        "c_steps_per_s": rates(times["c"], LANES * steps),
        "ratio": ratio(times["c"], times["ours"], LANES * steps, many * few),
    }


def gradient(quick: bool) -> dict[str, Any]:
    """Gradient of a cost over 2,000 steps with respect to 20 parameters: in seconds, and in roll-outs."""
    steps, rounds = (200, 3) if quick else (GRADIENT_STEPS, 11)
    model = vehicle()
    start, u = State.at(model, Start.at()), Command(jnp.asarray(commands(model, steps)))
    diagonals = [model.added_mass, model.linear_damping_ahead, model.quadratic_damping_ahead]
    theta = jnp.concatenate([*(jnp.diagonal(m) for m in diagonals), model.center_of_gravity[2:], model.buoyancy[None]])

    def cost(theta):
        M_A, linear, quadratic = (jnp.diag(theta[i : i + 6]) for i in (0, 6, 12))
        changed = model.replace(
            added_mass=M_A,
            linear_damping_ahead=linear,
            linear_damping_astern=linear,
            quadratic_damping_ahead=quadratic,
            quadratic_damping_astern=quadratic,
            center_of_gravity=model.center_of_gravity.at[2].set(theta[18]),
            buoyancy=theta[19],
        )
        states = rollout(changed, start, u, water(), DT)
        return jnp.mean(states.position**2) + jnp.mean(states.nu**2)

    value, slope = jax.jit(cost), jax.jit(jax.grad(cost))
    assert theta.shape == (20,) and np.isfinite(slope(theta)).all()
    times = in_turns(
        {"cost": lambda: value(theta).block_until_ready(), "gradient": lambda: slope(theta).block_until_ready()}, rounds
    )
    return {
        "steps": steps,
        "parameters": 20,
        "gradient_s": 1.0 / rates(times["gradient"], 1.0)["median"],
        "cost_s": 1.0 / rates(times["cost"], 1.0)["median"],
        "gradient_in_costs": ratio(times["cost"], times["gradient"], 1.0, 1.0)["median"],
    }
