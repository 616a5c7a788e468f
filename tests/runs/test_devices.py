"""Faults, instruments and batteries in scenarios: from the file to the flight, its log and its report."""

import json

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Environment
from rovtwin.core.numerics import jnp
from rovtwin.report import write_report
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.compose.sensors import listed
from rovtwin.runs.feasibility.mission import require_feasible
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.simulation.sensors.sensor import SensorInput
from rovtwin.vehicle import vehicle_from_dict
from rovtwin.vehicle.physics.dynamics import State

LINE = """faults=[
    {at: 2, until: 4, thruster: port.surge, fault: dead},
    {at: 3, thruster: starboard.heave, fault: stuck, command: 0.4},
    {at: 2, thruster: port.sway, fault: weak, share: 0.5},
    {at: 2, thruster: starboard.sway, fault: reversed},
    {at: 5, unit: port, fault: lost, sensors: [attitude]},
    {at: 1, until: 2, sensor: gyro, fault: biased, value: [0.01, 0, 0]},
    {at: 1, until: 3, sensor: pressure, fault: frozen},
    {at: 4, sensor: position, fault: silent},
    {at: 3, fault: leak}]""".replace("\n", " ")


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """Seven seconds with one fault of every kind, given on the command line, and an altimeter."""
    settings = [LINE, "autopilot=thesis", "duration=7", "world.floor=20", "sensors.altimeter=true", "name=broken"]
    return fly(load_scenario("lawnmower_calm", settings), tmp_path_factory.mktemp("runs") / "broken")


def between(series, start, end):
    """Values of a sensor's readings taken within a span."""
    t = series["t_valid"]
    return series.values[(t >= start - 1e-6) & (t < end - 1e-6)]


@pytest.mark.system
def test_the_plant_does_what_the_faults_say(flight):
    thrust = flight.log["truth/thrust"]
    late = thrust.t > 6.9
    port = [name for name in thrust.channel.fields if name.startswith("port")]
    assert len(port) == 3
    for name in port:
        assert np.abs(thrust[name][late]).max() < 1e-3
    # 0.4 of the command of a heave pseudo-thruster of 11 N, with its dead band and exponent.
    assert thrust["starboard_heave"][late][-1] == pytest.approx(11 * ((0.4 - 0.07) / 0.93) ** 1.33, rel=1e-6)


@pytest.mark.system
def test_the_sensors_fail_as_they_should(flight):
    log = flight.log
    frozen = between(log["sensor/pressure"], 1.0, 3.0)
    assert len(frozen) == 84 and np.ptp(frozen[:, 0]) == 0.0
    assert np.ptp(between(log["sensor/pressure"], 3.0, 7.0)[:, 0]) > 0.0
    assert log["sensor/position"]["t_valid"][-1] == pytest.approx(3.0)
    assert log["sensor/attitude"]["t_valid"][-1] == pytest.approx(4.99)
    gyro, rate = log["sensor/gyro"], log["truth/nu"]
    error = gyro["x"] - np.interp(gyro["t_valid"], rate.t, rate["p"])
    inside = (gyro["t_valid"] > 1.0 - 1e-6) & (gyro["t_valid"] < 2.0 - 1e-6)
    assert np.mean(error[inside]) == pytest.approx(0.01, abs=1e-3) and abs(np.mean(error[gyro.t < 1])) < 1e-3


@pytest.mark.system
def test_a_leak_brings_its_sensor_on_board(flight):
    leak = flight.log["sensor/leak"]
    np.testing.assert_array_equal(leak["leak"], [0, 0, 0, 1, 1, 1, 1][: len(leak)])


@pytest.mark.system
def test_the_altimeter_reads_the_height_above_the_floor(flight):
    altimeter, eta = flight.log["sensor/altimeter"], flight.log["truth/eta"]
    depth, roll, pitch = (np.interp(altimeter["t_valid"], eta.t, eta[name]) for name in ("z", "phi", "theta"))
    assert np.abs(altimeter["range"] * np.cos(roll) * np.cos(pitch) - (20.0 - depth)).max() < 0.05  # the beam leans too
    assert len(altimeter) == 70


@pytest.mark.system
def test_the_filter_passes_over_what_it_does_not_know(flight):
    dof = flight.log["autopilot/nis_dof"]
    assert not dof["altimeter"].any() and not dof["leak"].any() and dof["pressure"].any()


@pytest.mark.slow
@pytest.mark.system
def test_log_and_report_name_the_faults(flight, tmp_path):
    listed = json.loads(flight.log.metadata["faults"])
    assert listed[0] == {"what": "port.surge dead", "start": 2.0, "end": 4.0, "thrusters": ["port.surge"]}
    assert listed[4]["what"] == "unit port lost (and attitude silent)" and len(listed[4]["thrusters"]) == 3
    page = write_report(flight.log, tmp_path).read_text()
    for text in ("gyro biased (by 0.01, 0, 0)", "starboard.heave stuck (at command 0.4)", "the end", "Faults</h2>"):
        assert text in page


@pytest.mark.system
def test_the_written_scenario_has_the_same_faults(flight):
    written = load_scenario(flight.folder / "scenario.yaml")
    assert written.faults == flight.scenario.faults and written.battery == flight.scenario.battery


def test_without_faults_there_is_nothing(short):
    simulation = compose(short)
    assert simulation.loop.twin.faults is None and simulation.faults == []
    assert all(s.frozen is None and s.offsets is None for s in simulation.loop.twin.sensors.values())


WRONG = {
    "faults[0].thruster: no thruster 'port.serge'; there are port.surge": "{thruster: port.serge, fault: dead}",
    "no unit 'uhi' with thrusters; there are port, starboard": "{unit: uhi, fault: lost}",
    "faults[0].sensor: no sensor 'dvl' on board; there are position": "{sensor: dvl, fault: frozen}",
    "faults[0].sensors: no sensor 'sonar'": "{unit: port, fault: lost, sensors: [sonar]}",
    "faults[0].value: found 2 numbers, expected 1 or 3": "{sensor: gyro, fault: biased, value: [1, 2]}",
    "missing value": "{sensor: gyro, fault: biased}",
    "missing share": "{thruster: port.surge, fault: weak}",
    "found share, which belongs to fault 'weak'": "{thruster: port.surge, fault: dead, share: 0.1}",
    "fault 'frozen' is of a sensor; a thruster can be dead": "{thruster: port.surge, fault: frozen}",
    "fault 'dead' is of a thruster; say of which thruster": "{fault: dead}",
    "fault 'leak' is of the vehicle itself; a unit can be lost": "{unit: port, fault: leak}",
    "found thruster and unit, expected one": "{unit: port, thruster: port.surge, fault: dead}",
    "ends at 2 s, expected later than it begins, 3 s": "{at: 3, until: 2, fault: leak}",
    "expected a number of at most 1": "{thruster: port.surge, fault: stuck, command: 2}",
    "Did you mean 'thruster'": "{thrustr: port.surge, fault: dead}",
    "Did you mean 'reversed'": "{thruster: port.surge, fault: reverse}",
}


@pytest.mark.parametrize("message", WRONG)
def test_what_cannot_break_is_reported(message):
    with pytest.raises(ConfigError) as error:
        compose(load_scenario("lawnmower_calm", [f"faults=[{WRONG[message]}]"]))
    assert message in str(error.value)


@pytest.mark.parametrize(
    "message, setting",
    [("has no floor", "sensors.altimeter=true"), ("there is none on board", "sensors.leak.rate_hz=2")],
)
def test_instruments_that_cannot_be_are_refused(message, setting):
    with pytest.raises(ConfigError, match=message):
        compose(load_scenario("lawnmower_calm", [setting]))


# -- tethers


@pytest.mark.slow
def test_a_snagged_tether_holds_the_vehicle_back():
    """Going north with the tether of one unit caught behind it at 10 s, it gets less far than without."""
    common = [
        "autopilot=thesis",
        "world.tethers={}",
        "start.position=[0, 0, 3]",
        "duration=40",
        "name=caught",
        "log.sensors=false",
    ]
    # The one that stays free is caught after its end: one compiled program serves both.
    faults = (f"faults=[{{at: {at}, tether: port, fault: snagged}}]" for at in (1000, 10))
    free, caught = (fly(load_scenario("lawnmower_calm", [*common, fault])) for fault in faults)
    a, b = free.log["truth/eta"], caught.log["truth/eta"]
    before = a.t < 10.0
    np.testing.assert_allclose(b.values[before], a.values[before], atol=1e-9)
    assert a["x"][-1] - b["x"][-1] > 0.3


@pytest.mark.parametrize(
    "message, settings",
    [
        ("no tether 'port' is connected; none is; set world.tethers", []),
        ("no tether 'left' is connected; there are port_tether, starboard_tether", ["world.tethers={}"]),
    ],
)
def test_a_tether_that_is_not_there_cannot_snag(message, settings):
    name = message.split("'")[1]
    fault = f"faults=[{{tether: {name}, fault: snagged}}]"
    with pytest.raises(ConfigError) as error:
        compose(load_scenario("lawnmower_calm", [*settings, fault]))
    assert message in str(error.value)


# -- batteries


@pytest.fixture(scope="module")
def drained(tmp_path_factory):
    """Six seconds on batteries, of which port's has 60 J left: gone in three."""
    settings = ["battery={charge: {port: 0.000223}}", "sensors.battery=true", "autopilot=thesis", "duration=6",
                "name=drained"]  # fmt: skip
    return fly(load_scenario("lawnmower_calm", settings), tmp_path_factory.mktemp("runs") / "drained")


@pytest.mark.slow
@pytest.mark.system
def test_a_unit_whose_battery_is_empty_loses_its_thrusters(drained):
    battery, thrust = drained.log["truth/battery"], drained.log["truth/thrust"]
    assert battery.channel.fields == ("port_charge", "starboard_charge", "port_power", "starboard_power")
    assert battery["port_charge"][-1] == 0.0 and battery["starboard_charge"][-1] > 0.99
    gone = battery.t[np.argmax(battery["port_charge"] == 0.0)]
    assert 2.0 < gone < 3.5
    late = thrust.t > gone + 2.0
    assert np.abs(thrust["port_heave"][late]).max() < 1e-3 < np.abs(thrust["starboard_heave"][late]).min()
    gauge = drained.log["sensor/battery"]
    assert gauge["charge"][-1] == 0.0 and gauge["power"][-1] == pytest.approx(battery["starboard_power"][-1], rel=0.05)


@pytest.mark.slow
@pytest.mark.system
def test_energy_is_in_summary_and_report(drained, tmp_path):
    power = drained.log["truth/battery"].values[:, 2:].sum(axis=1)
    assert drained.figures["energy_wh"] == pytest.approx(power.sum() * 0.1 / 3600, rel=0.05)
    assert "taken from the batteries" in write_report(drained.log, tmp_path).read_text()


@pytest.mark.parametrize(
    "message, settings",
    [
        ("set battery to true", ["sensors.battery=true"]),
        ("battery.charge: no battery 'left'; double_blueye has port, starboard", ["battery={charge: {left: 0.5}}"]),
        ("battery: double_blueye_thesis has none", ["battery=true", "vehicle=double_blueye_thesis"]),
        ("of at most 1", ["battery={charge: 2}"]),
    ],
)
def test_batteries_that_are_not_there_are_refused(message, settings):
    with pytest.raises(ConfigError) as error:
        compose(load_scenario("lawnmower_calm", settings))
    assert message in str(error.value)


@pytest.mark.system
def test_a_gauge_of_a_part_tells_nothing_without_a_battery_and_no_rule_waits_for_it():
    gauge = {"name": "pod", "sensors": [{"name": "gauge", "kind": "battery"}]}
    vehicle = vehicle_from_dict({"name": "v", "parts": [{"name": "rov", "part": "double_blueye"}, gauge]})
    rule = "autopilot.supervisor.battery_low.limit=0.3"
    with pytest.raises(ConfigError, match="battery_low: no battery is simulated, so that it could never act"):
        require_feasible(load_scenario("square", [rule]), vehicle.model())
    assert not require_feasible(load_scenario("square", [rule]), vehicle.model(), known_world=False)  # a real one
    for settings, reported in (([], 0), (["battery=true", rule], 1)):
        simulation = compose(load_scenario("square", settings), vehicle=vehicle)
        lines = listed(simulation.scenario, vehicle)
        assert any("silent: no battery is simulated" in line for line in lines) == (not reported)
        twin = simulation.loop.twin
        state = State.at(twin.model, simulation.start)
        energy = jnp.array([0.9, 20.0]) if reported else None
        seen = SensorInput(state, jnp.zeros(6), jnp.asarray(499), Environment.calm(), energy)
        sensor = twin.sensors["battery"]
        _, slot = sensor.step(sensor.init(simulation.key, simulation.start), seen, 0.002)
        assert int(slot.valid.sum()) == reported
