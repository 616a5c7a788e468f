"""The served vehicle: what it obeys, what it measures, and what it is served by."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Channel, Log
from rovtwin.core.sensors import IMU
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.live.serving.host import ServedVehicle
from rovtwin.live.serving.protocols import known, own_protocol, places_of, world_for
from rovtwin.live.serving.replayed import ReplayedVehicle
from rovtwin.scenario.files import dump_scenario, load_scenario
from rovtwin.simulation.vehicle_firmware import REACH

pytestmark = pytest.mark.system

DRONES = ("port", "starboard")
AFT = [f"sensors.{name}.attitude_deg=[0,0,180]" for name in IMU]  # imus that look aft: nobody but the twin may notice


@pytest.fixture(scope="module")
def vehicle() -> ServedVehicle:
    return ServedVehicle(world_for("double_blueye", AFT, None))


def run(vehicle: ServedVehicle, seconds: float, **command):
    """Both drones with the same wish for so long; all readings."""
    commands = {drone: PilotCommand(drone, **({"armed": True} | command)) for drone in DRONES}
    return [r for _ in range(round(seconds / vehicle.dt)) for r in vehicle.advance(commands)]


def test_a_vehicle_without_commands_is_at_rest(vehicle):
    for _ in range(50):
        vehicle.advance({})
    assert not vehicle.truth["command"].any()


def test_motion_is_a_share_of_the_largest_force(vehicle):
    run(vehicle, 2.0, motion=(0.5, 0, 0, 0, 0, 0))
    np.testing.assert_allclose(vehicle.truth["thrust"], [2.5, 2.5, 0, 0] * 2, atol=0.01)
    run(vehicle, 2.0, motion=(0, -1.0, 0.25, 0, 0, 0))
    np.testing.assert_allclose(vehicle.truth["thrust"], [0, 0, -5.0, 2.75] * 2, atol=0.01)


def test_surge_and_yaw_share_the_stern_pair(vehicle):
    """Full ahead and full turn: one of the pair gives all, the other nothing, and no limit is passed."""
    run(vehicle, 2.0, motion=(1.0, 0, 0, 0, 0, 1.0))
    np.testing.assert_allclose(vehicle.truth["thrust"][:2], [5.0, 0.0], atol=0.01)


def test_disarmed_it_turns_nothing_at_once(vehicle):
    run(vehicle, 1.0, motion=(0, 0, 0.5, 0, 0, 0))
    assert vehicle.truth["command"].any()
    run(vehicle, vehicle.dt, armed=False, motion=(0, 0, 0.5, 0, 0, 0))
    assert not vehicle.truth["command"].any()


def test_depth_and_heading_are_held_where_the_hold_came_on(vehicle):
    run(vehicle, 4.0, motion=(0, 0, 0.4, 0, 0, 0))
    run(vehicle, 15.0, hold_depth=True, hold_heading=True)
    held = vehicle.truth["eta"].copy()
    run(vehicle, 10.0, hold_depth=True, hold_heading=True, motion=(0.5, 0, 0, 0, 0, 0))
    off = vehicle.truth["eta"] - held
    assert abs(off[2]) < 0.05 and abs(off[5]) < 0.05 and np.hypot(off[0], off[1]) > 1.0


def test_a_stick_moves_what_is_held_and_does_not_run_away_from_a_vehicle_that_cannot_follow(vehicle):
    began = vehicle.truth["eta"][2]
    run(vehicle, 5.0, hold_depth=True, hold_heading=True, motion=(0, 0, 1.0, 0, 0, 0))
    let_go = vehicle.truth["eta"][2]
    assert let_go > began + 0.5
    run(vehicle, 15.0, hold_depth=True, hold_heading=True)
    assert abs(vehicle.truth["eta"][2] - let_go) < REACH[2] + 0.1


@pytest.mark.slow
def test_a_hold_whose_sensor_is_silent_gives_nothing():
    """Without pressure nobody knows the depth: no thrust after a fiction, and the hold is back with the sensor."""
    scenario = load_scenario("lawnmower_calm", ["faults=[{at: 5, until: 12, sensor: pressure, fault: silent}]"])
    vehicle = ServedVehicle(scenario)
    run(vehicle, 4.0, motion=(0, 0, 0.4, 0, 0, 0))
    run(vehicle, 3.0, hold_depth=True)
    assert not vehicle.truth["command"][[3, 7]].any()
    run(vehicle, 20.0, hold_depth=True)
    held = vehicle.truth["eta"][2]
    run(vehicle, 3.0, hold_depth=True)
    assert abs(vehicle.truth["eta"][2] - held) < 0.02


@pytest.mark.slow
def test_a_pair_breaks_as_one():
    scenario = load_scenario("lawnmower_calm", ["faults=[{at: 0, thruster: port.surge, fault: dead}]"])
    vehicle = ServedVehicle(scenario)
    run(vehicle, 2.0, motion=(0.5, 0, 0, 0, 0, 0))
    np.testing.assert_allclose(vehicle.truth["thrust"], [0, 0, 0, 0, 2.5, 2.5, 0, 0], atol=0.01)


def test_each_drone_measures_with_its_own_sensors_at_its_own_place(vehicle):
    readings = run(vehicle, 2.0)
    names = {r.sensor for r in readings}
    assert {f"{d}/{s}" for d in DRONES for s in ("pressure", "attitude", "gyro", "accelerometer", "force")} <= names
    assert {"position", "dvl", "mocap", "estimate", "thrusters"} <= names and "pressure" not in names
    noise = {d: np.array([r.value[0] for r in readings if r.sensor == f"{d}/gyro"]) for d in DRONES}
    assert not np.array_equal(*noise.values())
    times = [r.t_valid for r in readings if r.sensor == "port/gyro"]
    assert np.diff(times) == pytest.approx(0.01)


def test_the_filter_and_motion_capture_see_the_truth(vehicle):
    # A drift of the estimate's place is the positions' noise; depth and attitude are known to millimetres.
    readings = run(vehicle, 3.0)
    estimated = next(r.value for r in reversed(readings) if r.sensor == "estimate")
    seen = next(r.value for r in reversed(readings) if r.sensor == "mocap")
    eta = vehicle.truth["eta"]
    np.testing.assert_allclose(estimated[2:6], eta[2:6], atol=0.02)
    np.testing.assert_allclose(seen, eta, atol=0.02)


def test_imus_that_look_aft_tell_the_vehicles_attitude_and_rates(vehicle):
    readings = run(vehicle, 3.0, motion=(0.3, 0, 0, 0, 0, 0.5))
    eta, nu = vehicle.truth["eta"], vehicle.truth["nu"]
    assert abs(nu[5]) > 0.05
    for drone in DRONES:
        newest = {name: next(r.value for r in reversed(readings) if r.sensor == f"{drone}/{name}") for name in IMU}
        np.testing.assert_allclose(newest["attitude"], eta[3:], atol=0.02)
        np.testing.assert_allclose(newest["gyro"], nu[3:], atol=0.01)


# By what it is served


def test_a_vehicle_or_a_scenario():
    assert world_for("bluerov2_heavy", [], None).vehicle == "bluerov2_heavy"
    assert world_for("lawnmower_hard", [], 7).seed == 7
    with pytest.raises(ConfigError, match=r"no such vehicle or scenario.*double_blueye"):
        world_for("double_blue", [], None)


def test_each_vehicles_own_protocol():
    assert own_protocol(world_for("double_blueye", [], None)) == "blueye"
    assert own_protocol(world_for("bluerov2_heavy", [], None)) == "mavlink"


def test_protocols_that_are_none():
    assert known(["dvl", "blueye", "dvl"]) == ["dvl", "blueye"]
    with pytest.raises(ConfigError, match="'modbus'.*expected one or more of blueye"):
        known(["modbus"])


def test_places():
    names = ["blueye", "dvl"]
    found = places_of(names, ["127.0.0.4", "blueye=127.0.0.5:8080", "dvl=127.0.0.1:99"], 81)
    assert found["blueye"].hosts == ["127.0.0.4", "127.0.0.5"] and found["blueye"].port == 81
    assert found["dvl"].hosts == ["127.0.0.1"] and found["dvl"].port == 99
    for bad in ("ugps=127.0.0.1", "127.0.0.1:0", "127.0.0.1:http", ":80", ""):
        with pytest.raises(ConfigError, match="expected"):
            places_of(names, [bad])


# A log that is served


def log_of(readings: dict[str, np.ndarray], scenario: str | None = "lawnmower_calm") -> Log:
    channels = [Channel(f"sensor/{n}", ("x", "t_valid"), ("m", "s"), "n") for n in readings]
    data = {f"sensor/{n}": (t, np.stack([np.arange(len(t)), t], axis=1)) for n, t in readings.items()}
    metadata = {} if scenario is None else {"scenario": dump_scenario(load_scenario(scenario))}
    return Log.from_arrays(channels, data, metadata)


def test_a_log_comes_again_reading_by_reading_for_each_drone():
    vehicle = ReplayedVehicle(log_of({"pressure": np.arange(1, 51) * 0.02, "position": np.array([0.5])}))
    assert vehicle.drones == DRONES and vehicle.duration == pytest.approx(1.02)
    came = [r for _ in range(51) for r in vehicle.advance({"port": PilotCommand("port", True, (1.0,) * 6)})]
    depth = [r.value[0] for r in came if r.sensor == "port/pressure"]
    assert depth == list(range(50)) == [r.value[0] for r in came if r.sensor == "starboard/pressure"]
    assert [r.t_valid for r in came if r.sensor == "position"] == [0.5]


def test_a_log_that_begins_again_goes_on_in_time():
    vehicle = ReplayedVehicle(log_of({"pressure": np.arange(1, 51) * 0.02}), loop=True)
    times = [r.t_valid for _ in range(120) for r in vehicle.advance({}) if r.sensor == "port/pressure"]
    assert len(times) > 110 and np.all(np.diff(times) > 0)


def test_a_log_of_a_compass_that_looks_aft_tells_the_vehicles_heading():
    """It was logged as read, along the sensor's axes, where its scenario says how it is built in."""
    names = ("phi", "theta", "psi", "t_valid")
    channel = Channel("sensor/attitude", names, ("rad", "rad", "rad", "s"), "n")
    read = np.array([[-0.1, -0.05, 0.3 - np.pi, 0.02], [-0.1, -0.05, 0.4 - np.pi, 0.04]])
    metadata = {"scenario": dump_scenario(load_scenario("lawnmower_calm", ["sensors.attitude.attitude_deg=[0,0,180]"]))}
    log = Log.from_arrays([channel], {"sensor/attitude": (read[:, 3], read)}, metadata)
    vehicle = ReplayedVehicle(log)
    came = [r.value for _ in range(5) for r in vehicle.advance({}) if r.sensor == "port/attitude"]
    np.testing.assert_allclose(came, [[0.1, 0.05, 0.3], [0.1, 0.05, 0.4]], atol=1e-9)


def test_logs_that_cannot_be_served():
    with pytest.raises(LogError, match="no scenario"):
        ReplayedVehicle(log_of({"pressure": np.array([0.1])}, None))
    with pytest.raises(LogError, match="no sensor channels"):
        ReplayedVehicle(log_of({}))
