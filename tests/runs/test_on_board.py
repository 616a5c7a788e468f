"""Which sensors fly: the vehicle's at their places, what is assumed, and what a scenario changes."""

import json

import equinox as eqx
import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.console.engine.reporting.setup import values_of
from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Slot
from rovtwin.core.frames import quaternion_from_euler
from rovtwin.core.log import Log, LogWriter
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.sensors import IMU, SENSORS
from rovtwin.gnc.navigation import measurements as readings
from rovtwin.identification.logs.readers.rovtwin_log import read_rovtwin
from rovtwin.live.connect import as_read
from rovtwin.live.serving.vehicle import served_of
from rovtwin.runs.compose.composition import compose, vehicle_of
from rovtwin.runs.compose.sensors import assumed_sensors, listed, mount_of, on_board, rotated, sensors_of
from rovtwin.runs.recording.channels import log_channels, sensor_channel
from rovtwin.runs.recording.provenance import provenance
from rovtwin.scenario.files import dump_scenario, load_scenario, scenario_of
from rovtwin.simulation.sensors.kinds import IDEAL, SensorInput
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State

KEEL = {
    "name": "keel",
    "pose": {"position": [-0.2, 0.0, 0.16], "attitude_deg": [0, 0, 45]},
    "mass": 0.2,
    "volume": 0.0002,
    "sensors": [
        {"name": "dvl", "kind": "dvl", "noise": [0.004, 0.004, 0.002], "rate_hz": 5},
        {"name": "deep", "kind": "pressure", "noise": 0.005},
    ],
}
BOW = {"name": "bow", "pose": {"position": [0.3, 0, 0.1]}, "sensors": [{"name": "dvl", "kind": "dvl"}]}
MINE = {
    "name": "mine",
    "parts": [{"name": "rov", "part": "double_blueye"}, KEEL, BOW],
    "restoring": {"buoyancy": "neutral"},
}


def scenario(*settings, vehicle=MINE, name="lawnmower_calm", **sections):
    base = load_scenario(name, ["autopilot=model_based", *settings]).model_dump(mode="json")
    return scenario_of(base | {"vehicle": vehicle} | sections, "test.yaml")


def flown(*settings, **changes):
    found = scenario(*settings, **changes)
    return sensors_of(found, vehicle_of(found))


def test_a_dvl_that_is_bolted_on_flies_at_its_place_and_as_it_points():
    sensors = flown()
    dvl = sensors["dvl"]
    np.testing.assert_allclose(dvl.lever, [-0.2, 0.0, 0.16])
    np.testing.assert_allclose(np.asarray(dvl.rotation)[:, 0], [np.sqrt(0.5), np.sqrt(0.5), 0.0], atol=1e-12)
    np.testing.assert_allclose(dvl.noise, [0.004, 0.004, 0.002])
    assert dvl.rate == 5000
    np.testing.assert_allclose(sensors["gyro"].lever, [0.0, -0.28, 0.0])


def test_two_of_a_kind_are_numbered_and_named_by_part():
    found = scenario()
    there = on_board(found, vehicle_of(found))
    assert [there.part_of(name) for name in ("dvl", "dvl_2")] == ["keel.dvl", "bow.dvl"]
    assert there.part_of("pressure").endswith("port.pressure") and there.part_of("pressure_2") == "keel.deep"
    assert "gyro_2" not in there.names, "the starboard Pioneer's are spare"
    assert there.part_of("position") == "" and there.assumed == ("position",)
    assert any("dvl_2 (bow.dvl): at [0.3, 0, 0.1] m" in line for line in listed(found, vehicle_of(found)))


def test_the_filter_knows_where_they_sit():
    filter = compose(scenario()).loop.autopilot.observer
    np.testing.assert_allclose(filter.tuning.mounts["dvl"].lever, [-0.2, 0.0, 0.16])
    np.testing.assert_allclose(filter.tuning.mounts["dvl_2"].lever, [0.3, 0.0, 0.1])
    np.testing.assert_allclose(filter.tuning.mounts["dvl"].std, [0.004, 0.004, 0.002])
    thesis = compose(scenario("autopilot=thesis")).loop.autopilot.observer
    assert {"dvl", "pressure", "dvl_2"} <= set(thesis.mounts) and "position" not in thesis.mounts


def test_a_scenario_silences_changes_and_adds():
    sensors = flown("sensors.dvl=false", "sensors.dvl_2.noise=0.1", "sensors.leak=true")
    assert "dvl" not in sensors and "leak" in sensors
    np.testing.assert_allclose(sensors["dvl_2"].noise, 0.1)
    moved = flown("sensors.dvl.position=[0,0,1]")["dvl"]
    np.testing.assert_allclose(moved.lever, [0.0, 0.0, 1.0])
    broken = flown(faults=[{"sensor": "dvl_2", "fault": "silent", "at": 3.0}])["dvl_2"]
    assert np.asarray(broken.blackouts).tolist() == [[3.0, np.inf]]


@pytest.mark.parametrize(
    "settings, message",
    [
        (["sensors.dvl_3.noise=1"], "sensors.dvl_3: there is none on board; expected one of position, pressure"),
        (["sensors.leak.noise=1"], "sensors.leak: there is none on board; set sensors.leak.on_board to true"),
        (["sensors.pressure=false"], "found pressure: false, but autopilots and tests need one"),
        (["sensors.dvk=false"], "sensors: dvk: no such key. Did you mean 'dvl'?"),
        (["sensors.dvl_2.nois=1"], "sensors.dvl_2.nois: no such key. Did you mean 'noise'?"),
    ],
)
def test_what_is_not_there_cannot_be_changed(settings, message):
    with pytest.raises(ConfigError) as error:
        flown(*settings)
    assert message in str(error.value)


@pytest.mark.parametrize("preset", ["table_5_7", "as_printed"])
def test_presets_fly_the_thesis_sensors_at_co(preset):
    sensors = flown(f"sensors={preset}")
    assert list(sensors) == ["position", "pressure", "accelerometer", "gyro", "attitude"]
    assert all(not np.any(sensor.lever) for sensor in sensors.values())
    assert "dvl" in flown(f"sensors={preset}", "sensors.dvl=true")


def test_a_vehicle_without_sensors_flies_with_assumed_ones_and_says_so():
    bare = {"name": "bare", "mass": 10.0, "shape": {"box": [0.5, 0.3, 0.2]}, "restoring": {"buoyancy": "neutral"}}
    bare["thrusters"] = [{"name": "ahead", "direction": [1, 0, 0], "force": 10}]
    found = scenario(vehicle=bare)
    line = assumed_sensors(found, vehicle_of(found))
    assert line.startswith("bare carries no sensor that measures pressure, accelerometer, gyro, attitude: those of")
    outside = "no part of bare measures a horizontal position: it is assumed to come from outside, every 1 s with"
    assert outside in line
    assert set(flown(vehicle=bare)) == {"position", "pressure", "accelerometer", "gyro", "attitude"}
    shown = CliRunner().invoke(app, ["scenario", "show", "lawnmower_calm", "--set", "vehicle=double_blueye_thesis"])
    assert "#   gyro (assumed, thesis table 5.7): at [0, 0, 0] m, 100 Hz" in shown.output


def test_positions_that_no_part_measures_are_reported_before_a_flight():
    """The documentation promised it; a vehicle with all sensors but a position flew without a word."""
    lacking = scenario("sensors.position.noise=0.4", vehicle="double_blueye")
    line = assumed_sensors(lacking, vehicle_of(lacking))
    assert line.startswith("no part of double_blueye measures a horizontal position") and "noise of 0.4 m" in line
    assert assumed_sensors(scenario("sensors=table_5_7"), vehicle_of(lacking)) is None
    shown = CliRunner().invoke(app, ["scenario", "check", "lawnmower_calm"])
    assert "it is assumed to come from outside" in shown.output


def test_what_reads_faster_than_the_physics_gives_means():
    quick = {"name": "imu", "kind": "imu", "gyro": {"rate_hz": 2000, "noise": 0.002}}
    gyro = flown(vehicle=MINE | {"parts": [MINE["parts"][0]], "sensors": [quick]})["gyro"]
    assert gyro.rate == 500_000
    np.testing.assert_allclose(gyro.noise, 0.001)


def test_a_scenario_with_numbered_sensors_is_written_and_read_again():
    found = scenario("sensors.dvl_2.noise=0.1", "sensors.dvl=false")
    assert scenario_of(yaml.safe_load(dump_scenario(found)), "again.yaml") == found


@pytest.mark.system
def test_served_drones_have_the_sensors_of_their_own_place():
    served, _ = served_of(load_scenario("lawnmower_calm", ["autopilot=model_based", "sensors.dvl=true"]))
    for drone, y in (("port", -0.28), ("starboard", 0.28)):
        np.testing.assert_allclose(served.twin.sensors[f"{drone}/pressure"].lever, [0.0, y, 0.0], atol=1e-12)
    np.testing.assert_allclose(served.filter.tuning.mounts["pressure"].lever, [0.0, -0.28, 0.0])
    assert "dvl" in served.twin.sensors


def test_what_two_blueyes_say_is_taken_at_co():
    found = scenario()
    two = as_read("blueye://127.0.0.2,127.0.0.3", found)
    assert not np.any(sensors_of(two, vehicle_of(two))["pressure"].lever)
    np.testing.assert_allclose(sensors_of(two, vehicle_of(two))["dvl"].lever, [-0.2, 0.0, 0.16])
    assert as_read("blueye://127.0.0.2", found) is found and as_read("twin://", found) is found


NU = jnp.array([0.4, -0.1, 0.2, 0.3, -0.2, 0.5])
TURNED = {"aft": [0, 0, 180], "side": [90, 0, 0]}  # imus of a vehicle, by mounting: roll, pitch, yaw
BUILT_IN = {
    "name": "built_in",
    "parts": [{"name": "rov", "part": "bluerov2_heavy"}],
    "sensors": [
        {"name": name, "kind": "imu", "pose": {"attitude_deg": angles}, "attitude": {}}
        for name, angles in TURNED.items()
    ],
    "restoring": {"buoyancy": "neutral"},
}


@pytest.mark.parametrize("url", ["mavlink://udpin:0.0.0.0:14550", "blueye://127.0.0.2,127.0.0.3", "ros2://rov"])
def test_what_a_vehicle_tells_along_its_own_axes_is_not_turned_again(url):
    found = scenario(vehicle=BUILT_IN)
    assert set(rotated(flown(vehicle=BUILT_IN))) == {f"{kind}{n}" for kind in IMU for n in ("", "_2")}
    read = as_read(url, found)
    assert not rotated(sensors_of(read, vehicle_of(read)))
    assert as_read("twin://", found) is found and as_read("replay://log.mcap", found) is found


@pytest.mark.system
def test_a_served_vehicle_tells_what_imus_along_its_axes_would_read():
    """Tilted, turning and accelerating, through imus that look aft and lie on their side; its own filter agrees."""
    found = scenario(vehicle=BUILT_IN)
    served, _ = served_of(found)
    assert set(served.rotations) == {f"{kind}{n}" for kind in IMU for n in ("", "_2")}
    start = Start(jnp.zeros(3), quaternion_from_euler(jnp.array([0.1, -0.2, 0.7])), NU)
    state = State.at(served.twin.model, start)
    seen = SensorInput(state, jnp.array([0.1, 0.2, -0.1, 0.3, -0.2, 0.1]), jnp.asarray(0), None)
    slots = {
        name: Slot(IDEAL[sensor.kind](sensor, seen)[None], jnp.array([True]), jnp.zeros(1))
        for name, sensor in served.twin.sensors.items()
        if sensor.kind in IMU
    }
    reported = served._along_b(slots)
    x = served.filter.init(jax.random.key(0), start).x
    link = as_read("mavlink://udpin:0.0.0.0:14550", found)
    for mounts in (
        served.filter.tuning.mounts,
        {name: mount_of(sensor) for name, sensor in sensors_of(link, vehicle_of(link)).items()},
    ):
        for name in served.rotations:
            straight = eqx.tree_at(lambda s: s.rotation, served.twin.sensors[name], jnp.eye(3))
            want = IDEAL[straight.kind](straight, seen)
            np.testing.assert_allclose(reported[name].value[0], want, atol=1e-9, err_msg=name)
            np.testing.assert_allclose(mounts[name].rotation @ reported[name].value[0], want, atol=1e-9, err_msg=name)
        for name in ("attitude", "attitude_2"):
            text = readings.attitude(x, reported[name], mounts[name], NU[3:], jnp.zeros(()), 1.0)
            np.testing.assert_allclose(text.residual, 0.0, atol=1e-9)


def test_identification_reads_one_of_two_pressure_sensors(tmp_path):
    """A log with both: the depth is that of the first, with its place, and the other is named."""
    simulation = compose(scenario())
    names, t = simulation.thruster_names, np.arange(0.0, 2.0, 0.1)
    channels = [c for c in log_channels(names, simulation.sensor_kinds, 10, True) if c.name == "autopilot/command"]
    channels += [sensor_channel(name, SENSORS["pressure"]) for name in ("pressure", "pressure_2")]
    with LogWriter(tmp_path / "log.mcap", channels, provenance(simulation.scenario, simulation)) as log:
        log.write_many("autopilot/command", t, np.zeros((len(t), len(names))))
        for name, depth in (("pressure", 1.0), ("pressure_2", 1.16)):
            log.write_many(f"sensor/{name}", t, np.stack([np.full(len(t), depth), t], axis=1))
    sheet = json.loads(Log.read(tmp_path / "log.mcap").metadata["sensors"])
    assert sheet["pressure_2"]["part"] == "keel.deep" and sheet["pressure"]["part"].endswith("port.pressure")
    raw = read_rovtwin(tmp_path / "log.mcap", simulation.vehicle)
    assert raw.signals["depth"].lever == [0.0, -0.28, 0.0]
    assert np.all(raw.tables["sensor/pressure"].values == 1.0) and "sensor/pressure_2" not in raw.tables
    assert any("pressure_2" in note for note in raw.notes)


def test_spare_sensors_are_spare_wherever_their_vehicle_is_a_part():
    names = {one.name: one.spare for one in load_vehicle("double_blueye").sensors}
    assert names["starboard.imu"] and not names["port.imu"]
    spare = {".".join(one.name.split(".")[-2:]) for one in vehicle_of(scenario()).sensors if one.spare}
    assert spare == {"starboard.imu", "starboard.compass", "starboard.pressure"}


IRON = {
    "name": "iron",
    "pose": {"attitude_deg": [0, 0, 90]},
    "mass": 0.1,
    "volume": 0.0001,
    "sensors": [{"name": "compass", "kind": "magnetometer", "bias": [12.0, -5.0, 3.0], "rate_hz": 20}],
}


def test_a_magnetometer_on_board_is_like_every_other_sensor():
    """In a vehicle's file and a scenario's world, with faults, in the log, on the console: by its row in the table."""
    mine = MINE | {"parts": [{"name": "rov", "part": "double_blueye"}, IRON]}
    place = {"strength_ut": 48.0, "inclination_deg": 66.0, "declination_deg": -2.0}
    base = load_scenario("lawnmower_calm").model_dump(mode="json")
    faults = [{"sensor": "magnetometer", "fault": "biased", "value": [30, 0, 0], "at": 5}]
    changes = {"world": base["world"] | {"magnetic_field": place}, "faults": faults}
    found = scenario(vehicle=mine, sensors={"magnetometer": {"latency": 0.1, "dropout": 0.2}}, **changes)
    sensor = sensors_of(found, vehicle_of(found))["magnetometer"]
    np.testing.assert_array_equal(sensor.site, [48.0, 66.0, -2.0])
    np.testing.assert_array_equal(sensor.bias, [12.0, -5.0, 3.0])
    np.testing.assert_allclose(sensor.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12)
    assert (sensor.rate, sensor.latency_steps, float(sensor.dropout)) == (20_000, 50, 0.2)
    assert sensor.offsets is not None and sensor.offsets.value.tolist() == [[30.0, 0.0, 0.0]]
    assert any("magnetometer (iron.compass)" in line and "uT" in line for line in listed(found, vehicle_of(found)))
    channel = sensor_channel("magnetometer", sensor.row)
    assert channel.fields == ("x", "y", "z", "t_valid") and channel.units == ("uT", "uT", "uT", "s")
    assert values_of({"magnetometer": (sensor.row.fields, sensor.row.units)})["magnetometer"]["units"] == ["uT"] * 3
    switched_on = flown("sensors.magnetometer=true")["magnetometer"]
    assert float(switched_on.noise[0]) == 0.2 and switched_on.site is not None
    with pytest.raises(ConfigError, match="magnetic_field.strength_ut: found 48000, expected a number of at most"):
        load_scenario("square", ["world.magnetic_field={strength_ut: 48000}"])
