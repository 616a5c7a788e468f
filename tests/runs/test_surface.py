"""Missions that begin and end at the surface, in a tank."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import FINISHED, Command, Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.compose import composition
from rovtwin.runs.compose.composition import compose, vehicle_of
from rovtwin.runs.fly import fly
from rovtwin.scenario import load_scenario
from rovtwin.vehicle.analysis.stability import afloat
from rovtwin.vehicle.physics.dynamics import State, rollout

SET = (
    "start.position=[0, 0, 0]",
    "world.floor=2.0",
    "world.tank={north: [-2, 4], east: [-3, 3]}",
    "world.net_buoyancy=2",
    "autopilot=thesis_placed",
    "mission={waypoints: [{position: [0, 0, 1]}, {position: [2, 0, 0]}]}",
    "duration=200",
)


@pytest.mark.slow
def test_from_the_surface_and_back():
    flight = fly(load_scenario("square", SET, seed=2))
    assert flight.completed, flight.figures["reason"]
    depth = flight.log["truth/eta"].values[:, 2]
    model = compose(load_scenario("square", SET)).model
    assert depth[0] == pytest.approx(afloat(model), abs=0.02) and depth.max() > 0.8
    assert flight.log["autopilot/mode"].values[-1, 0] == FINISHED
    assert abs(depth[-1] - afloat(model)) < 0.2
    assert np.all(depth > afloat(model) - 0.1)


def test_where_a_vehicle_floats_is_sought_once_for_a_mission(monkeypatch):
    """Of 512 way-points, checked while it flies, it took the console's autopilot 0.9 s: longer than a command lives."""
    sought = []
    monkeypatch.setattr(composition, "afloat", lambda model: sought.append(model) or 0.31)
    scenario = load_scenario("square", SET)
    depths = np.asarray(composition.way_points(scenario, vehicle_of(scenario).model()).position[:2, 2])
    assert len(sought) == 1 and depths.tolist() == [1.0, 0.31]


def test_a_start_at_the_surface_is_at_rest_there():
    """Afloat from the beginning: left to itself with thrusters off it neither bobs nor sinks."""
    run = compose(load_scenario("square", ("start.position=[0, 0, 0]", "world.net_buoyancy=20")))
    plant = run.loop.twin.model
    start = State.at(plant, run.start)
    idle = Command(jnp.zeros((5000, plant.thrusters.count)))
    end = jax.jit(rollout, static_argnums=4)(plant, start, idle, Environment.calm(surface=jnp.zeros(())), 0.002)
    np.testing.assert_allclose(end.position, np.broadcast_to(start.position, (5000, 3)), atol=1e-6)
    assert 0.005 < 0.1595 - float(start.position[2]) < 0.05  # so much of the hull, 0.319 m high, is dry


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("start.position=[-1.9, 0, 1]", "start.position: .* beyond the southern wall at -2 m"),
        ("start.position=[0, 0, 1.9]", "start.position: .* beyond the floor at 2 m"),
        ("world.tank={north: [-0.1, 0.1], east: [-3, 3]}", "a larger tank"),
        ("mission={waypoints: [{position: [0, 0, 3]}]}", "waypoints\\[0\\].*floor at 2 m.*never be reached"),
        ("mission={waypoints: [{position: [0, 0, 1]}, {position: [0, 9, 1]}]}", "waypoints\\[1\\].*eastern wall"),
    ],
)
def test_no_room_in_the_tank_is_reported_before_the_flight(change, message):
    with pytest.raises(ConfigError, match=message):
        compose(load_scenario("square", (*SET, change)))
