"""Sensors of one's own: named in a scenario, checked before anything flies, read and logged as every other sensor."""

import sys

import numpy as np
import pytest
import yaml

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Environment
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.sensors import SensorKind
from rovtwin.core.trust import VARIABLE
from rovtwin.runs.compose.composition import compose, vehicle_of
from rovtwin.runs.compose.own_blocks import own_sensor
from rovtwin.runs.compose.sensors import kinds_on_board, listed
from rovtwin.runs.recording.channels import log_channels, sensor_channel
from rovtwin.runs.recording.provenance import provenance
from rovtwin.scenario.files import dump_scenario, load_scenario, scenario_of
from rovtwin.scenario.schema import OwnSensorSection
from rovtwin.simulation.sensors.kinds import SensorInput
from rovtwin.testing import check_sensor
from rovtwin.vehicle.physics.dynamics import State

SOURCE = '''
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import rovtwin
from rovtwin.core.flow import Estimate
from rovtwin.core.sensors import SensorKind

Path("imported").touch()
KIND = SensorKind(("oxygen", "warmth"), ("umol/L", "degC"), "", "oxygen and warmth", rate_hz=5.0, std=0.1)


class Probe(rovtwin.Block):
    """Lags behind: first order."""

    kind = KIND
    slowness: float = 2.0  # [s]

    def init(self, key, start):
        return jnp.array([200.0, 8.0])

    def step(self, memory, input, dt):
        now = jnp.stack([200.0 - 10.0 * input.position[2], 8.0 + 0.0 * input.time])
        memory = memory + dt / self.slowness * (now - memory)
        return memory, memory


class Nothing(Probe):
    def step(self, memory, input, dt):
        return memory, jnp.where(input.time < 1.0, jnp.nan, 1.0) * memory


class Kindless(Probe):
    kind = "oxygen"


class Listed(Probe):
    kind = SensorKind(["oxygen"], ("1",), "", "", 1.0)


class Uneven(Probe):
    kind = SensorKind(("oxygen", "warmth"), ("1",), "", "", 1.0)


class Timed(Probe):
    kind = SensorKind(("t_valid",), ("s",), "", "", 1.0)


class Framed(Probe):
    kind = SensorKind(("oxygen",), ("1",), "enu", "", 1.0)


class Noisy(Probe):
    kind = SensorKind(("oxygen",), ("1",), "", "", 1.0, std=-0.1)


class Short(Probe):
    def step(self, memory, input, dt):
        return memory, memory[:1]


class Deep(Probe):
    def step(self, memory, input, dt):
        return memory, memory * (input.environment.floor - input.position[2])


class Growing(Probe):
    def step(self, memory, input, dt):
        return jnp.zeros(3), memory


class Reading(rovtwin.Block):
    """An observer that reads the probe."""

    lever: object

    @classmethod
    def of(cls, sensors):
        return cls(sensors["probe"].lever)

    def init(self, key, start):
        return None

    def step(self, memory, input, dt):
        oxygen = input.measurements["probe"].value[0, 0]
        nothing = jnp.zeros(len(input.measurements))
        six = jnp.zeros(6)
        return memory, Estimate.from_euler(six + oxygen, six, six, jnp.eye(12), nothing, nothing)
'''


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working directory, with a module of sensors that leaves a mark when it is imported; consented to."""
    monkeypatch.setenv(VARIABLE, "1")
    monkeypatch.setattr(sys, "path", [one for one in sys.path if one])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "probes.py").write_text(SOURCE)
    yield tmp_path
    sys.modules.pop("probes", None)


def written(probe, **sections) -> str:
    """A scenario's file with this sensor."""
    with open("mine.yaml", "w") as file:
        yaml.safe_dump({"mission": "square", "sensors": {"probe": probe}, **sections}, file)
    return "mine.yaml"


def read_by(sensor, seconds: float):
    """Times at which a sensor's readings were valid, and values, of a vehicle at rest in 3 m depth."""
    at_rest = jnp.array([0.0, 0.0, 3.0]), jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(6), jnp.zeros(2)
    seen = State(*at_rest)

    def run(key):
        def one(memory, k):
            return sensor.step(memory, SensorInput(seen, jnp.zeros(6), k, Environment.calm()), 0.002)

        return jax.lax.scan(one, sensor.init(key, None), jnp.arange(round(500 * seconds)))[1]

    slot = jax.jit(run)(jax.random.key(3))
    valid = np.asarray(slot.valid[:, 0])
    return np.asarray(slot.t_valid[:, 0])[valid], np.asarray(slot.value[:, 0])[valid]


@pytest.mark.system
def test_it_flies_beside_the_others_and_the_log_knows_its_fields():
    fault = {"sensor": "probe", "fault": "biased", "value": [5, 0], "at": 2}
    given = {"kind": "probes:Probe", "settings": {"slowness": 0.5}, "position": [0.1, 0, 0.2], "noise": 0.0}
    scenario = load_scenario(written(given, faults=[fault]))
    run = compose(scenario)
    assert run.sensor_names[-1] == "probe" and run.sensor_names[:-1] == compose(load_scenario("square")).sensor_names
    sensor = run.loop.twin.sensors["probe"]
    t, value = read_by(sensor, 4.0)
    np.testing.assert_allclose(t, np.arange(0.2, 4.1, 0.2), rtol=1e-12)
    # 3.2 m deep, a step of -32 umol/L through a lag of 0.5 s in steps of 0.2 s; 5 too much from 2 s on.
    lagged = 200.0 - 32.0 * (1.0 - 0.6 ** np.arange(1, 21))
    np.testing.assert_allclose(value[:, 0], lagged + np.where(t >= 2.0, 5.0, 0.0), rtol=1e-12)
    assert (value[:, 1] == 8.0).all()
    channel = log_channels(run.thruster_names, run.sensor_kinds, 10.0, True)[-1]
    assert channel == sensor_channel("probe", sensor.row) and channel.name == "sensor/probe"
    assert channel.fields == ("oxygen", "warmth", "t_valid") and channel.units == ("umol/L", "degC", "s")
    assert "probes" in provenance(scenario, run)["own_code"]
    assert kinds_on_board(scenario, run.vehicle) == run.sensor_kinds
    again = scenario_of(yaml.safe_load(dump_scenario(scenario)), "again.yaml")
    assert again.sensors.own == scenario.sensors.own and dict(again.sensors.own)


def test_a_reading_that_is_no_number_is_not_delivered():
    sensor = compose(load_scenario(written("probes:Nothing"))).loop.twin.sensors["probe"]
    t, value = read_by(sensor, 2.0)
    assert t[0] == pytest.approx(1.0) and len(t) == 6 and np.isfinite(value).all()


def test_without_consent_nothing_is_imported(folder, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")
    with pytest.raises(ConfigError, match="mine: sensors.probe: names code, probes:Probe, which would be run"):
        compose(load_scenario(written("probes:Probe")))
    shown = load_scenario("mine.yaml")
    assert listed(shown, vehicle_of(shown))[-1] == "  probe (your own): probes:Probe"
    assert not (folder / "imported").exists()
    off = load_scenario(written({"kind": "probes:Probe", "on_board": False}))
    assert "probe" not in compose(off).sensor_names and not (folder / "imported").exists()
    by_hand = load_scenario("square", ["sensors.probe.kind=probes:Probe", "sensors.probe.rate_hz=2"])
    assert compose(by_hand).loop.twin.sensors["probe"].rate == 2000


@pytest.mark.parametrize(
    ("kind", "why"),
    [
        ("probes:KIND", "found SensorKind, expected a rovtwin.Block"),
        ("probes:Kindless", "kind: found str, expected a rovtwin.core.sensors.SensorKind"),
        ("probes:Listed", r"kind.fields: found \['oxygen'\], expected a tuple of texts"),
        ("probes:Uneven", "kind: unit .* expected one unit, or one for each field"),
        ("probes:Timed", "kind: fields .* expected one or more different names"),
        ("probes:Framed", "kind.frame: found 'enu', expected one of"),
        ("probes:Noisy", "kind.std: found -0.1, expected a finite number, 0 or more"),
        ("probes:Short", r"output of step: found float64\[1\], expected float64\[2\]"),
        ("probes:Deep", "step failed: TypeError"),  # this world has no floor
        ("probes:Growing", "memory after step"),
        ("probes:Gone", "found no 'Gone' in probes"),
        ("os:system", "a part of Python itself"),
        ("unheard", "expected package.module:Name, or the name of an entry point .*rovtwin.sensors"),
    ],
)
def test_what_is_no_sensor_is_refused_before_anything_flies(kind, why):
    with pytest.raises(ConfigError, match=f"mine: sensors.probe: .*{why}"):
        compose(load_scenario(written(kind)))


@pytest.mark.parametrize(
    ("sensors", "why"),
    [
        ({"dvl": {"kind": "probes:Probe"}}, "dvl: found kind, but its name says its kind"),
        ({"dlv": True}, "dlv: no such key. Did you mean 'dvl'.*needs its kind"),
        ({"2nd": "probes:Probe"}, "2nd: found a name that a log's channel cannot have"),
        ({"truth": "probes:Probe"}, "truth: found a name .* that is taken"),
        ({"probe": "not a name!"}, "sensors.probe: found 'not a name!', expected package.module:Name"),
        ({"probe": {"kind": "probes:Probe", "noise": -1}}, "sensors.probe.noise: found -1, expected a number of at l"),
        ({"probe": {"kind": "probes:Probe", "nose": 1}}, "sensors.probe.nose: no such key. Did you mean 'noise'"),
    ],
)
def test_mistakes_in_its_section_say_where(sensors, why):
    with pytest.raises(ConfigError, match=why) as error:
        scenario_of({"name": "mine", "mission": "square", "sensors": sensors}, "mine.yaml")
    assert len(str(error.value).splitlines()) == 1


def test_a_fault_has_as_many_numbers_as_its_reading():
    fault = {"sensor": "probe", "fault": "biased", "value": [1, 2, 3]}
    with pytest.raises(ConfigError, match=r"faults\[0\].value: found 3 numbers, expected 1 or 2: probe has 2"):
        compose(load_scenario(written("probes:Probe", faults=[fault])))


def test_an_observer_of_ones_own_reads_it():
    given = {"kind": "probes:Probe", "position": [0.1, 0, 0.2]}
    run = compose(load_scenario(written(given, autopilot={"observer": "probes:Reading"})))
    np.testing.assert_array_equal(run.loop.autopilot.observer.lever, [0.1, 0.0, 0.2])


@pytest.mark.system
def test_the_contract_names_what_is_wrong():
    made = {name: own_sensor(OwnSensorSection(kind=f"probes:{name}"), "here") for name in ("Probe", "Short", "Nothing")}
    check_sensor(made["Probe"])
    with pytest.raises(AssertionError, match=r"output of step: found float64\[1\]"):
        check_sensor(made["Short"])
    with pytest.raises(AssertionError, match="no finite number"):
        check_sensor(made["Nothing"])
    with pytest.raises(AssertionError, match="kind: found NoneType"):
        check_sensor(compose(load_scenario("square")).loop.twin.world)
    assert made["Probe"].kind == SensorKind(("oxygen", "warmth"), ("umol/L", "degC"), "", "oxygen and warmth", 5.0, 0.1)
