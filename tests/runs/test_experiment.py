"""Identification tests as scenarios: commands as asked for, held axes held, hands, logs and records."""

import json

import equinox as eqx
import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.cli.flight.runs import _closing_table
from rovtwin.core.arrays.rotations import euler_from_rotation
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Slot
from rovtwin.core.frames import rotation_from_euler
from rovtwin.core.log import Log
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.user_files.config import parse
from rovtwin.gnc.experiment import HoldingGains, mixing
from rovtwin.gnc.mounting import Mount, at_co
from rovtwin.gnc.scales import VehicleScales
from rovtwin.identification.logs.readers import read_records
from rovtwin.planning.records import _signal, experiment_records, free_spans
from rovtwin.report.flight import Flight as Seen
from rovtwin.report.run.verdict import verdict
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.compose.experiment import experiment_of, pieces_of, spans_of
from rovtwin.runs.compose.fit_experiment import fitted_test
from rovtwin.runs.compose.sensors import sensors_of
from rovtwin.runs.fly import fly
from rovtwin.runs.loop import stack
from rovtwin.scenario.files import list_scenarios, load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.mismatch import perturbed
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.files import list_library

MANOEUVRES = [
    {"manoeuvre": "steps", "axis": "surge", "levels": [0.6], "duration": 5, "alternate": True, "home": 8},
    {"manoeuvre": "doublets", "axis": "yaw", "level": 0.5, "half": 1.0},
    {
        "manoeuvre": "multisine",
        "duration": 6,
        "axes": {"sway": {"frequencies_hz": [0.2], "amplitudes": [0.4], "phases_deg": [0]}},
        "keep": 0.0,
    },
    {"manoeuvre": "release", "attitude_deg": [30, 0], "by_hand": 5, "duration": 5},
]


def short(manoeuvres=MANOEUVRES, **more):
    data = {
        "name": "short",
        "duration": 100,
        "start": {"position": [1, 2, 3], "heading_deg": 30},
        "sensors": {"position": {"noise": 0.03, "rate_hz": 15}},
        "test": {"manoeuvres": manoeuvres},
    }
    return parse(Scenario, data | more, "short.yaml")


@pytest.fixture(scope="module")
def scenario():
    return short()


@pytest.fixture(scope="module")
def flight(scenario, tmp_path_factory):
    return fly(scenario, tmp_path_factory.mktemp("trial") / "run")


@pytest.fixture(scope="module")
def records(scenario):
    return experiment_records(scenario, seeds=[1, 2])


def during(log, what, channel):
    """Samples of a channel within the spans whose description begins so."""
    t, values = log[channel].t, log[channel].values
    spans = [s for s in json.loads(log.metadata["test"]) if s["what"].startswith(what)]
    inside = np.any([(t >= s["start"] - 1e-9) & (t < s["end"] - 1e-9) for s in spans], axis=0)
    return values[inside]


@pytest.mark.system
def test_a_test_is_done_and_says_so(flight):
    assert flight.completed and flight.figures["test"] and flight.figures["duration_s"] == pytest.approx(36.0)
    assert flight.figures["nees_position_mean"] is None and flight.figures["effort_n2s"] > 0
    assert verdict(Seen(flight.log)).headline == "Test done in 36 s"


@pytest.mark.system
def test_a_test_that_touched_the_floor_says_so_in_summary_terminal_and_report(flight, capsys):
    """The planned test of a bluerov2_heavy did, twice, and identify only found that its stretches disagree."""
    assert flight.figures["touched"] == []
    down = [{"manoeuvre": "steps", "axis": "heave", "levels": [0.6], "duration": 4, "home": 4}]
    shallow = fly(short(down, start={"position": [0, 0, 1.5]}, world={"floor": 2.0}))
    (line,) = shallow.figures["touched"]
    assert line.startswith("touched the floor at ") and "identify knows no such force" in line
    assert f"It {line}." in verdict(Seen(shallow.log)).sentences
    _closing_table(shallow, Console())
    assert line in capsys.readouterr().out


def test_a_full_command_on_an_axis_is_full_and_pushes_no_other_axis():
    for name in ("double_blueye", "bluerov2", "bluerov2_heavy"):
        model = load_vehicle(name).model()
        T, U = np.asarray(model.thrusters.configuration), mixing(model)
        able = np.abs(U).max(axis=0) > 0
        assert np.abs(U[:, able]).max(axis=0) == pytest.approx(1.0)
        wrench = T @ U
        assert np.all(np.diagonal(wrench)[able] > 0)
        assert np.abs(wrench - np.diag(np.diagonal(wrench)))[:, able].max() < 1e-9
    assert list(able) == [True] * 6
    pair = mixing(load_vehicle("double_blueye").model())
    assert not pair[:, 4].any(), "the Double Blueye has no pitch"


@pytest.mark.system
def test_excited_axes_get_what_was_asked_for_and_nothing_else(flight):
    log = flight.log
    surge = log["autopilot/command"].channel.fields.index("port_surge")
    commands = during(log, "steps", "autopilot/command")[:, [surge, surge + 3]]
    # What the two have in common is surge; their difference is what heading asks for.
    assert np.unique(np.round(commands.mean(axis=1), 9)).tolist() == [-0.6, 0.6]
    sway = during(log, "multisine", "autopilot/command")[:, [surge + 1, surge + 4]]
    t = np.arange(len(sway)) * 0.02
    middle = (t > 1) & (t < 4.9)
    assert sway[middle] == pytest.approx(np.tile(0.4 * np.sin(0.4 * np.pi * t[middle])[:, None], 2))


@pytest.mark.system
def test_depth_and_heading_are_held_while_surge_is_pulled(flight):
    eta = during(flight.log, "steps", "truth/eta")
    assert np.abs(eta[:, 2] - 3.0).max() < 0.05
    assert np.abs(eta[:, 5] - np.radians(30)).max() < np.radians(3)
    assert np.ptp(eta[:, 0]) > 0.5, "it went somewhere"


@pytest.mark.system
def test_the_way_home_leads_home(flight):
    home = during(flight.log, "home", "truth/eta")
    assert np.hypot(*(home[-1, :2] - [1, 2])) < 0.25  # the thrusters' dead band is 0.17 m of it
    assert np.hypot(*(home[-1, :2] - [1, 2])) < np.hypot(*(home[0, :2] - [1, 2]))


@pytest.mark.system
def test_a_hand_tilts_the_vehicle_and_lets_go(flight):
    hand, free = during(flight.log, "hand", "truth/eta"), during(flight.log, "release", "truth/eta")
    assert np.degrees(hand[-1, 3]) == pytest.approx(30.0, abs=0.5)
    assert np.abs(during(flight.log, "hand", "truth/nu")[-1, 3:]).max() < 0.02, "at rest when it lets go"
    assert np.degrees(free[-1, 3]) < 10.0
    for what in ("hand", "release"):
        assert not during(flight.log, what, "autopilot/command").any(), "thrusters are off"
    assert np.abs(during(flight.log, "hand", "truth/external_wrench")).max() > 1.0
    assert not during(flight.log, "release", "truth/external_wrench")[1:].any()


@pytest.mark.system
def test_the_log_has_every_command_every_reading_and_what_a_reader_must_know(flight):
    log = Log.read(flight.folder / "log.mcap")
    assert np.allclose(np.diff(log["autopilot/command"].t), 0.02)
    counts = {name: len(log[f"sensor/{name}"]) for name in ("position", "pressure", "gyro", "attitude")}
    assert counts == {"position": 540, "pressure": 1512, "gyro": 3600, "attitude": 3600}
    position = json.loads(log.metadata["sensors"])["position"]
    assert position["noise"] == [0.03, 0.03] and position["lever"] == [0, 0, 0]
    assert float(log.metadata["water_density"]) == 1000.0 and float(log.metadata["tether_length"]) == 0.0
    assert json.loads(log.metadata["thrusters"]) == list(log["autopilot/command"].channel.fields)
    error = (
        log["sensor/position"].values[:, :2]
        - np.array(
            [
                np.interp(log["sensor/position"]["t_valid"], log["truth/eta"].t, log["truth/eta"].values[:, i])
                for i in (0, 1)
            ]
        ).T
    )
    assert np.std(error) == pytest.approx(0.03, rel=0.1)


@pytest.mark.slow
@pytest.mark.system
def test_records_are_what_the_log_holds_without_the_hands(flight, records, scenario):
    mine = records[0]
    assert [(r.start, r.end) for r in mine] == free_spans(scenario) == [(0.0, 26.0), (31.0, 36.0)]
    for record in mine:
        log = flight.log["autopilot/command"]
        inside = (log.t >= record.start - 1e-9) & (log.t < record.end - 1e-9)
        assert record.command == pytest.approx(log.values[inside], abs=1e-9)
        for name, channel in (("horizontal", "position"), ("depth", "pressure"), ("gyro", "gyro")):
            signal, seen = record.signals[name], flight.log[f"sensor/{channel}"]
            # Compiled apart, stamps may differ in the last bit: rows are found by time, not by comparing with a bound.
            rows = np.searchsorted(seen["t_valid"], signal.t - 1e-6)
            assert signal.t == pytest.approx(seen["t_valid"][rows], abs=1e-9)
            assert signal.value == pytest.approx(seen.values[rows][:, :-1], abs=1e-9)
            assert (
                len(signal.t)
                > 0.95 * (record.end - record.start) * {"position": 15, "pressure": 42, "gyro": 100}[channel]
            )
        assert record.water_density == 1000.0 and record.tether_length == 0.0
        assert record.signals["horizontal"].sigma == pytest.approx([0.03, 0.03])


@pytest.mark.slow
@pytest.mark.system
def test_identification_reads_the_log_and_leaves_out_the_hands(flight, records):
    read = read_records(flight.folder / "log.mcap", load_vehicle("double_blueye"))
    assert len(read) == len(records[0]) == 2
    for own, mine in zip(read, records[0], strict=True):
        assert own.duration == pytest.approx(mine.duration, abs=0.1)
        # The reader's clock is zero at the first sample.
        middle = 0.5 * (mine.start + mine.end)
        shift = own.end - mine.end
        assert abs(shift) < 0.1
        assert own.command_at(np.array([middle + shift])) == pytest.approx(
            mine.command_at(np.array([middle])), abs=0.05
        )
        assert own.signals["horizontal"].sigma == pytest.approx([0.03, 0.03])
        assert own.water_density == 1000.0 and own.tether_length == 0.0
    assert np.degrees(read[1].signals["attitude"].value[0, 0]) == pytest.approx(30, abs=1), "from when it was let go"


def test_readings_of_turned_sensors_are_those_that_the_filter_takes():
    """Attitude and sigma were left along the sensor's axes: at heading 0 an imu that looks back gave 180 deg."""
    turned = {"attitude_deg": [20, -30, 180]}
    dvl = {"name": "dvl", "kind": "dvl", "pose": turned, "noise": [0.01, 0.02, 0.05]}
    parts = [{"name": "rov", "part": "double_blueye"}, {"name": "bow", "sensors": [dvl]}]
    run = compose(
        short(sensors={"attitude": turned, "gyro": turned}), vehicle=vehicle_from_dict({"name": "v", "parts": parts})
    )
    euler, omega, reading = np.array([0.1, -0.05, 0.3]), np.zeros(3), np.array([0.3, -0.2, 0.1])
    for name in ("attitude", "gyro", "dvl"):
        one = run.loop.twin.sensors[name]
        value = np.tile(_euler(_matrix(euler) @ one.rotation) if name == "attitude" else reading, (4, 1, 1))
        slot = Slot(value, np.ones((4, 1), bool), np.arange(4.0)[:, None])
        mount = Mount(one.noise, rotation=one.rotation)
        known = at_co({name: Slot(value[0], slot.valid[0], slot.t_valid[0])}, {name: mount}, euler, omega)[name].value
        signal = _signal(run, name, slot)
        np.testing.assert_allclose(signal.value, np.tile(known, (4, 1)), atol=1e-12)
        np.testing.assert_allclose(signal.sigma**2, mount.variance)
        if name == "attitude":
            np.testing.assert_allclose(signal.value[0], euler)


def _matrix(euler):
    return np.asarray(rotation_from_euler(euler))


def _euler(R):
    return euler_from_rotation(np.asarray(R)[None])[0]


@pytest.mark.slow
@pytest.mark.system
def test_vehicles_side_by_side_have_noise_and_parameters_of_their_own(scenario, records):
    model = load_vehicle("double_blueye").model()
    plants = stack([model, perturbed(model, jax.random.key(3), 0.3, 1.2, 0.8)])
    first, other = experiment_records(scenario, plants, seeds=[1, 2])
    assert first[0].command == pytest.approx(records[0][0].command, abs=1e-9), "the same vehicle and seed"
    assert np.abs(records[0][0].signals["depth"].value - records[1][0].signals["depth"].value).std() < 0.01
    away = other[0].signals["horizontal"].value - records[1][0].signals["horizontal"].value
    assert np.abs(away).max() > 0.1, "another vehicle with the same noise goes another way"


def test_shipped_tests_compose_and_end_in_time():
    names = [name for name in list_scenarios() if load_scenario(name).test]
    assert {"test_steps_thesis", "test_decay", "test_mixed"} <= set(names)
    for name in names:
        scenario = load_scenario(name)
        assert spans_of(scenario)[-1]["end"] < scenario.duration
        assert scenario.log.rate == scenario.rates.control == 50
        compose(scenario)


LIBRARY_TESTS = [name for name in list_scenarios() if load_scenario(name).test]


@pytest.mark.system
@pytest.mark.parametrize("vehicle", [*list_library(), "no_sway"])
@pytest.mark.parametrize("name", LIBRARY_TESTS)
def test_every_vehicle_flies_the_library_tests_without_what_it_cannot_push(name, vehicle, no_sway):
    reference = str(no_sway) if vehicle == "no_sway" else vehicle
    model = load_vehicle(reference).model()
    able = np.abs(mixing(model)).max(axis=0, initial=0.0) > 0
    try:
        scenario = fitted_test(load_scenario(name, [f"vehicle={reference}"]))
    except ConfigError as error:
        assert "nothing of this test is left" in str(error)
        assert not able.any() or (name == "free_running_sway" and "sway is left out" in str(error))
        return
    vehicle = load_vehicle(reference)
    experiment = experiment_of(scenario, model, vehicle, sensors_of(scenario, vehicle))
    excited = np.abs(np.asarray(experiment.timeline.share)).max(axis=0) > 0
    assert not excited[~able].any()
    assert spans_of(scenario)[-1]["end"] <= scenario.duration
    for axis in {"surge", "sway", "heave"} - {("surge", "sway", "heave")[i] for i in range(3) if able[i]}:
        if name == "test_steps_thesis":
            assert f"{axis} is left out: no thruster pushes there" in scenario.test.notes


def test_a_library_test_is_that_of_the_vehicle_put_in_after_it_was_read():
    written = load_scenario("test_mixed")
    assert written.test.written_for == "double_blueye"
    other = written.model_copy(update={"vehicle": "gladius_mini"})
    simulation = compose(other)
    assert simulation.scenario.test == fitted_test(load_scenario("test_mixed", ["vehicle=gladius_mini"])).test
    assert "sway is left out: no thruster pushes there" in simulation.scenario.test.notes
    assert int(simulation.loop.autopilot.timeline.count) < round(spans_of(written)[-1]["end"] / written.control_dt)
    assert compose(simulation.scenario).scenario == simulation.scenario, "the log's own scenario, flown again"


def test_a_test_of_ones_own_that_asks_for_sway_is_refused_without_sway(no_sway):
    with pytest.raises(ConfigError, match="cannot push in sway, expected one of surge, heave"):
        compose(short([STEP | {"axis": "sway"}], vehicle=str(no_sway)))


def test_holding_is_placed_from_the_vehicle(no_sway):
    """Stiffness over inertia is the bandwidth squared, whatever the vehicle's mass and thrust."""
    for name in ("double_blueye", "bluerov2_heavy", no_sway):
        model = load_vehicle(name).model()
        scales, gains = VehicleScales.of(model), HoldingGains.of(model)
        held = np.asarray(gains.stiffness) * scales.force / np.diagonal(np.asarray(model.inertia))
        share = np.sqrt(held) / scales.bandwidth
        assert share[[0, 2]] == pytest.approx([0.7, 0.7], rel=1e-4)
        assert np.isfinite(float(gains.reach)) == (name is no_sway)


def test_the_thesis_protocol_has_the_levels_of_its_tables():
    texts = [piece.what for piece in pieces_of(load_scenario("test_steps_thesis"))]
    surge = [what.split()[-1] for what in texts if what.startswith("steps surge")]
    assert [float(level) for level in surge] == [0.2, 0.4, 0.5, 0.6, 0.8, 0.9]
    assert "release at -33.42, 0 deg" in texts and "release at 0, -39.95 deg" in texts


STEP = {"manoeuvre": "steps", "axis": "surge", "levels": [0.5]}


@pytest.mark.parametrize(
    ("manoeuvres", "more", "message"),
    [
        (
            [STEP | {"axis": "pitch"}],
            {},
            "cannot push in pitch, expected one of surge, sway, heave, roll, yaw; tilt it",
        ),
        ([STEP | {"levels": [1.5]}], {}, r"manoeuvres\[0\].levels\[0\]: found 1.5"),
        ([STEP | {"manoeuvre": "stairs"}], {}, "manoeuvre"),
        ([STEP, {"manoeuvre": "release", "attitude_deg": [30, 0], "by_hand": 0}], {}, "expected at least 1 s"),
        ([STEP], {"mission": {"waypoints": [{"position": [1, 0, 1]}]}}, "both a mission and a test"),
        ([STEP], {"test": None}, "neither a mission nor a test"),
        ([STEP | {"duration": 600}], {}, "the test takes 600 s; write duration: 601"),
        (
            [{"manoeuvre": "multisine", "axes": {"yaw": {"frequencies_hz": [0.1, 0.2], "amplitudes": [0.1] * 3}}}],
            {},
            "3 amplitudes for 2 frequencies",
        ),
    ],
)
def test_mistakes_are_reported(manoeuvres, more, message):
    with pytest.raises(ConfigError, match=message):
        compose(short(manoeuvres, **more))


def test_a_mission_is_no_test_and_a_test_has_no_scores(scenario):
    with pytest.raises(ConfigError, match="is a mission, expected a test"):
        experiment_records(load_scenario("square"))
    with pytest.raises(ConfigError, match="2 plants for 1 seeds"):
        experiment_records(scenario, stack([load_vehicle("double_blueye").model()] * 2), seeds=[1])
    result = CliRunner().invoke(app, ["score", "test_mixed"])
    assert isinstance(result.exception, ConfigError) and "has no scores" in str(result.exception)


@pytest.mark.slow
def test_a_depth_limit_ends_a_test():
    deep = short(autopilot={"supervisor": {"depth_limit": 2.9}})  # it starts at 3 m
    with pytest.raises(ConfigError, match=r"short, seed 1: aborted after 0 s \(depth limit\)"):
        experiment_records(deep, seeds=[1, 2])


def test_home_is_where_it_begins_or_where_the_scenario_starts():
    for at_start, expected in ((False, [4.0, 0.0, 2.5]), (True, [1.0, 2.0, 3.0])):
        scenario = short([{"manoeuvre": "rest", "duration": 0.5, "home": 4}])
        scenario = scenario.model_copy(update={"test": scenario.test.model_copy(update={"home_at_start": at_start})})
        run = compose(scenario)
        elsewhere = eqx.tree_at(lambda start: start.position, run.start, jnp.array([4.0, 0.0, 2.5]))
        home = run.loop.autopilot.init(jax.random.key(0), elsewhere).home
        np.testing.assert_allclose(home[:3], expected)
        np.testing.assert_allclose(home[5], np.radians(30), atol=1e-9)
