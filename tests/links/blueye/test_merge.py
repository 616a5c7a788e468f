"""Two drones' readings as those of one vehicle at CO, against the measurement equations of the vehicle package."""

import jax.numpy as jnp
import numpy as np
import pytest

from rovtwin.core.flow import Measurement
from rovtwin.core.frames import quaternion_from_euler, rotation_from_quaternion
from rovtwin.links.blueye.double import LEVERS
from rovtwin.links.blueye.driver.merge import Merge
from rovtwin.links.blueye.driver.thrust import force_shares
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics import measurement
from rovtwin.vehicle.physics.dynamics import State
from rovtwin.vehicle.physics.thrusters import static_force, thrusters_from

NONE_SILENT = (False, False)
EULER = np.array([0.2, -0.1, 2.0])
NU = np.array([0.5, -0.2, 0.1, 0.1, -0.2, 0.4])
NU_DOT = np.array([0.1, 0.2, -0.1, 0.05, 0.1, -0.2])
PLACE = np.array([3.0, -4.0, 5.0])


def reading(sensor: str, value, t: float) -> Measurement:
    return Measurement(sensor, np.array(value, dtype=float), t)


def seen_at(lever, t: float) -> list[Measurement]:
    """What a drone at a lever from CO reads, attitude and gyro first."""
    q = quaternion_from_euler(jnp.asarray(EULER))
    state = State(position=jnp.asarray(PLACE), attitude=q, nu=jnp.asarray(NU), thrust=jnp.zeros(0))
    lever, level = jnp.asarray(lever), jnp.eye(3)
    return [
        reading("attitude", EULER, t),
        reading("gyro", NU[3:], t),
        reading("pressure", [measurement.depth(state, lever)], t),
        reading("position", measurement.position_at(state, lever)[:2], t),
        reading("dvl", measurement.velocity_over_ground_at(state, lever, level), t),
        reading("accelerometer", measurement.specific_force(state, jnp.asarray(NU_DOT), lever, level), t),
    ]


def by_sensor(found: list[Measurement]) -> dict[str, np.ndarray]:
    assert len({r.sensor for r in found}) == len(found)
    return {r.sensor: r.value for r in found}


def at_co() -> dict[str, np.ndarray]:
    return by_sensor(seen_at([0.0, 0.0, 0.0], 0.0))


def test_mean_of_both_is_what_co_reads_exactly():
    port, starboard = seen_at(LEVERS[0], 1.0), seen_at(LEVERS[1], 1.0)
    found = by_sensor(Merge(np.array(LEVERS)).join((port, starboard), 1.0, NONE_SILENT))
    for sensor, value in at_co().items():
        np.testing.assert_allclose(found[sensor], value, atol=1e-6, err_msg=sensor)


@pytest.mark.parametrize("side", [0, 1])
def test_one_alone_is_moved_to_co(side):
    streams: list[list[Measurement]] = [[], []]
    streams[side] = seen_at(LEVERS[side], 1.0)
    merge = Merge(np.array(LEVERS))
    found = by_sensor(merge.join(streams, 1.0, (side == 1, side == 0)))
    for sensor, value in at_co().items():
        # The part of angular acceleration stays in the specific force: |omega_dot x r|, here 0.058 m/s2.
        off = np.linalg.norm(np.cross(NU_DOT[3:], LEVERS[side])) if sensor == "accelerometer" else 1e-6
        assert np.linalg.norm(found[sensor] - value) == pytest.approx(off, abs=2e-6), sensor


def test_one_waits_for_the_other_for_a_tenth_of_a_second():
    merge = Merge(np.array(LEVERS))
    assert merge.join(([reading("pressure", [1.0], 1.0)], []), 1.05, NONE_SILENT) == []
    (found,) = merge.join(([], []), 1.11, NONE_SILENT)
    assert found.sensor == "pressure" and found.t_valid == 1.0


def test_a_clock_that_is_set_back_is_followed():
    merge = Merge(np.array(LEVERS))
    for t in (5000.0, 1400.0, 1400.02):
        pair = ([reading("pressure", [1.0], t)], [reading("pressure", [2.0], t)])
        (found,) = merge.join(pair, t, NONE_SILENT)
        assert found.t_valid == t
    late = ([reading("pressure", [1.0], 1400.01)], [reading("pressure", [2.0], 1400.01)])
    assert merge.join(late, 1400.03, NONE_SILENT) == []


def test_reading_that_comes_late_joins_the_one_that_waited():
    merge = Merge(np.array(LEVERS))
    merge.join(([reading("pressure", [1.0], 1.0)], []), 1.01, NONE_SILENT)
    (found,) = merge.join(([], [reading("pressure", [2.0], 1.02)]), 1.02, NONE_SILENT)
    assert found.value == pytest.approx([1.5]) and found.t_valid == pytest.approx(1.01)


def test_lost_reading_does_not_shift_the_pairs():
    merge = Merge(np.array(LEVERS))
    port = [reading("pressure", [k], 0.02 * k) for k in range(1, 50)]
    starboard = [reading("pressure", [k], 0.02 * k + 0.001) for k in range(1, 50) if k != 20]
    found = merge.join((port, starboard), 1.0, NONE_SILENT)
    assert [r.value[0] for r in found] == pytest.approx(list(range(1, 50)))
    assert [r.t_valid for r in found] == sorted({r.t_valid for r in found})


def test_headings_on_both_sides_of_south():
    merge = Merge(np.array(LEVERS))
    port, starboard = reading("attitude", [0, 0, np.pi - 0.1], 0.0), reading("attitude", [0, 0, -np.pi + 0.3], 0.0)
    (found,) = merge.join(([port], [starboard]), 0.0, NONE_SILENT)
    np.testing.assert_allclose(found.value, [0, 0, -np.pi + 0.1], atol=1e-12)


def test_battery_and_leak_are_the_worse_of_both():
    merge = Merge(np.array(LEVERS))
    port = [reading("battery", [0.9, 30.0], 1.0), reading("leak", [1.0], 1.0)]
    assert len(merge.join((port, []), 1.0, NONE_SILENT)) == 2
    starboard = [reading("battery", [0.5, 40.0], 1.5), reading("leak", [0.0], 1.5)]
    found = by_sensor(merge.join(([], starboard), 1.5, NONE_SILENT))
    np.testing.assert_allclose(found["battery"], [0.5, 70.0])
    np.testing.assert_allclose(found["leak"], [1.0])
    found = by_sensor(merge.join(([], [reading("battery", [0.4, 40.0], 20.0)]), 20.0, NONE_SILENT))
    np.testing.assert_allclose(found["battery"], [0.4, 40.0])


def test_memory_is_bounded_when_one_is_silent():
    merge = Merge(np.array(LEVERS))
    found = merge.join(([reading("gyro", [0, 0, k], 1e-4 * k) for k in range(1, 5000)], []), 0.5, NONE_SILENT)
    found += merge.join(([], []), 10.0, NONE_SILENT)
    assert [r.value[2] for r in found] == list(range(1, 5000))
    assert not any(waiting for sides in merge._waiting.values() for waiting in sides)


@pytest.mark.parametrize("which", [(0, 1, 2), (3, 4, 5)])
def test_force_shares_are_the_vehicles_static_force(which):
    """Of the Pioneers in the vehicle, with the thrusters' curve, dead band and limits."""
    thrusters = load_vehicle("double_blueye").model().thrusters
    shares, largest = force_shares(thrusters, which), np.asarray(static_force(thrusters, jnp.ones(6)))
    for u in np.linspace(-1.2, 1.2, 49):
        force = np.asarray(static_force(thrusters, jnp.full(6, u)))
        np.testing.assert_allclose(shares(np.full(3, u)), (force / largest)[list(which)], atol=1e-6)


def test_force_shares_of_a_table_and_of_steps():
    table = {"table_command": jnp.array([-1.0, 0.0, 0.5, 1.0]), "table_force": jnp.array([[-2.0, 0, 1, 8]] * 3)}
    thrusters = thrusters_from(
        jnp.eye(6)[:, :3],
        jnp.array([8.0, 5.0, 5.0]),
        quantisation=jnp.array([0.0, 0.25, 0.0]),
        tabulated=jnp.array([True, False, False]),
        **table,
    )
    shares = force_shares(thrusters, (0, 1, 2))
    np.testing.assert_allclose(shares(np.array([0.75, 0.4, 0.4])), [4.5 / 8, 0.5, 0.4])
    np.testing.assert_allclose(shares(np.array([-0.5, -0.4, 0.0])), [-0.5, -0.5, 0.0])


def test_levers_are_those_of_the_vehicle():
    R = np.asarray(rotation_from_quaternion(quaternion_from_euler(jnp.asarray(EULER))))
    merge = Merge(np.array(LEVERS))
    (attitude, alone) = merge.join(
        ([reading("attitude", EULER, 0.0), reading("pressure", [5.0], 0.0)], []), 0.0, (False, True)
    )
    assert attitude.sensor == "attitude"
    assert alone.value[0] == pytest.approx(5.0 - (R @ np.array(LEVERS[0]))[2])
