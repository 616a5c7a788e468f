"""Sensors away from CO and turned: the filter knows as much, and as surely, as with the same sensors at CO."""

import equinox as eqx
import numpy as np
import pytest
from tests.gnc.observer_cases import (
    DT,
    RATE,
    STD,
    Run,
    double_body,
    estimation_error,
    manoeuvres,
    nees,
    random_walk,
    readings,
    silent,
)

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Slot
from rovtwin.core.frames import rotation_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.sensors import kind_of
from rovtwin.gnc.interfaces import ObserverInput
from rovtwin.gnc.mounting import Mount, at_co
from rovtwin.gnc.navigation.filter import NavigationFilter
from rovtwin.gnc.navigation.tuning import Tuning

SEEDS, SECONDS = 8, 60.0
NAMES = ("position", "pressure", "accelerometer", "gyro", "attitude", "dvl")
FAR = {
    "position": ((0.3, 0.4, -0.2), (0, 0, 0)),
    "pressure": ((-0.4, 0.3, 0.2), (0, 0, 0)),
    "accelerometer": ((0.4, -0.5, 0.3), (0, 0, 45)),
    "gyro": ((0.4, -0.5, 0.3), (0, 0, 45)),
    "attitude": ((0.4, -0.5, 0.3), (0, 0, 45)),
    "dvl": ((-0.2, 0.0, 0.16), (0, 0, 45)),
}


def mounts(far):
    placed = {name: FAR[name] if far else ((0.0,) * 3, (0.0,) * 3) for name in NAMES}
    return {
        name: Mount(STD[name], lever, rotation_from_euler(jnp.radians(jnp.asarray(angles, dtype=float))))
        for name, (lever, angles) in placed.items()
    }


def moved(slots, run, mounts):
    """What sensors at their mounts read where those at CO read `slots`, row by row: all noise is that of the slots."""
    euler, omega = run.x[:, 3:6], run.x[:, 9:12]
    R = np.asarray(jax.vmap(rotation_from_euler)(jnp.asarray(euler)))
    omega_dot = np.gradient(omega, DT, axis=0)
    out = {}
    for full, slot in slots.items():
        r, R_bs, name = np.asarray(mounts[full].lever), np.asarray(mounts[full].rotation), kind_of(full)
        value, place = np.asarray(slot.value), R @ r
        if name == "position":
            value = value + place[:, None, :2]
        elif name == "pressure":
            value = value + place[:, None, 2:]
        elif name == "dvl":
            value = (value + np.cross(omega, r)[:, None]) @ R_bs
        elif name == "gyro":
            value = value @ R_bs
        elif name == "accelerometer":
            value = (value + (np.cross(omega_dot, r) + np.cross(omega, np.cross(omega, r)))[:, None]) @ R_bs
        elif name == "attitude":  # all turned by a yaw: the angles of the sensor's axes
            turned = np.einsum("tvij,jk->tvik", np.asarray(_rotations(value)), R_bs)
            value = _euler(turned)
        valid = np.asarray(slot.valid)
        out[full] = Slot(jnp.asarray(np.where(valid[..., None], value, 0.0)), slot.valid, slot.t_valid)
    return out


def _rotations(euler):
    return jax.vmap(jax.vmap(rotation_from_euler))(jnp.asarray(euler))


def _euler(R):
    angles = [np.arctan2(R[..., 2, 1], R[..., 2, 2]), -np.arcsin(R[..., 2, 0]), np.arctan2(R[..., 1, 0], R[..., 0, 0])]
    return np.stack(angles, axis=-1)


@pytest.fixture(scope="module")
def runs():
    """True runs under a disturbance that walks, and their readings at CO, by seed."""
    model, found = double_body("towing"), []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        u = manoeuvres(rng, SECONDS)
        b = np.concatenate([random_walk(rng, len(u), [0.03] * 3), np.zeros((len(u), 3))], axis=1)
        run = Run.of(model, u, b)
        found.append((run, readings(rng, run, NAMES, RATE, STD)))
    return model, found


@eqx.filter_jit
def filtered(filter, slots, u, starts, std=0.0):
    """Pose and velocity (n, 12), and covariance of north and east, of several runs."""

    def tick(memory, inputs):
        memory, estimate = filter.step(memory, ObserverInput(inputs[0], Command(inputs[1])), DT)
        return memory, (jnp.concatenate([estimate.eta, estimate.nu]), estimate.covariance[:2, :2])

    def one(slots, u, start):
        begin = filter.init(jax.random.key(0), Start(start, jnp.array([1.0, 0, 0, 0]), jnp.zeros(6), std))
        return jax.lax.scan(tick, begin, (slots, u))[1]

    return jax.vmap(one)(slots, u, starts)


def flown(runs, far, without=()):
    """rms of the horizontal position error [m] and mean NEES of it, over all runs, their first ten seconds left out."""
    model, found = runs
    known = mounts(far)
    filter = NavigationFilter(model, Tuning.of(model, known))
    slots = [silent(moved(at_0, run, known), *without) for run, at_0 in found]
    u = jnp.asarray(np.stack([run.u for run, _ in found]))
    std = 0.1
    starts = jnp.array([0.0, 0.0, 0.5]) + std * np.random.default_rng(1).normal(size=(SEEDS, 3)) * [1, 1, 0]
    x, P = filtered(filter, jax.tree.map(lambda *leaves: jnp.stack(leaves), *slots), u, starts, jnp.asarray(std))
    error = estimation_error(x, np.stack([run.x for run, _ in found]))[:, 500:, :2]
    return np.sqrt(np.mean(np.sum(error**2, axis=-1))), np.mean(nees(error, P[:, 500:], [0, 1]))


@pytest.mark.system
@pytest.mark.parametrize("without", [(), ("dvl",)], ids=["with a DVL", "without"])
def test_large_levers_and_a_turn_of_45_degrees_cost_nothing(runs, without):
    """The same noise: errors may differ by what levers take from the sensors, not by what was forgotten."""
    error, ratio = flown(runs, far=True, without=without)
    at_0, ratio_0 = flown(runs, far=False, without=without)
    assert error == pytest.approx(at_0, rel=0.1)
    assert ratio == pytest.approx(ratio_0, rel=0.15) and 1.0 < ratio < 3.0


@pytest.mark.system
def test_readings_moved_to_co_are_those_of_sensors_at_co(runs):
    """What the thesis's filter and tests get: all but the part of a lever that takes the angular acceleration."""
    run, slots = runs[1][0]
    known, tick = mounts(far=True), 700
    read = {name: jax.tree.map(lambda leaf: leaf[tick], slot) for name, slot in moved(slots, run, known).items()}
    back = at_co(read, known, rotation_from_euler(jnp.asarray(run.x[tick, 3:6])), jnp.asarray(run.x[tick, 9:12]))
    for name in set(NAMES) - {"accelerometer"}:
        here = np.asarray(slots[name].valid[tick])
        np.testing.assert_allclose(back[name].value[here], slots[name].value[tick][here], atol=1e-9, err_msg=name)
    turned = np.asarray(known["gyro"].rotation)
    np.testing.assert_allclose(back["accelerometer"].value, read["accelerometer"].value @ turned.T, atol=1e-12)


@pytest.mark.slow
def test_two_of_a_kind_are_used_and_one_alone_suffices(runs):
    """Two gyros, accelerometers and DVLs are worth more than one of them; with the first silent the second serves."""
    model, found = runs
    one = mounts(far=True)
    known = one | {f"{name}_2": Mount(STD[name], (-0.3, 0.5, 0.1)) for name in ("gyro", "accelerometer", "dvl")}
    filter = NavigationFilter(model, Tuning.of(model, known))
    errors = {}
    for case, silenced in {"both": (), "second": ("gyro", "accelerometer", "dvl")}.items():
        slots = []
        for seed, (run, at_0) in enumerate(found):
            more = readings(np.random.default_rng(100 + seed), run, ("gyro", "accelerometer", "dvl"), RATE, STD)
            named = {f"{name}_2": slot for name, slot in more.items()}
            slots.append(silent(moved(at_0 | named, run, known), *silenced))
        u = jnp.asarray(np.stack([run.u for run, _ in found]))
        starts = jnp.tile(jnp.array([0.0, 0.0, 0.5]), (SEEDS, 1))
        x, _ = filtered(filter, jax.tree.map(lambda *leaves: jnp.stack(leaves), *slots), u, starts)
        speed = estimation_error(x, np.stack([run.x for run, _ in found]))[:, 500:, 6:8]
        errors[case] = np.sqrt(np.mean(speed**2))
    assert errors["both"] < 0.9 * errors["second"] < 0.01
