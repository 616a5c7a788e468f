"""Top speed, stopping and coasting: against closed forms, against the plant, and where there is no answer."""

import numpy as np
import pytest

from rovtwin.core.flow import Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle import load_vehicle, summary, vehicle_from_dict
from rovtwin.vehicle.analysis.performance import COASTED, DIRECTIONS, performance
from rovtwin.vehicle.analysis.stability import stability
from rovtwin.vehicle.physics.dynamics import State, coriolis_wrench, plant_step, restoring_wrench
from rovtwin.vehicle.physics.model import Model, rigid_body_matrix
from rovtwin.vehicle.physics.thrusters import static_force, thrusters_from

MASS, DRAG = 50.0, 100.0
EVERY_WAY = [(axis, k) for axis in DIRECTIONS for k in (0, 1)]


def simple(linear=0.0, quadratic=DRAG, ahead=20.0, astern=20.0, net=0.0, **thruster) -> Model:
    """One thruster on each of surge, sway, heave and yaw; the same mass and drag on all axes."""
    eye = np.eye(6)
    weight = MASS * 9.81
    return Model(
        rigid_body_mass=rigid_body_matrix(MASS, MASS * np.eye(3), np.zeros(3)),
        added_mass=np.zeros((6, 6)),
        linear_damping_ahead=linear * eye,
        quadratic_damping_ahead=quadratic * eye,
        weight=weight,
        buoyancy=weight + net,
        center_of_gravity=np.zeros(3),
        center_of_buoyancy=np.array([0.0, 0.0, -0.02]),
        thrusters=thrusters_from(
            jnp.asarray(eye[:, [0, 1, 2, 5]]),
            jnp.full(4, ahead),
            jnp.full(4, astern),
            **{key: jnp.full(4, value) for key, value in thruster.items()},
        ),
    )


@pytest.mark.parametrize("linear", [0.0, 12.0])
def test_closed_forms_without_lag(linear):
    """Quadratic and linear drag, thrust at once: m v dv/dx = -F - (l + q v) v is solved by hand."""
    able = performance(simple(linear))["surge"]["ahead"]
    v = (-linear + np.sqrt(linear**2 + 4 * DRAG * 20.0)) / (2 * DRAG)
    assert able.force == 20.0 and able.top_speed == pytest.approx(v, rel=1e-12)
    ratio = (linear + DRAG * v) / (linear + DRAG * COASTED * v)
    assert able.coasting_distance == pytest.approx(MASS / DRAG * np.log(ratio), rel=1e-7)
    if linear == 0.0:
        assert able.stopping_distance == pytest.approx(MASS / (2 * DRAG) * np.log(2.0), rel=1e-7)
        assert able.stopping_time == pytest.approx(MASS / np.sqrt(DRAG * 20.0) * np.pi / 4, rel=1e-7)
        assert able.coasting_time == pytest.approx(MASS / (DRAG * v) * (1 / COASTED - 1), rel=1e-7)


def test_lag_and_linear_drag_by_hand():
    """m v_dot = F (2 e^(-t/T) - 1) - l v from v = F / l, solved by hand: at the time said it rests."""
    F, T, l = 20.0, 0.7, 30.0
    able = performance(simple(l, 0.0, time_constant=T))["sway"]["port"]
    swift = 2 * F / (l - MASS / T)
    slow = F / l + F / l - swift
    t, tau = able.stopping_time, MASS / l
    assert -F / l + swift * np.exp(-t / T) + slow * np.exp(-t / tau) == pytest.approx(0.0, abs=1e-7)
    way = -F / l * t + swift * T * (1 - np.exp(-t / T)) + slow * tau * (1 - np.exp(-t / tau))
    assert able.stopping_distance == pytest.approx(way, rel=1e-6)


THRUSTERS = [
    {},
    {"time_constant": 0.5},
    {"rate_limit": 15.0},
    {"time_constant": 0.4, "rate_limit": 30.0},
    {"time_constant": 0.4, "rate_limit": 1e6},
    {"exponent": 1.5, "dead_band": 0.1, "health": 0.6, "time_constant": 0.2},
]


DT, STEPS = 0.002, 10_000


@jax.jit
def rolled(model: Model, state: State, command: Command):
    """nu after each step, shape (STEPS, 6)."""

    def step(carry, _):
        after = plant_step(model, carry, command, Environment.calm(), DT)
        return after, after.nu

    return jax.lax.scan(step, state, None, length=STEPS)[1]


def flown(model: Model, axis: int, sign: float, speed: float, coasting: bool) -> tuple[float, float]:
    """Distance and time in which the plant, free on all axes, slows down from a speed under full thrust."""
    u = np.sign(sign * np.asarray(model.thrusters.configuration)[axis])
    state = State(
        jnp.zeros(3),
        jnp.array([1.0, 0.0, 0.0, 0.0]),
        jnp.zeros(6).at[axis].set(sign * speed),
        static_force(model.thrusters, jnp.asarray(u)),
    )
    nu = np.asarray(rolled(model, state, Command(jnp.asarray(0.0 * u if coasting else -u))))
    v = np.concatenate([[speed], sign * nu[:, axis]])
    until = COASTED * speed if coasting else 0.0
    end = int(np.argmax(v <= until))
    assert end > 0, "the plant did not slow down"
    share = (v[end - 1] - until) / (v[end - 1] - v[end])  # of the last step, to the crossing
    way = np.sum(0.5 * (v[: end - 1] + v[1:end])) + share * 0.5 * (v[end - 1] + until)
    return float(DT * way), float(DT * (end - 1 + share))


@pytest.mark.parametrize("thruster", THRUSTERS, ids=str)
@pytest.mark.parametrize("net", [0.0, 3.0])
def test_the_plant_stops_where_it_is_stated(thruster, net):
    model = simple(5.0, ahead=20.0, astern=15.0, net=net, **thruster)
    able = performance(model)["heave"]
    for direction, sign in zip(DIRECTIONS["heave"][1], (1.0, -1.0), strict=True):
        one = able[direction]
        way, t = flown(model, 2, sign, one.top_speed, coasting=False)
        assert one.stopping_distance == pytest.approx(way, rel=2e-3)
        assert one.stopping_time == pytest.approx(t, rel=2e-3)
        if not net:
            way, t = flown(model, 2, sign, one.top_speed, coasting=True)
            assert one.coasting_distance == pytest.approx(way, rel=2e-3)
            assert one.coasting_time == pytest.approx(t, rel=2e-3)


@pytest.mark.system
@pytest.mark.parametrize("name", ["double_blueye", "bluerov2", "bluerov2_heavy"])
def test_vehicles_of_the_library_stop_so_in_the_plant(name):
    """Free on all axes; only bluerov2's CG, below CO, lets thrust ahead or abeam pitch and roll it."""
    model = load_vehicle(name).model()
    found = performance(model)
    for axis, (i, names) in DIRECTIONS.items():
        for direction, sign in zip(names, (1.0, -1.0), strict=True):
            able = found[axis][direction]
            way, t = flown(model, i, sign, able.top_speed, coasting=False)
            within = 0.015 if name == "bluerov2" and axis in ("surge", "sway") else 1e-4
            assert able.stopping_distance == pytest.approx(way, rel=within), (axis, direction)
            assert able.stopping_time == pytest.approx(t, rel=within), (axis, direction)


def test_top_speed_is_where_the_plant_ends_and_the_current_it_holds():
    model = load_vehicle("double_blueye").model()
    able = performance(model)["surge"]["ahead"]
    u = jnp.sign(model.thrusters.configuration[0])
    thrust = static_force(model.thrusters, u)
    ahead = State(jnp.zeros(3), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(6), thrust)
    calm = Environment.calm()

    def end(environment):
        def step(carry, _):
            return plant_step(model, carry, Command(u), environment, 0.02), None

        return jax.jit(lambda s: jax.lax.scan(step, s, None, length=5000)[0])(ahead)

    assert float(end(calm).nu[0]) == pytest.approx(able.top_speed, rel=1e-6)
    from equinox import tree_at

    against = tree_at(lambda e: e.velocity, calm, jnp.array([-able.top_speed, 0.0, 0.0]))
    assert float(end(against).nu[0]) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("axis", "k"), EVERY_WAY)
def test_where_there_is_no_answer(axis, k):
    direction = DIRECTIONS[axis][1][k]

    def of(model):
        return performance(model)[axis][direction]

    dead = of(simple(ahead=0.0, astern=0.0))
    assert dead.top_speed == 0.0 and dead.stopping_distance == 0.0
    free = of(simple(quadratic=0.0))
    assert np.isinf(free.top_speed) and np.isnan(free.stopping_distance) and np.isnan(free.coasting_time)
    one_way = of(simple(ahead=20.0, astern=0.0))
    if k == 0:
        assert one_way.top_speed > 0 and np.isnan(one_way.stopping_distance) and one_way.coasting_distance > 0
    else:
        assert one_way.top_speed == 0.0
    buoyant = of(simple(net=30.0))
    if axis != "heave":
        assert buoyant.top_speed == pytest.approx(np.sqrt(20.0 / DRAG))
    elif k == 0:
        assert buoyant.force == pytest.approx(-10.0) and buoyant.top_speed == 0.0
    else:
        assert buoyant.top_speed == pytest.approx(np.sqrt(50.0 / DRAG))
        assert np.isnan(buoyant.stopping_distance) and np.isnan(buoyant.coasting_distance)


def test_summary_has_units_and_no_answer_is_null():
    found = summary(load_vehicle("bluerov2"))["performance"]
    assert found["surge"]["ahead"]["top_speed_ms"] == found["surge"]["ahead"]["largest_current_ms"]
    assert found["heave"]["down"]["force_N"] == pytest.approx(summary_force("bluerov2", 1) - 2.0, abs=0.05)
    assert found["heave"]["up"]["coasting_distance_m"] is None  # it floats up on its own
    assert set(found["yaw"]["port"]) == {
        "moment_Nm", "top_speed_deg_per_s", "stopping_angle_deg", "stopping_time_s", "coasting_angle_deg",
        "coasting_time_s",
    }  # fmt: skip
    assert summary(vehicle_from_dict({"name": "v", "mass": 5.0, "shape": {"sphere": 0.1}}))["performance"]


def summary_force(name: str, side: int) -> float:
    return summary(load_vehicle(name))["largest_wrench"]["heave"][side]


@pytest.mark.parametrize("name", ["bluerov2_heavy", "sparus_ii"])
def test_roll_grows_above_its_speed_in_sway_and_dies_out_below(name):
    """Held at its depth and rolled by a little: Munk's moment against the righting moment, in roll."""
    model = load_vehicle(name).model()
    limit = stability(model).roll_static
    assert 0.0 < limit < np.inf
    phi = 1e-3
    down = jnp.array([0.0, np.sin(phi), np.cos(phi)])
    rights = restoring_wrench(model, down) - restoring_wrench(model, jnp.array([0.0, 0.0, 1.0]))
    for speed, grows in ((0.95 * limit, False), (1.05 * limit, True)):
        nu = speed * jnp.array([0.0, np.cos(phi), -np.sin(phi), 0.0, 0.0, 0.0])
        assert (-coriolis_wrench(model.added_mass, nu) - rights)[3] * (1.0 if grows else -1.0) > 0.0
