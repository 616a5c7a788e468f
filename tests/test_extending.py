"""The pages under docs/extending: their code runs, from the files and entry points that they describe."""

import pickle
import re
import shlex
import socket
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.links.sensors import connect, free_port, is_closed, reading
from tests.links.serving import serving
from tests.packages import install

import rovtwin
import rovtwin.cli
from rovtwin.core.block import Start
from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.flow import Command
from rovtwin.core.trust import VARIABLE
from rovtwin.identification.logs.readers import detect, read_record
from rovtwin.links.endpoint import Where
from rovtwin.links.servers.server import require_loopback
from rovtwin.live.connect import opener, source
from rovtwin.live.serving.protocols import servers_of
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.pace import Clock
from rovtwin.simulation.sensors.kinds import SensorInput
from rovtwin.vehicle.physics.dynamics import State

PAGES = Path(__file__).parents[1] / "docs" / "extending"
LONGEST = 32  # lines of code of a page's plug-in


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (PAGES / page).read_text(), re.S)


@pytest.fixture(autouse=True)
def no_consent(monkeypatch):
    """To run code that a scenario names; a test that gives it gives it for itself."""
    monkeypatch.setenv(VARIABLE, "")


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Installs the module of a page; gives its other Python blocks, to be run with its names."""
    modules = []

    def done(page: str, module: str, points: dict, at: int = 0, longest: int = LONGEST) -> tuple[list[str], dict]:
        first, *others = blocks(page, "python")[at:]
        assert len([line for line in first.splitlines() if line.strip()]) <= longest
        monkeypatch.syspath_prepend(install(tmp_path / "site", module, first, points))
        modules.append(module)
        names: dict = {}
        exec(first, names)
        return others, names

    yield done
    for module in modules:
        sys.modules.pop(module, None)


@pytest.mark.slow
def test_a_block(installed, tmp_path, monkeypatch):
    (flown, checked), names = installed("block.md", "sliding", {"rovtwin.blocks": {"sliding": "sliding:SlidingMode"}})
    exec(flown, names)
    assert np.abs(names["flight"].log["truth/eta"].values[-1]).max() > 0.0
    exec(checked, names)
    (line,) = blocks("block.md", "sh")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [*shlex.split(line), "--set", "duration=1", "--no-report", "--out", "run"])
    with pytest.raises(SystemExit) as stopped:
        rovtwin.cli.main()
    assert stopped.value.code == 1 and (tmp_path / "run" / "log.mcap").is_file()


def test_the_blocks_section_of_a_scenario(installed, monkeypatch):
    import yaml

    monkeypatch.setenv(VARIABLE, "1")
    installed("block.md", "sliding", {"rovtwin.blocks": {"sliding": "sliding:SlidingMode"}})
    (text,) = blocks("block.md", "yaml")
    scenario = rovtwin.load_scenario(rovtwin.load_scenario("square").model_dump(mode="json") | yaml.safe_load(text))
    assert float(compose(scenario).loop.autopilot.control.gain) == 20.0


def test_a_force(installed, monkeypatch):
    import yaml

    monkeypatch.setenv(VARIABLE, "kelp:Kelp,kelp:jnp")
    installed("force.md", "kelp", {"rovtwin.blocks": {"kelp": "kelp:Kelp"}})
    (text,) = blocks("force.md", "yaml")
    square = rovtwin.load_scenario("square").model_dump(mode="json")
    run = compose(rovtwin.load_scenario(square | {"world": square["world"] | yaml.safe_load(text)["world"]}))
    twin = run.loop.twin
    world, state = twin.world, State.at(twin.model, Start.at((3.0, 0.0, 2.0)))
    state = replace(state, nu=state.nu.at[0].set(0.5))
    _, there = world.step(world.init(run.key, run.start), state, 0.002)
    ours = replace(world, forces=())
    _, without = ours.step(ours.init(run.key, run.start), state, 0.002)
    # In the middle of one patch, a radius of 2 m from that of the other by 1 m.
    expected = -40.0 * 0.5 * (1.0 + np.exp(-0.25))
    np.testing.assert_allclose(there.wrench - without.wrench, [expected, 0, 0, 0, 0, 0], atol=1e-12)
    wrong = square | {"world": square["world"] | {"forces": ["kelp:jnp"]}}
    with pytest.raises(ConfigError, match=r"square: world.forces\[0\]: kelp:jnp: found module"):
        compose(rovtwin.load_scenario(wrong))


def test_an_instrument(installed):
    (checked, *_), names = installed("link.md", "sounder", {"rovtwin.links": {"sounder": "sounder:SOUNDER"}})
    with source("sounder://127.0.0.1:9470", Clock()) as sounder:
        assert sounder.read() == []
    exec(checked, names)


def test_a_vehicle(installed):
    (checked, *_), names = installed("link.md", "mini", {"rovtwin.links": {"mini": "mini:MINI"}}, at=2, longest=48)
    opened = opener("mini://127.0.0.1:9471", rovtwin.load_scenario("square"), Clock())
    with pickle.loads(pickle.dumps(opened))() as mini, socket.socket(type=socket.SOCK_DGRAM) as vehicle:
        assert mini.read() == []
        vehicle.sendto(b"7.0 2.5", ("127.0.0.1", 9471))
        mini.send(Command(np.ones(3)))
        (depth,) = mini.read()
        assert depth.value == 2.5 and depth.t_valid == pytest.approx(mini._clock(), abs=0.5) and mini.age < 0.5
    exec(checked, names)


def test_a_server(installed):
    installed("link.md", "depth", {"rovtwin.links": {"depth": "depth:DEPTH"}}, at=4, longest=40)
    scenario, port = rovtwin.load_scenario("square"), free_port()
    vehicle: Any = SimpleNamespace(drones=("port", "starboard"), largest={})
    server: Any = servers_of(["depth"], scenario, vehicle, {"depth": Where(port=port)})["depth"]
    assert require_loopback([pickle.loads(pickle.dumps(server))], exposed=False) == []
    with serving(server, drones=vehicle.drones) as served, connect(port) as client, connect(port) as chatter:
        client.sendall(b"rate?\nwhat\n")
        lines = client.makefile("rb")
        assert [lines.readline(), lines.readline()] == [b"%g\n" % scenario.rates.control, b"expected rate?\n"]
        name = served.station.name(vehicle.drones[0], "pressure")
        served.feed(1.5, [reading(name, 1.5, 2.25), reading("compass", 1.5, 0.1)])
        assert lines.readline() == b"1.500 2.2500\n"
        chatter.sendall(b"x" * 1000)
        assert is_closed(chatter)
    with pytest.raises(ConfigError, match="--expose"):
        require_loopback([replace(server, host="0.0.0.0")], exposed=False)


def test_a_reader(installed, tmp_path):
    installed("reader.md", "datalogger", {"rovtwin.readers": {"dlg": "datalogger:read"}})
    vehicle = rovtwin.load_vehicle("double_blueye")
    t = np.arange(0.0, 10.0, 0.1)
    motion = np.stack([2.0 + 0.1 * np.sin(t), *np.zeros((2, t.size)), 90.0 + t])
    path = tmp_path / "pool.dlg"
    np.savetxt(path, np.column_stack([t, motion.T, np.full((t.size, 6), 0.25)]))
    assert detect(path) == "dlg"
    record = read_record(path, vehicle)
    np.testing.assert_allclose(record.signals["attitude"].value[0, 2], np.pi / 2)
    np.testing.assert_allclose(record.signals["depth"].value[:, 0], motion[0])
    assert record.command.shape[1] == 6 and (record.command == 0.25).all()
    path.write_text("nothing\n")
    with pytest.raises(IdentificationError, match=r"pool.dlg: the reader of dlg failed: ValueError"):
        read_record(path, vehicle)
    with pytest.raises(IdentificationError, match="unknown ending '.xyz'.*.dlg"):
        path.rename(tmp_path / "pool.xyz")
        detect(tmp_path / "pool.xyz")


def with_sensors() -> dict:
    """The scenario `square` with what the page says of sensors."""
    import yaml

    (text,) = blocks("sensor.md", "yaml")
    return rovtwin.load_scenario("square").model_dump(mode="json") | yaml.safe_load(text)


def test_a_sensor(installed, monkeypatch):
    monkeypatch.setenv(VARIABLE, "turbidity:Turbidity")
    points = {"rovtwin.sensors": {"turbidity": "turbidity:Turbidity"}}
    (checked,), names = installed("sensor.md", "turbidity", points)
    run = compose(rovtwin.load_scenario(with_sensors()))
    sensor, twin = run.loop.twin.sensors["turbidity"], run.loop.twin
    state = State.at(twin.model, Start.at((2.7, 1.5, 2.0)))
    _, environment = twin.world.step(twin.world.init(run.key, run.start), state, 0.002)
    own, value = sensor._ideal(None, SensorInput(state, state.nu, np.array(0), environment), 0.002)
    # 0.3 m ahead of CO it is a width of the plume east of its source.
    np.testing.assert_allclose(value, [0.5 + 20.0 * np.exp(-0.5)], rtol=1e-12)
    assert own is None and float(sensor.noise[0]) == 0.2 and sensor.latency_steps == 250
    assert twin.sensors["beside"].frozen is not None and float(twin.sensors["beside"].noise[0]) == 0.05
    monkeypatch.setenv(VARIABLE, "")  # what is installed needs no consent
    named = rovtwin.load_scenario("square", overrides=["sensors.murk={kind: turbidity}"])
    assert compose(named).sensor_kinds["murk"] == names["Turbidity"].kind
    exec(checked, names)


@pytest.mark.slow
def test_a_sensor_is_flown_and_logged(installed, monkeypatch):
    monkeypatch.setenv(VARIABLE, "1")
    installed("sensor.md", "turbidity", {})
    flight = rovtwin.fly(with_sensors(), overrides=["duration=2"], say=lambda line: None)
    series = flight.log["sensor/turbidity"]
    assert series.channel.fields == ("turbidity", "t_valid") and series.channel.units == ("NTU", "s")
    assert len(series) in (15, 16) and (series.values[:, 0] > 0.0).all() and "own_code" in flight.log.metadata


@pytest.mark.system
def test_evidence(installed, monkeypatch):
    import yaml

    from rovtwin.identification.experiment.information import with_anchors
    from rovtwin.planning.known import what_is_known

    (handed, checked), names = installed("evidence.md", "stopwatch", {"rovtwin.evidence": {"rise": "stopwatch:Rise"}})
    (text,) = blocks("evidence.md", "yaml")
    anchors = yaml.safe_load(text)["anchors"]
    parameters, prior = what_is_known(rovtwin.load_vehicle("double_blueye"), None)
    with pytest.raises(ConfigError, match=r"anchors\[0\]: names code, stopwatch:Rise"):
        with_anchors(parameters, prior, anchors)
    monkeypatch.setenv(VARIABLE, "stopwatch:Rise")
    after = with_anchors(parameters, prior, anchors)
    i = parameters.names.index("restoring.net_buoyancy")
    widths = [float(np.sqrt(one.covariance[i, i])) for one in (prior, after)]
    assert f"from {widths[0]:.1f} to {widths[1]:.2f} N" in (PAGES / "evidence.md").read_text()
    monkeypatch.setenv(VARIABLE, "")
    installed_kind = [{"kind": "rise", "settings": one["settings"]} for one in anchors]
    np.testing.assert_allclose(with_anchors(parameters, prior, installed_kind).covariance, after.covariance)
    asked = []
    monkeypatch.setattr("rovtwin.identification.identify.identify", lambda vehicle, records, **more: asked.append(more))
    exec(handed, names | {"logs": ()})
    assert asked[0]["anchors"] == [names["Rise"](distance=2.0, seconds=25.0)]
    exec(checked, names)


@pytest.mark.slow
def test_evidence_counts_in_an_estimate(installed):
    from tests.identification.synthetic import record, steps_command

    _, names = installed("evidence.md", "stopwatch", {"rovtwin.evidence": {"rise": "stopwatch:Rise"}})
    vehicle = rovtwin.load_vehicle("double_blueye")
    # What its drag leaves of 2 m in 25 s.
    log = record(vehicle.model(net_buoyancy=2.68), *steps_command(vehicle, 0, 8.0), 8.0, water_density=1000.0)
    free = ["restoring.net_buoyancy", "linear_damping.heave"]
    plain = rovtwin.identify(vehicle, log, free=free)
    settings = {"distance": 2.0, "seconds": 25.0, "sd": 0.01}
    timed = rovtwin.identify(vehicle, log, free=free, anchors=[{"kind": "rise", "settings": settings}])
    assert np.linalg.det(timed.covariance) < 0.5 * np.linalg.det(plain.covariance)
    assert timed.values["restoring.net_buoyancy"] == pytest.approx(2.68, abs=0.05)
    assert any("rise (stopwatch 1.0)" in line for line in timed.findings)


def test_a_view(installed, monkeypatch):
    from rovtwin.console.view import look
    from rovtwin.testing import view_states

    (checked,), names = installed("view.md", "balance", {"rovtwin.views": {"balance": "balance:Balance"}})
    with pytest.raises(ConfigError, match="--view: names code, balance:Balance"):
        look("balance:Balance", {})
    first, flying, *_ = view_states()
    assert look("balance", first) == {"title": "Balance", "every": 0.5, "text": "no vehicle yet"}
    rows = look("balance", flying | {"tau": [1.25, 0, 0, 0, 0, 0.5], "u": [-0.8, 0.1]})["rows"]
    assert rows[0] == ["surge", "1.25", "N"] and rows[-1] == ["largest command so far", "80", "%"]
    assert look("balance", flying | {"u": [0.0]})["rows"][-1][1] == "80", "it remembers"
    exec(checked, names)
