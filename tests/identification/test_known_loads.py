"""What belongs to a test: a known piece of ballast says what newtons are, two lengths of tether tell its drag apart.

The truth is made here without the solver's own terms: ballast as another rigid body, tether drag as an outer force.
"""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.identification.synthetic import NOISE, RATE, STEP, record, steps_command

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion
from rovtwin.identification.identify import identify
from rovtwin.identification.logs.record import Ballast, Record, Signal
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.constants import FRESH_WATER, GRAVITY
from rovtwin.vehicle.physics.dynamics import State, plant_step

DURATION = 30.0
PIECE = Ballast(mass=1.5, volume=2e-4, position=(0.05, 0.02, 0.15))


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


def carrying(model, piece):
    """The model with a piece bolted to it: mass, weight, buoyancy and their centres, by moments."""
    x, y, z = piece.position
    S = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    H = np.concatenate([np.eye(3), -S], axis=1)
    lift = FRESH_WATER * piece.volume * GRAVITY
    weight, buoyancy = float(model.weight) + piece.mass * GRAVITY, float(model.buoyancy) + lift
    place = np.array(piece.position)
    center = (float(model.weight) * np.asarray(model.center_of_gravity) + piece.mass * GRAVITY * place) / weight
    lifted = (float(model.buoyancy) * np.asarray(model.center_of_buoyancy) + lift * place) / buoyancy
    return model.replace(
        rigid_body_mass=np.asarray(model.rigid_body_mass) + piece.mass * H.T @ H,
        weight=weight,
        buoyancy=buoyancy,
        displaced_mass=buoyancy / GRAVITY,
        center_of_gravity=center,
        center_of_buoyancy=lifted,
    )


def scale_width(found):
    rows = [i for i, name in enumerate(found.parameters.names) if ".force_" in name]
    mean = np.zeros(len(found.theta))
    mean[rows] = 1 / len(rows)
    return float(np.sqrt(mean @ found.covariance @ mean)), float(mean @ found.theta)


@pytest.mark.slow
def test_a_known_piece_of_ballast_gives_the_scale_of_forces(vehicle):
    model = vehicle.model()
    t, u = steps_command(vehicle, 0, DURATION)
    bare = record(model, t, u, DURATION, 0)
    loaded = replace(record(carrying(model, PIECE), t, u, DURATION, 1), ballast=(PIECE,))
    found = identify(vehicle, [bare, loaded])
    assert scale_width(identify(vehicle, [bare, bare]))[0] > 0.05
    width, scale = scale_width(found)
    assert width < 0.02
    assert abs(scale) < 3 * width
    assert np.sqrt(np.mean((found.theta / found.std) ** 2)) < 1.5


def tethered(model, t, u, length, drag, seed):
    """A record with a force -drag length |v| v on CO."""
    rng = np.random.default_rng(seed)
    steps = round(DURATION / STEP)
    held = jnp.asarray(u[np.searchsorted(t, (np.arange(steps) + 0.5) * STEP, side="right") - 1])

    def step(state, command):
        v = state.nu[:3]
        force = -drag * length * jnp.linalg.norm(v) * v
        wrench = jnp.concatenate([force, jnp.zeros(3)])
        after = plant_step(model, state, Command(command), Environment.calm(wrench=wrench), STEP)
        return after, after

    path = jax.lax.scan(step, State.at(model, Start.at([0.0, 0.0, 1.0])), held)[1]
    times = STEP * np.arange(1, steps + 1)
    truth = {
        "horizontal": np.asarray(path.position)[:, :2],
        "depth": np.asarray(path.position)[:, 2:],
        "attitude": np.asarray(jax.vmap(euler_from_quaternion)(path.attitude)),
        "gyro": np.asarray(path.nu)[:, 3:],
    }
    signals = {}
    for name, value in truth.items():
        every = max(1, round(1 / RATE[name] / STEP))
        rows = np.arange(every - 1, steps, every)
        noisy = value[rows] + NOISE[name] * rng.standard_normal(value[rows].shape)
        signals[name] = Signal(times[rows], noisy, np.full(value.shape[1], NOISE[name]))
    return Record(f"{length:g} m", t, u, signals, DURATION, tether_length=length)


@pytest.mark.slow
def test_two_lengths_of_tether_tell_its_drag_from_the_hulls_and_one_does_not(vehicle):
    drag, model = 0.1, vehicle.model()
    t, u = steps_command(vehicle, 2, DURATION)
    short, long = (tethered(model, t, u, length, drag, seed) for seed, length in enumerate((5.0, 40.0)))
    pull = {"bollard": {"direction": "surge", "force": 2 * float(model.thrusters.force_ahead[0]), "sd": 0.2}}
    both = identify(vehicle, [short, long], anchors=[pull])
    i = both.parameters.names.index("tether.drag")
    assert both.std[i] < 0.1
    assert both.values["tether.drag"] == pytest.approx(drag, rel=0.1)
    for axis in ("surge", "sway", "heave"):
        low, high = both.interval(f"quadratic_damping.{axis}", z=3.0)
        assert low < both.parameters.free[both.parameters.names.index(f"quadratic_damping.{axis}")].base < high
    one = identify(vehicle, [short, replace(tethered(model, t, u, 5.0, drag, 7), name="again")], anchors=[pull])
    assert one.std[i] > 3 * both.std[i]
    assert any("tether" in line and "two lengths" in line for line in one.findings)
