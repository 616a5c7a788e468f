"""A served vehicle that nobody commands: it does not sink, and it does not turn for ever."""

import numpy as np
import pytest

from rovtwin.core.block import Start
from rovtwin.core.flow import Command
from rovtwin.core.numerics import jax, jnp
from rovtwin.live.serving.protocols import world_for
from rovtwin.runs.compose.composition import keys_of, vehicle_of
from rovtwin.runs.compose.world import plant_of
from rovtwin.runs.trimmed import trimmed
from rovtwin.vehicle import Model, list_library, load_vehicle
from rovtwin.vehicle.physics.dynamics import Environment, State, rollout

DT = 0.05
SERVED = [name for name in list_library() if load_vehicle(name).thruster_names]
PLAIN = load_vehicle("bluerov2").model()  # whose thrusters, which are off, and hull, which is deep, stand for all


def plant(*words: str) -> Model:
    scenario, _ = trimmed(world_for(words[0], words[1:], None))
    vehicle = vehicle_of(scenario)
    return plant_of(scenario.world, vehicle, vehicle.model(), keys_of(scenario.seed)[0])


@jax.jit
def drifting(model: Model, r: float) -> State:
    """Two minutes in calm water far from the surface, thrusters off, turning at first."""
    state = State.at(model, Start.at((0.0, 0.0, 50.0)))
    state = State(state.position, state.attitude, state.nu.at[5].set(r), state.thrust)
    off = Command(jnp.zeros((round(120.0 / DT), model.thrusters.count)))
    return rollout(model, state, off, Environment.calm(), DT)


@pytest.mark.parametrize("name", SERVED)
def test_uncommanded_it_keeps_its_depth_and_comes_to_rest_in_yaw(name):
    model = plant(name).replace(thrusters=PLAIN.thrusters, hull=PLAIN.hull)
    left, turned = drifting(model, 0.0), drifting(model, 0.5)
    first_minute = np.asarray(left.position)[: round(60.0 / DT), 2]
    assert first_minute.max() - 50.0 < 0.02
    # Linear damping alone slows it with this time constant; a large hull without fins takes a minute.
    T = float(model.inertia[5, 5] / model.linear_damping_ahead[5, 5])
    assert T < 120.0
    left_over = np.degrees(0.5 * np.exp(-110.0 / T) * 10.0)
    assert np.degrees(np.abs(np.asarray(turned.nu)[-round(10.0 / DT) :, 5]).sum() * DT) < max(1.0, left_over)


def test_only_what_sinks_is_ballasted_and_it_is_reported():
    model = plant("bluerov2_heavy")
    assert float(model.buoyancy - model.weight) == pytest.approx(0.005 * float(model.weight), abs=1e-3)
    _, text = trimmed(world_for("bluerov2_heavy", [], None))
    assert "sinks with 0.981 N" in text and "--set world.net_buoyancy=0" in text
    for words in (("bluerov2",), ("double_blueye",), ("bluerov2_heavy", "world.water=sea")):
        scenario = world_for(words[0], words[1:], None)
        assert trimmed(scenario) == (scenario, "")


def test_a_net_buoyancy_that_is_given_stays():
    for given in (0, -2.5):
        scenario = world_for("bluerov2_heavy", [f"world.net_buoyancy={given}"], None)
        assert trimmed(scenario) == (scenario, "")
    model = plant("bluerov2_heavy", "world.net_buoyancy=0")
    assert float(model.buoyancy - model.weight) == pytest.approx(-0.981)
