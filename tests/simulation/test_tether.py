"""A tether against other solutions: the cable's differential equation, catenaries, statics; what it may never do."""

import equinox as eqx
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve
from tests.simulation.helper import vehicle

from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command
from rovtwin.core.frames import quaternion_from_euler, rotation_from_quaternion
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.simulation.environment.world import World
from rovtwin.simulation.tether.cable import ENOUGH, TOE, Cable, balance, solve
from rovtwin.simulation.tether.tether import HAULING_SPEED, Pull, Tether, TetherInput
from rovtwin.simulation.twin import Twin, TwinInput
from rovtwin.vehicle.physics.dynamics import State, kinetic_energy

DT = 0.02
DIAMETER, C_D, C_F, EA, RHO = 0.005, 1.2, 0.015, 2e4, 1000.0
ATTACHMENT = (-0.2, 0.28, -0.1)
FREE = jnp.asarray(False)


def tether(length=50.0, anchor=(0.0, 0.0, 0.0), attachment=ATTACHMENT, weight=0.0, **changes):
    cable = {"wet_weight": weight, "normal_drag": C_D, "tangential_drag": C_F, "stiffness": EA}
    cable |= {key: changes.pop(key) for key in list(changes) if key in Cable.__dataclass_fields__}
    cable = {k: v if v is None else as_array(v) for k, v in cable.items()}
    return Tether(Cable(DIAMETER, **cable), anchor, attachment, length, **changes)


def sheared(z, surface, below):
    """Velocity in n that falls from `surface` to `below` over 40 m of depth."""
    share = jnp.clip(z / 40.0, 0.0, 1.0)[..., None]
    return (1.0 - share) * jnp.asarray(surface) + share * jnp.asarray(below)


def state_at(place, attitude=(0.0, 0.0, 0.0), attachment=ATTACHMENT, nu=(0.0,) * 6):
    """A vehicle whose attachment is at a place in n."""
    q = quaternion_from_euler(jnp.asarray(attitude))
    position = jnp.asarray(place) - rotation_from_quaternion(q) @ jnp.asarray(attachment)
    return State(position, q, jnp.asarray(nu), jnp.zeros(0))


@eqx.filter_jit
def at_rest(tether, state, surface, below) -> tuple[Pull, jax.Array]:
    """Its pull and wrench on a vehicle that waits, settled in a sheared current."""
    start = Start(state.position, state.attitude, jnp.zeros(6))
    memory = tether.settled(start, lambda nodes: sheared(nodes[:, 2], surface, below))
    water = sheared(memory.line.nodes[:, 2], surface, below)
    _, pull = tether.step(memory, TetherInput(state, water, FREE), DT)
    return pull, tether.wrench(pull, state, 0.0, 0.002)


def solved(place, length, weight, surface, below):
    """Force of an elastic cable from the origin on its end, n [N]: shooting on its equations in arc length."""

    def slope(s, y):
        size = np.linalg.norm(y[3:])
        t = y[3:] / size
        u = np.asarray(sheared_np(y[2], surface, below))
        along = u @ t
        across = u - along * t
        load = 0.5 * RHO * DIAMETER * (C_D * np.linalg.norm(across) * across + np.pi * C_F * abs(along) * along * t)
        straight = size / EA < 0.5 * TOE
        strain = np.sqrt(2 * TOE * size / EA) if straight else size / EA + 0.5 * TOE
        return np.concatenate([t * (1.0 + strain), -(load + [0.0, 0.0, weight])])

    def end(tension):
        return solve_ivp(slope, (0, length), np.concatenate([np.zeros(3), tension]), rtol=1e-8, atol=1e-9).y[:, -1]

    mid = np.asarray(sheared_np(0.5 * place[2], surface, below))
    load = 0.5 * RHO * DIAMETER * C_D * np.linalg.norm(mid) * mid * length + np.array([0.0, 0.0, weight * length])
    chord = np.asarray(place) / np.linalg.norm(place)
    for pre in (0.5, 1.0, 2.0, 0.2, 5.0):
        guess = 0.5 * load + pre * np.linalg.norm(load) * chord
        tension, _, good, _ = fsolve(lambda x: end(x)[:3] - place, guess, full_output=True)
        if good == 1 and np.allclose(end(tension)[:3], place, atol=1e-5):
            return -end(tension)[3:]
    raise AssertionError("the reference did not converge")


def sheared_np(z, surface, below):
    share = np.clip(z / 40.0, 0.0, 1.0)
    return (1.0 - share) * np.asarray(surface) + share * np.asarray(below)


NONE = (0.0, 0.0, 0.0)
CASES = {
    "current across": ((0.0, 0.0, 40.0), 44.0, 0.0, (0.3, 0.0, 0.0), (0.3, 0.0, 0.0)),
    "current across, nearly taut": ((0.0, 0.0, 40.0), 40.4, 0.0, (0.3, 0.1, 0.0), (0.3, 0.1, 0.0)),
    "current across, slack": ((0.0, 10.0, 20.0), 40.0, 0.0, (0.3, 0.0, 0.0), (0.3, 0.0, 0.0)),
    "sheared current": ((5.0, 0.0, 30.0), 40.0, 0.0, (0.4, 0.0, 0.0), (0.0, 0.2, 0.0)),
    "current along": ((40.0, 0.0, 15.0), 44.0, 0.0, (0.3, 0.05, 0.0), (0.3, 0.05, 0.0)),
    "weight": ((30.0, 0.0, 10.0), 40.0, 0.2, NONE, NONE),
    "weight, level and slack": ((20.0, 0.0, 1.0), 40.0, 0.1, NONE, NONE),
    "buoyancy": ((30.0, 5.0, 20.0), 38.0, -0.1, NONE, NONE),
    "mixed": ((20.0, 10.0, 15.0), 35.0, 0.1, (0.2, -0.3, 0.0), (0.1, 0.1, 0.0)),
    "mixed, buoyant": ((-20.0, 10.0, 25.0), 38.0, -0.05, (0.2, 0.1, 0.0), (0.0, 0.3, 0.0)),
    "mixed, beyond its length": ((20.0, 10.0, 15.0), 26.9, 0.1, (0.2, -0.3, 0.0), (0.1, 0.1, 0.0)),
}
ATTITUDE = (0.1, -0.05, 0.7)


def compared(case, segments=19):
    """Force and moment in b, of the tether and of the reference."""
    place, length, weight, surface, below = CASES[case]
    state = state_at(place, ATTITUDE)
    _, wrench = at_rest(tether(length, weight=weight, segments=segments), state, jnp.array(surface), jnp.array(below))
    force = np.asarray(rotation_from_quaternion(state.attitude)).T @ solved(place, length, weight, surface, below)
    return np.asarray(wrench), np.concatenate([force, np.cross(ATTACHMENT, force)])


def off(case, segments=19) -> tuple[float, float]:
    """Errors of force and moment, each over its own size."""
    ours, theirs = compared(case, segments)
    force, moment = np.linalg.norm(theirs[:3]), np.linalg.norm(theirs[3:])
    apart = ours - theirs
    return float(np.linalg.norm(apart[:3]) / force), float(np.linalg.norm(apart[3:]) / moment)


@pytest.mark.parametrize("case", CASES)
def test_force_and_moment_against_the_differential_equation(case):
    force, moment = off(case)
    assert force < 0.02 and moment < 0.02


def test_converges_with_the_number_of_segments():
    assert max(off("mixed", 19)) < 0.4 * max(off("mixed", 10))


def root(function, low, high) -> float:
    return float(np.asarray(brentq(function, low, high)))


def catenary(span, length):
    """Parameter c of length = 2 c sinh(span / 2c)."""
    return root(lambda c: 2 * c * np.sinh(span / (2 * c)) - length, 0.02 * span, 1e3 * span)


def test_weight_alone_is_a_catenary():
    """Level span: H = w c, V = w L / 2."""
    pull, _ = at_rest(tether(44.0, weight=0.2), state_at((40.0, 0.0, 0.0)), jnp.zeros(3), jnp.zeros(3))
    c = catenary(40.0, 44.0)
    np.testing.assert_allclose(pull.line.force, [-0.2 * c, 0.0, 0.2 * 22.0], rtol=0.01, atol=1e-6)


def test_drag_across_alone_is_a_catenary_too():
    """With C_f = 0 the tension is the same everywhere, T = f c, and T phi' = f cos^2 phi gives tan phi = s / c.

    50 m of 5 mm at 0.3 m/s: 13.5 N if it stood straight across, half of it at each end.
    """
    span, length = 49.5, 50.0
    across = tether(length, tangential_drag=0.0, stiffness=1e8)
    pull, _ = at_rest(across, state_at((0.0, 0.0, span)), jnp.array([0.3, 0, 0]), jnp.array([0.3, 0, 0]))
    load = 0.5 * RHO * DIAMETER * C_D * 0.3**2
    assert load * length == pytest.approx(13.5)
    c = catenary(span, length)
    slope = length / (2 * c)
    expected = load * c * np.array([slope, 0.0, -1.0]) / np.hypot(1.0, slope)
    np.testing.assert_allclose(pull.line.force, expected, rtol=0.01, atol=1e-6)
    assert 6.4 < pull.line.force[0] < 6.75


def test_lies_on_the_floor():
    """Anchored on the floor at 10 m, the vehicle 6 m above it: L = lying + s, s = sqrt(h^2 + 2 h H / w)."""
    weight, height, distance, length = 0.3, 6.0, 30.0, 33.0
    on_floor = tether(length, (0.0, 0.0, 10.0), weight=weight, floor=10.0, segments=20)
    pull, _ = at_rest(on_floor, state_at((distance, 0.0, 10.0 - height)), jnp.zeros(3), jnp.zeros(3))

    def too_far(H):
        hanging = np.sqrt(height**2 + 2 * height * H / weight)
        return length - hanging + H / weight * np.arccosh(1 + height * weight / H) - distance

    H = root(too_far, 1e-3, 50.0)
    hanging = np.sqrt(height**2 + 2 * height * H / weight)
    assert hanging < 0.8 * length  # some of it lies
    assert float(jnp.max(pull.line.nodes[:, 2])) < 10.01
    assert pull.line.force[2] == pytest.approx(weight * hanging, rel=0.03)
    assert -pull.line.force[0] == pytest.approx(H, rel=0.05)  # friction creeps, but slowly


def test_floats_at_the_surface():
    """A buoyant, slack tether rises to the surface and no higher."""
    floating = tether(30.0, weight=-0.05, surface=0.0)
    pull, _ = at_rest(floating, state_at((20.0, 0.0, 3.0)), jnp.zeros(3), jnp.zeros(3))
    assert float(jnp.min(pull.line.nodes[:, 2])) > -0.05
    assert float(jnp.sum(pull.line.nodes[:, 2] < 0.05)) >= 5


def test_two_taut_tethers_yaw_the_vehicle_by_statics():
    """Straight behind, at y = -/+0.28 m, the starboard one with more tension: N = 0.28 (T_starboard - T_port)."""
    total, tension = 0.0, {}
    for y, stretch in ((-0.28, 1e-3), (0.28, 2e-3)):
        lever = (-0.2, y, 0.0)
        behind = tether(20.0 / (1.0 + stretch + 0.5 * TOE), (0.0, y, 5.0), lever)
        pull, wrench = at_rest(behind, state_at((20.0, y, 5.0), attachment=lever), jnp.zeros(3), jnp.zeros(3))
        total, tension[y] = total + wrench, float(pull.line.tension)
        assert tension[y] == pytest.approx(EA * stretch, rel=1e-3)
    assert total[5] == pytest.approx(0.28 * (tension[0.28] - tension[-0.28]), rel=1e-3)
    assert total[0] == pytest.approx(-sum(tension.values()), rel=1e-3)


@eqx.filter_jit
def dragged(tether, places, snagged):
    """Pulls on an attachment that is led through places (n, 3), a tick apart, in still water."""
    velocity = jnp.diff(places, axis=0, append=places[-1:]) / DT
    start = Start.at(places[0] - jnp.asarray(ATTACHMENT))
    memory = tether.init(jax.random.key(0), start)

    def tick(memory, now):
        place, v, caught = now
        state = state_at(place, nu=jnp.concatenate([v, jnp.zeros(3)]))
        return tether.step(memory, TetherInput(state, jnp.zeros_like(memory.line.nodes), caught), DT)

    return jax.lax.scan(tick, memory, (places, velocity, snagged))[1]


@pytest.mark.system
@pytest.mark.parametrize("weight", [0.0, 0.1])
def test_gives_no_energy(weight):
    """Led twice round a closed path in still water, in and out of its reach, it takes work and gives none."""
    t = jnp.arange(0.0, 120.0, DT)
    angle = 2 * jnp.pi * t / 60.0
    places = jnp.stack([12 + 6 * jnp.sin(angle), 4 * jnp.cos(angle), 8 + 3 * jnp.sin(2 * angle)], axis=1)
    pull = dragged(tether(19.0, weight=weight), places, jnp.zeros(len(t), dtype=bool))
    # The force belongs to the end of the tick.
    steps = jnp.diff(places, axis=0)
    middle = 0.5 * (pull.line.force[:-1] + jnp.concatenate([pull.line.force[:1], pull.line.force[:-2]]))
    power = jnp.sum(middle * steps, axis=1)[len(t) // 2 :]
    assert float(jnp.max(pull.line.tension)) > 1.0
    assert float(jnp.sum(power)) < 0.0


LIMP = {"normal_drag": 0.0, "tangential_drag": 0.0}


@pytest.mark.system
def test_a_straight_slack_cable_without_drag_stays_where_it_is():
    """Nothing holds it aside: without the least resistance its equations would have no solution, and give NaN."""
    nodes = jnp.linspace(0.0, 20.0, 11)[:, None] * jnp.eye(3)[0]
    limp = tether(30.0, **LIMP).cable
    move, force, stiffness = solve(balance(limp, nodes, nodes, jnp.zeros_like(nodes), as_array(30.0), DT))
    assert not move.any() and not force.any()
    assert np.linalg.eigvalsh(stiffness).min() > 1e-3


@pytest.mark.parametrize("weight", [0.0, 0.05])
def test_a_slack_cable_without_drag_resists_its_end_all_the_same(weight):
    """Led about, it never pushes its end on: K stays positive definite."""
    t = jnp.arange(0.0, 60.0, DT)
    places = jnp.stack([2.0 + 0.3 * t, 2.0 * jnp.sin(t), 5.0 + 0.0 * t], axis=1)
    pull = dragged(tether(30.0, weight=weight, **LIMP), places, jnp.zeros(len(t), dtype=bool))
    assert np.isfinite(pull.line.nodes).all()
    assert np.linalg.eigvalsh(pull.stiffness).min() > 1e-3
    assert pull.line.tension.max() < 5.0


@pytest.mark.system
def test_a_vehicle_flies_freely_on_a_slack_cable_without_drag():
    """This way and that for half a minute: as on a cable with little drag."""
    rates = jnp.array([1.0, 2.0, 3.0, 0.0, 0.0, 1.5])

    @eqx.filter_jit
    def flown(cable):
        twin = Twin(vehicle(), World(), {}, tethers={"limp": cable})

        def tick(memory, k):
            command = Command(0.5 * jnp.sin(0.01 * k * rates))
            memory, output = twin.step(memory, TwinInput(command, k), DT)
            return memory, output.state.position

        return jax.lax.scan(tick, twin.init(jax.random.key(0), Start.at((3.0, 0.0, 5.0))), jnp.arange(1500))[1]

    free, dragging = flown(tether(30.0, **LIMP)), flown(tether(30.0, normal_drag=0.1, tangential_drag=1e-3))
    assert np.ptp(free, axis=0).max() > 0.5
    np.testing.assert_allclose(free, dragging, atol=0.02)


def elastic_energy(held, line, end):
    """Of a cable whose last node is at `end`: EA times the integral of its law over the strain [J]."""
    segment = line.length / held.segments
    edges = jnp.diff(line.nodes.at[-1].set(end), axis=0)
    e = jnp.maximum(jnp.sqrt(jnp.sum(edges * edges, axis=1)) / segment - 1.0, 0.0)
    each = jnp.where(e < TOE, e**3 / (6 * TOE), 0.5 * e * (e - TOE) + TOE**2 / 6)
    return held.cable.stiffness * segment * jnp.sum(each)


@eqx.filter_jit
def energy_of_a_body_between(tethers, mass, velocity):
    """Kinetic energy and that of its cables, at first and after each tick [J]; nothing but them brakes it."""
    none, unit = jnp.zeros((6, 6)), jnp.diag(jnp.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1]))
    body = vehicle(
        rigid_body_mass=mass * unit, added_mass=none, linear_damping_ahead=none, quadratic_damping_ahead=none,
        weight=0.0, buoyancy=0.0, displaced_mass=0.0,
    )  # fmt: skip
    twin = Twin(body, World(), {}, tethers=tethers)

    def energy(memory):
        state, lines = memory.state, {name: held.line for name, held in memory.tethers.items()}
        elastic = [elastic_energy(held, lines[name], state.position) for name, held in tethers.items()]
        return kinetic_energy(body, state.nu) + sum(elastic)

    def tick(memory, k):
        memory, _ = twin.step(memory, TwinInput(Command(jnp.zeros(6)), k), DT)
        return memory, energy(memory)

    start = Start(jnp.array([0.0, 0.0, 10.0]), jnp.array([1.0, 0.0, 0.0, 0.0]), velocity)
    memory = twin.init(jax.random.key(0), start)
    return energy(memory), jax.lax.scan(tick, memory, jnp.arange(1500))[1]


@pytest.mark.system
@pytest.mark.parametrize("sides", [(1.0,), (1.0, -1.0)])
@pytest.mark.parametrize("stretch", [0.0, 1.5e-3])
def test_a_body_on_taut_cables_gains_no_energy(sides, stretch):
    """At K = 0.1 m / dt^2 not 1 %; at ten times that it swings wider at first, and comes to rest all the same."""
    velocity = jnp.array([-0.3, 0.1, 0.0, 0.0, 0.0, 0.0])
    for length, stiffness in ((2.0, 2e4), (2.0, 1e6), (20.0, 2e4), (20.0, 1e6)):
        taut = {
            f"t{i}": tether(
                length / (1.0 + stretch), (side * length, 0.0, 10.0), NONE, stiffness=stiffness, segments=10, snag=5
            )
            for i, side in enumerate(sides)
        }
        for share, most in ((0.1, 1.01), (1.0, 2.0)):
            mass = len(sides) * stiffness / length * DT**2 / share
            begin, after = energy_of_a_body_between(taut, as_array(mass), velocity)
            assert float(after.max()) < most * float(begin), (length, stiffness, share)
            assert float(after[-1]) < float(begin), (length, stiffness, share)


@pytest.mark.system
def test_a_jerk_that_the_iterations_do_not_resolve_is_reported():
    """Jerked at 3 m/s, by how much a tension is off: mostly with one iteration a tick, hardly ever with all six."""
    t = jnp.arange(0.0, 10.0, DT)
    places = jnp.stack([5.0 + 3.0 * t, 0.0 * t, 5.0 + 0.0 * t], axis=1)
    free = jnp.zeros(len(t), dtype=bool)
    hasty, patient = (dragged(tether(19.0, iterations=n), places, free).line.misjudged for n in (1, 6))
    assert np.mean(hasty > ENOUGH) > 0.5
    assert np.mean(patient > ENOUGH) < 0.02 and patient.max() < 1.0


@pytest.mark.system
def test_snagged_holds_where_it_was_caught():
    """Caught half-way, the vehicle can go on only as far as the other half is long; let go, it has all of it again."""
    t = jnp.arange(0.0, 60.0, DT)
    places = jnp.stack([5.0 + 0.3 * jnp.minimum(t, 45.0), 0.0 * t, 5.0 + 0.0 * t], axis=1)
    caught = (t > 5.0) & (t < 50.0)
    limp = tether(30.0, weight=0.02, stiffness=200.0, snag=8, segments=16)
    pull = dragged(limp, places, caught)
    held = pull.line.nodes[:, 8]
    during = np.asarray(caught)
    assert np.abs(held[during] - held[during][0]).max() < 0.02
    free = dragged(limp, places, jnp.zeros(len(t), dtype=bool))
    late = np.asarray((t > 45.0) & (t < 50.0))
    assert pull.line.tension[late].min() > 3.0 + free.line.tension[late].max()
    np.testing.assert_allclose(pull.line.force[-1], free.line.force[-1], atol=0.2)


def test_tended_follows_the_distance_up_to_what_is_on_the_drum():
    places = jnp.stack([jnp.linspace(0.2, 30.0, 1000), jnp.zeros(1000), jnp.full(1000, 1.0)], axis=1)
    tended = tether(25.0, slack=as_array(1.1))
    length = np.asarray(dragged(tended, places, jnp.zeros(1000, dtype=bool)).line.length)
    distance = np.linalg.norm(places, axis=1)
    np.testing.assert_allclose(length, np.clip(1.1 * distance, 2.0, 25.0), atol=1e-5)


def test_a_tended_tether_that_comes_free_is_hauled_in_gently():
    """Caught while the vehicle comes back, metres are slack when it is let go: hauled in at once, it would yank."""
    t = jnp.arange(0.0, 40.0, DT)
    places = jnp.stack([12.0 - 0.3 * jnp.clip(t - 5.0, 0.0, 20.0), 0.0 * t, 3.0 + 0.0 * t], axis=1)
    pull = dragged(tether(25.0, slack=as_array(1.1)), places, (t > 5.0) & (t < 25.0))
    length, after = np.asarray(pull.line.length), np.asarray(t) > 25.0
    assert length[after][0] > 1.4 * np.linalg.norm(places[-1])
    assert np.diff(length).min() >= -HAULING_SPEED * DT - 1e-9
    np.testing.assert_allclose(length[-1], 1.1 * np.linalg.norm(places[-1]), rtol=1e-6)
    assert pull.line.tension[after].max() < 2.0  # drag of the line that comes in


def test_the_pull_follows_the_vehicle_within_a_tick():
    """Moved aside by a little, the vehicle feels K times that: what the cable itself gives if solved again there."""
    place, aside = jnp.array([15.0, 3.0, 8.0]), jnp.array([2e-4, -1e-4, 1e-4])
    taut = tether(17.0, weight=0.1)

    @eqx.filter_jit
    def first_pull(velocity):
        memory = taut.init(jax.random.key(0), Start.at(place - jnp.asarray(ATTACHMENT)))
        state = state_at(place, nu=jnp.concatenate([velocity, jnp.zeros(3)]))
        return taut.step(memory, TetherInput(state, jnp.zeros_like(memory.line.nodes), FREE), DT)[1]

    # At the velocity that takes it aside within the tick, the cable is solved there.
    pull, moved = first_pull(jnp.zeros(3)), first_pull(aside / DT)
    wrench = taut.wrench(pull, state_at(place + aside), DT, 0.0)
    np.testing.assert_allclose(wrench[:3], moved.line.force, atol=0.02 * float(np.linalg.norm(pull.stiffness @ aside)))


@pytest.fixture(scope="module")
def at_its_limit():
    """90 s at full thrust ahead on two tethers of 8 m, the port one 2 cm shorter: state and lines, a tick apart."""
    lengths = {"port": (-0.28, 7.98), "starboard": (0.28, 8.0)}
    pair = {name: tether(length, (0.0, y, 5.0), (-0.2, y, 0.0)) for name, (y, length) in lengths.items()}
    twin = Twin(vehicle(), World(), {}, tethers=pair)
    ahead = Command(jnp.eye(6)[0])

    def tick(memory, k):
        memory, output = twin.step(memory, TwinInput(ahead, k), DT)
        return memory, (output.state, {name: held.line for name, held in memory.tethers.items()})

    @jax.jit
    def run():
        return jax.lax.scan(tick, twin.init(jax.random.key(0), Start.at((3.0, 0.0, 5.0))), jnp.arange(4500))[1]

    return run()


@pytest.mark.system
def test_holds_the_vehicle_at_its_length(at_its_limit):
    """It stops there, gives back no energy, and lies still: the sum of both tensions is the thrust."""
    state, lines = at_its_limit
    stern = np.linalg.norm(np.diff(np.asarray(lines["starboard"].nodes)[:, [0, -1]], axis=1), axis=-1)
    assert stern.max() < 8.05
    speed = np.linalg.norm(state.nu[:, :3], axis=1)
    assert speed.max() > 0.2
    assert speed[-1000:].max() < 2e-3
    total = sum(line.force[-1] for line in lines.values())
    np.testing.assert_allclose(total, -10.0 * rotation_from_quaternion(state.attitude[-1])[:, 0], atol=0.1)


def test_two_tethers_yaw_the_vehicle_in_the_twin(at_its_limit):
    """The shorter one pulls its side back, until both levers balance: 10 N ahead, no moment about CO."""
    state, lines = at_its_limit
    R = np.asarray(rotation_from_quaternion(state.attitude[-1]))
    levers = {"port": (-0.2, -0.28, 0.0), "starboard": (-0.2, 0.28, 0.0)}
    moments = {name: np.cross(levers[name], R.T @ np.asarray(lines[name].force[-1]))[2] for name in levers}
    assert R[1, 0] < -0.01  # heads to port
    assert sum(moments.values()) == pytest.approx(0.0, abs=0.02)
    assert abs(moments["port"]) > 0.5


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"length": -1.0}, "Tether.length: found -1.0, expected a number above 0"),
        ({"slack": as_array(0.9)}, "Tether.slack: found 0.9, expected a ratio of at least 1"),
        ({"anchor": (0.0, 0.0)}, "Tether.anchor: found shape"),
        ({"stiffness": 0.0}, "Cable.stiffness: found 0.0, expected a number above 0"),
        ({"segments": 1}, "Tether.segments: found 1, expected 2 or more"),
        ({"snag": 19}, "Tether.snag: found 19, expected a node from 1 to 18"),
    ],
)
def test_no_tether_like_that(bad, message):
    with pytest.raises(ConfigError, match=message):
        tether(**bad)
