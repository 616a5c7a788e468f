"""A floor that is not level: what it is, what an altimeter says of it, and a vehicle that follows it."""

from types import SimpleNamespace

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import rotation_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.compose.sensors import assumed_sensors
from rovtwin.runs.feasibility.mission import require_feasible
from rovtwin.runs.fly import fly
from rovtwin.runs.scoring.contacts import touched
from rovtwin.scenario.files import load_scenario
from rovtwin.simulation.environment.world import World, walls_of
from rovtwin.simulation.relief import Relief
from rovtwin.vehicle import vehicle_from_dict
from rovtwin.vehicle.physics.dynamics import State
from rovtwin.vehicle.physics.measurement import range_to_floor

RELIEF = Relief.of(5.0, (0.2, -0.1), [(0.3, 7.0, 0.5), (0.1, 3.0, -1.0)])
DOWN = jnp.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])


def test_slope_is_the_gradient_of_the_depth():
    for place in ((0.0, 0.0), (1.3, -2.0), (-4.0, 3.0)):
        _, slope = RELIEF.under(jnp.array(place))
        assert np.allclose(slope, jax.grad(lambda at: RELIEF.under(at)[0])(jnp.array(place)), atol=1e-12)


def test_the_beam_ends_on_the_plane():
    """Leaning and off centre: depth of the beam's end is that of the floor there."""
    slope, lever, euler = jnp.array([0.2, -0.1]), jnp.array([0.4, -0.2, 0.1]), jnp.array([0.2, -0.3, 0.8])
    model = compose(load_scenario("lawnmower_calm")).model
    state = State.at(model, start(euler))
    length = range_to_floor(state, lever, DOWN, jnp.asarray(5.0), slope)
    end = state.position + rotation_from_euler(euler) @ (lever + length * DOWN[:, 0])
    assert np.isclose(end[2], 5.0 + slope @ (end - state.position)[:2], atol=1e-12)


def start(euler):
    from rovtwin.core.block import Start
    from rovtwin.core.frames import quaternion_from_euler

    return Start(jnp.array([1.0, 2.0, 3.0]), quaternion_from_euler(euler), jnp.zeros(6))


def test_the_hull_is_held_by_the_floor_that_is_below_it():
    model = compose(load_scenario("lawnmower_calm")).model
    world = World(walls=walls_of((-5.0, 5.0), None, 5.0), relief=RELIEF)
    state = State.at(model, start(jnp.zeros(3)))
    _, around = world.step(world.init(jax.random.key(0), start(jnp.zeros(3))), state, 0.01)
    depth, slope = RELIEF.under(state.position[:2])
    on_it = jnp.append(state.position[:2] + 0.1, depth + 0.1 * jnp.sum(slope))
    assert np.isclose(around.walls.normals[-1] @ on_it, around.walls.offsets[-1], atol=1e-12)
    assert around.walls.normals.shape == (3, 3) and np.isclose(around.floor, depth)


@pytest.mark.system
def test_what_the_hull_touched_is_reported_with_times_and_durations():
    """By the plant's own geometry: corners against planes, the floor the one that is below them."""
    model = compose(load_scenario("lawnmower_calm")).model
    lowest, foremost = (float(np.max(np.asarray(model.hull.corners)[:, i])) for i in (2, 0))
    pose = np.zeros((3001, 6))
    pose[:, 2] = float(RELIEF.under(jnp.zeros(2))[0]) - 2.0
    pose[1000:1020, 2] += 2.0 - lowest + 0.1
    pose[1030:1050, 2] += 2.0 - lowest + 0.1
    pose[2000:2100, 0] = 5.0 - foremost + 0.01
    run = SimpleNamespace(pose=pose, control_dt=0.02)
    world = World(walls=walls_of((-5.0, 5.0), None, 5.0), relief=RELIEF, surface=jnp.zeros(()))
    assert touched(run, model, world, False) == [
        "touched the northern wall at 40.0 s for 2.0 s", "touched the floor at 20.0 s for 1.0 s",
    ]  # fmt: skip
    pose[:, 2], pose[500, 2], pose[:, 0] = 2.0, 0.0, 0.0
    assert touched(run, model, world, False) == []
    (line,) = touched(run, model, world, True)
    assert line.startswith("came out of the water at 10.0 s for 0.1 s; identify knows no such force")
    pose[:, 2], pose[100::200, 2] = 2.0, 9.0
    assert touched(run, model, world, False)[0].startswith("touched the floor 15 times, longest at 2.0 s for 0.1 s, at")


@pytest.mark.parametrize(
    ("message", "change"),
    [
        ("no altimeter on board", "sensors.altimeter=false"),
        ("no floor to be uneven", "world.floor=null"),
        ("beyond the floor at 4.4", "start.position=[0,0,4.6]"),
    ],
)
def test_what_cannot_be_is_refused(message, change):
    with pytest.raises(ConfigError, match=message):
        compose(load_scenario("terrain_following", [change]))


def with_altimeters(count):
    ping = {"part": "ping1d", "pose": {"position": [0, 0, 0.2]}}
    parts = [{"name": "rov", "part": "double_blueye"}, *({"name": f"ping{i}"} | ping for i in range(count))]
    return vehicle_from_dict({"name": "v", "parts": parts})


def test_an_altitude_over_no_floor_is_refused_though_the_vehicle_carries_the_altimeter():
    """A real one, behind a link, has a floor whose depth nobody needs to know."""
    scenario = load_scenario("lawnmower_calm", ["mission.waypoints=[{position: [3, 0, 2], altitude: 2}]"])
    flown = compose(scenario, vehicle=with_altimeters(1))
    with pytest.raises(ConfigError, match="altitude of 2 m is requested, and the world has no floor; set world.floor"):
        require_feasible(flown.scenario, flown.model)
    assert require_feasible(flown.scenario, flown.model, known_world=False) == []


def test_an_altimeter_over_no_floor_is_reported_to_give_no_readings():
    """It carried one, the world had no floor, and nobody said why its channel stayed empty."""
    changes = ((), ["world.floor=9"], ["sensors.altimeter=false", "sensors.altimeter_2=false"])
    texts = [assumed_sensors(load_scenario("lawnmower_calm", change), with_altimeters(2)) or "" for change in changes]
    assert "altimeter and altimeter_2 of v will give no readings: the world has no floor ('world.floor'" in texts[0]
    assert "no floor" not in texts[1] + texts[2]


def test_with_the_first_altimeter_silenced_the_second_is_followed():
    scenario = load_scenario("terrain_following", ["sensors.altimeter=false"])
    flown = compose(scenario, vehicle=with_altimeters(2)).loop.autopilot
    assert flown.terrain.name == "altimeter_2" and flown.supervisor.rules.names_of("altimeter") == ["altimeter_2"]
    with pytest.raises(ConfigError, match="no altimeter on board"):
        compose(scenario, vehicle=with_altimeters(1))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_the_floor_is_followed(seed):
    """1.6 m of relief, lines at 0.2 m/s."""
    run = fly(load_scenario("terrain_following", seed=seed))
    assert run.completed and run.figures["altitude_rms_m"] < 0.03
