"""The package with its types checked: `python -m tests.shapes loop` or `estimate`, in a process of its own.

Shapes in types are read by people and editors; here jaxtyping and beartype check them at every call. Programs are
traced and not compiled: `jax.eval_shape` gives a function arrays that have a shape and no values.

`ROVTWIN_SHAPES=1 pytest ..` runs any other test in this way (`conftest.py`). Not all pass: JAX takes NumPy's arrays and
integers where a type says an Array of floats, and tests make use of it.
"""

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from jaxtyping import TypeCheckError, install_import_hook

CHECKER = "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))"  # an int will do for a float
WHERE = (
    *("rovtwin.core.arrays", "rovtwin.core.block", "rovtwin.core.flow", "rovtwin.core.frames", "rovtwin.gnc"),
    *("rovtwin.commission.dip", "rovtwin.commission.evidence", "rovtwin.commission.proving"),
    *("rovtwin.identification", "rovtwin.monitoring", "rovtwin.planning", "rovtwin.positioning"),
    *("rovtwin.report.parts", "rovtwin.report.series"),
    *("rovtwin.runs.compose", "rovtwin.runs.feasibility", "rovtwin.runs.loop", "rovtwin.runs.scoring"),
    *("rovtwin.simulation", "rovtwin.survey", "rovtwin.vehicle"),
)
DT = 0.02


def checked() -> Any:
    """From here on what is imported of the package is checked; until the end of a `with` block."""
    return install_import_hook(WHERE, CHECKER)


@contextmanager
def gathered(problems: list[str], what: str) -> Iterator[None]:
    """What is found wrong within goes to the problems, and the next thing is looked at."""
    try:
        yield
    except TypeCheckError as error:
        problems.append(f"{what}: {error}")


def trace_blocks(problems: list[str]) -> int:
    """`init` and one `step` of the example of every Block, autopilots and sensors among them; how many."""
    from tests.block_examples import EXAMPLES, START

    from rovtwin.core.numerics import jax

    for name, make in EXAMPLES.items():
        with gathered(problems, name):
            shown = make()
            memory = jax.eval_shape(shown.block.init, jax.random.key(0), START)
            one = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape[1:], leaf.dtype), shown.inputs)
            jax.eval_shape(lambda m, i, shown=shown: shown.block.step(m, i, shown.dt), memory, one)
    return len(EXAMPLES)


def trace_vehicles(problems: list[str]) -> int:
    """Description and Model of every vehicle in the library, a roll-out of each form of Model; how many."""
    from rovtwin.core.block import Start
    from rovtwin.core.flow import Command, Environment
    from rovtwin.core.numerics import jax, jnp
    from rovtwin.vehicle import list_library, load_vehicle
    from rovtwin.vehicle.physics.dynamics import State, rollout

    names, seen = list_library(), set()
    water = Environment.calm(surface=jnp.zeros(()), gradient=jnp.zeros((3, 3)))
    for name in names:
        with gathered(problems, name):
            model = load_vehicle(name).model()
            form = str(jax.tree.map(jnp.shape, model))
            if form in seen:
                continue
            seen.add(form)
            commands = jax.vmap(Command)(jnp.zeros((3, model.thrusters.count)))
            start = State.at(model, Start.at((0.0, 0.0, 3.0)))
            jax.eval_shape(lambda m, s, c: rollout(m, s, c, water, DT), model, start, commands)
    return len(names)


def trace_estimate(problems: list[str]) -> int:
    """Normal equations, residuals and balance of forces of the joint estimate, of a log of four seconds; how many."""
    from tests.identification.synthetic import records_of, steps_command

    from rovtwin.core.numerics import jax, jnp
    from rovtwin.identification.joint.model.catalogue import catalogue, choose
    from rovtwin.identification.joint.model.prior import default_prior
    from rovtwin.identification.joint.solver.problem import Problem
    from rovtwin.identification.joint.solver.segments import Grid, cut
    from rovtwin.identification.joint.solver.shooting import Shooting
    from rovtwin.vehicle import load_vehicle
    from rovtwin.vehicle.physics.dynamics import State

    with gathered(problems, "joint estimate"):
        vehicle = load_vehicle("bluerov2_heavy")
        level = jnp.tile(jnp.array([1.0, 0.0, 0.0, 0.0]), (400, 1))
        path = jax.vmap(State)(jnp.zeros((400, 3)), level, jnp.zeros((400, 6)), jnp.zeros((400, 8)))
        log = records_of(path, *steps_command(vehicle, 0, 4.0), 4.0, 0, ("position", "attitude", "gyro"))
        parameters, segments = choose(catalogue(vehicle), ["*"]), cut([log], Grid(steps=50))
        problem = Problem(Shooting(parameters, segments), default_prior(parameters, vehicle))
        theta, offsets = jnp.zeros(len(parameters)), jnp.zeros(len(problem.groups))
        nodes, sigma = jax.tree.map(jnp.asarray, problem.guess), jnp.ones(len(problem.groups))
        shooting, balance = problem.shooting, problem.shooting.balance
        jax.eval_shape(shooting.blocks, theta, offsets, nodes, sigma, segments.arrays)
        jax.eval_shape(shooting.residuals, theta, offsets, nodes, segments.arrays)
        jax.eval_shape(balance.missing, theta, balance.arrays_of(segments))
    return 3


def trace_monitor(problems: list[str]) -> int:
    """Two steps of the filter that watches a vehicle; how many filters."""
    import equinox as eqx

    from rovtwin.core.numerics import jax, jnp
    from rovtwin.monitoring.filter import Levers, Seen
    from rovtwin.monitoring.monitor import Monitor
    from rovtwin.vehicle import load_vehicle

    with gathered(problems, "monitor"):
        model = load_vehicle("double_blueye").model()
        n, place = model.thrusters.count, jnp.zeros(3)
        level = jnp.array([1.0, 0.0, 0.0, 0.0])
        filter = Monitor(model, [f"{i}" for i in range(n)], Levers(place, place, place)).filter
        read = Seen(jnp.zeros(n), place, level, jnp.zeros(1), place, jnp.zeros(2), jnp.ones(12), jnp.zeros(5))
        both, held = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), read), jnp.zeros(filter.factors)
        memory = filter.start(place, level)
        eqx.filter_eval_shape(filter.over, memory, held, both)
        eqx.filter_eval_shape(filter.held_at, memory, held)
    return 1


def wrong_calls() -> dict[str, Callable[[], Any]]:
    """With a wrong shape or kind of number: each must be refused."""
    from rovtwin.core.frames import rotation_from_quaternion
    from rovtwin.core.numerics import jnp
    from rovtwin.vehicle import load_vehicle
    from rovtwin.vehicle.physics.dynamics import State, damping_wrench
    from rovtwin.vehicle.physics.thrusters import static_force, thrusters_from

    model, zeros = load_vehicle("double_blueye").model(), jnp.zeros
    return {
        "nu of five components": lambda: damping_wrench(model, zeros(5)),
        "nu of integers": lambda: damping_wrench(model, zeros(6, dtype=int)),
        "a rotation in place of a quaternion": lambda: rotation_from_quaternion(zeros((3, 3))),
        "a position on a plane": lambda: State(zeros(2), zeros(4), zeros(6), zeros(8)),
        "three forces of two thrusters": lambda: thrusters_from(zeros((6, 2)), zeros(3)),
        "commands of two vehicles": lambda: static_force(model.thrusters, zeros((2, 8))),
    }


def accepted() -> list[str]:
    """Which of the wrong calls went through."""
    passed = []
    for what, call in wrong_calls().items():
        try:
            call()
        except TypeCheckError:
            continue
        except Exception:  # the mathematics noticed, and not the type
            pass
        passed.append(f"{what}: not refused")
    return passed


def loop(problems: list[str]) -> str:
    """All that flies: blocks and vehicles, and the calls that must be refused."""
    blocks, vehicles = trace_blocks(problems), trace_vehicles(problems)
    problems += accepted()
    return f"{blocks} blocks and {vehicles} vehicles"


def estimate(problems: list[str]) -> str:
    """What is found from recordings: the estimate, and the monitor."""
    return f"{trace_estimate(problems)} parts of the estimate and {trace_monitor(problems)} monitor"


def main(what: str) -> None:
    """Prints how much was traced, or ends with the problems."""
    gc.disable()  # a trace makes many objects that live, and the process ends soon
    problems: list[str] = []
    with checked():
        traced = {"loop": loop, "estimate": estimate}[what](problems)
    if problems:
        raise SystemExit("\n\n".join(problems))
    print(f"{traced} traced")


if __name__ == "__main__":
    main(sys.argv[1])
