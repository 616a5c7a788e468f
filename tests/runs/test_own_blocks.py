"""Blocks of one's own in the model-based autopilot: found, checked before anything flies, flown, recorded."""

import json
import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
from tests.packages import install

import rovtwin
from rovtwin.console.engine.helm import Helm
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import (
    ABORT,
    ABORTED,
    ARM,
    NO_REQUEST,
    NOT_A_NUMBER,
    PAUSE,
    PAUSED,
    REASONS,
    SENSOR_SILENT,
    AutopilotInput,
)
from rovtwin.core.numerics import jax, jnp
from rovtwin.core.trust import VARIABLE
from rovtwin.gnc.guard import Guarded
from rovtwin.runs.batch import score_seeds
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import load_scenario

SOURCE = '''
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import rovtwin
from rovtwin.core.flow import AutopilotOutput, Command, Estimate, Wrench
from rovtwin.core.frames import level_attitude, rotation_error, yaw_rotation
from rovtwin.gnc.interfaces import Allocated


class Springs(rovtwin.Block):
    """Springs and dampers on every axis."""

    stiffness: float = 40.0
    damping: float = 60.0

    def init(self, key, start):
        return None

    def step(self, memory, input, dt):
        estimate, reference = input.estimate, input.reference
        away = yaw_rotation(estimate.heading).T @ (reference.position - estimate.position)
        turn = rotation_error(reference.attitude, estimate.attitude)
        error = jnp.concatenate([away, turn * jnp.array([0.0, 0.0, 1.0])])
        tau = self.stiffness * error - self.damping * input.estimate.nu * jnp.array([1, 1, 1, 0, 0, 0.3])
        return memory, Wrench(tau, jnp.zeros(6, bool))


class Gravely(Springs):
    """Made by `of`, from the vehicle."""

    @classmethod
    def of(cls, model, share, dt):
        assert dt == 0.02
        return cls(stiffness=share * float(model.inertia[0, 0]))


class Tall(Springs):
    def step(self, memory, input, dt):
        return memory, Wrench(jnp.zeros(3), jnp.zeros(6, bool))


class Bare(Springs):
    def step(self, memory, input, dt):
        return memory, jnp.zeros(6)


class Growing(Springs):
    def init(self, key, start):
        return jnp.zeros(2)

    def step(self, memory, input, dt):
        return jnp.zeros(3), Wrench(jnp.zeros(6), jnp.zeros(6, bool))


class Raising(Springs):
    def step(self, memory, input, dt):
        return memory, Wrench(input.nothing, jnp.zeros(6, bool))


class Choosing(Springs):
    def step(self, memory, input, dt):
        error = input.reference.velocity
        if error[0] > 1.0:
            error = 2.0 * error
        return memory, Wrench(error, jnp.zeros(6, bool))


class Converting(Springs):
    def step(self, memory, input, dt):
        return memory, Wrench(np.sin(np.asarray(input.estimate.nu)), jnp.zeros(6, bool))


class Rounding(Springs):
    def step(self, memory, input, dt):
        return memory, Wrench(jnp.full(6, float(input.estimate.position[0])), jnp.zeros(6, bool))


class Texts(Springs):
    name: str = "mine"


class Single(Springs):
    def step(self, memory, input, dt):
        return Wrench(jnp.zeros(6), jnp.zeros(6, bool))


class Failing(rovtwin.Block):
    """No number from 3 s on."""

    def init(self, key, start):
        return jnp.zeros(())

    def step(self, memory, input, dt):
        tau = jnp.full(6, jnp.where(memory < 3.0, 1.0, jnp.nan))
        return memory + dt, Wrench(tau, jnp.zeros(6, bool))


class Once(rovtwin.Block):
    """No number in one tick, at 1 s; its memory is none either, from then on."""

    def init(self, key, start):
        return jnp.zeros(2)

    def step(self, memory, input, dt):
        t, spoilt = memory
        spoilt = jnp.where(jnp.abs(t - 1.0) < 0.5 * dt, jnp.nan, spoilt)
        return jnp.stack([t + dt, spoilt]), Wrench(jnp.full(6, 1.0 + spoilt), jnp.zeros(6, bool))


class Biased(rovtwin.Block):
    """Pushes with 0.3 though nothing is asked of it."""

    def init(self, key, start):
        return None

    def step(self, memory, input, dt):
        six, free = jnp.zeros(6), jnp.zeros(input.health.shape, bool)
        return memory, Allocated(Command(0.3 + jnp.zeros(input.health.shape)), six, six, six, free)


class Halves(Springs):
    stiffness: object = np.float16(40.0)


class Complex(Springs):
    stiffness: object = eqx.field(default_factory=lambda: np.array([1j]))


class Keyed(Springs):
    key: object = eqx.field(default_factory=lambda: jax.random.key(0))


class Objects(Springs):
    things: object = eqx.field(default_factory=lambda: np.array([None, "a"], dtype=object))


class Huge(Springs):
    number: int = 2**70


class Listed(Springs):
    axes: object = eqx.field(static=True, default_factory=lambda: [1, 2])


class Arrayed(Springs):
    axes: object = eqx.field(static=True, default_factory=lambda: np.zeros(2))


class Remembering(Springs):
    def init(self, key, start):
        return Listed()

    def step(self, memory, input, dt):
        return memory, Wrench(jnp.zeros(6), jnp.zeros(6, bool))


class Breeze(rovtwin.Block):
    """A force that fails only after the vehicle has."""

    def init(self, key, start):
        return None

    def step(self, memory, input, dt):
        return memory, -0.1 * input.nu


class Gust(rovtwin.Block):
    """A force that is no number from 2 s on."""

    def init(self, key, start):
        return jnp.zeros(())

    def step(self, memory, input, dt):
        return memory + dt, jnp.full(6, jnp.where(memory < 2.0, 0.0, jnp.nan))


class Lost(rovtwin.Block):
    """An observer that is lost from 1 s on."""

    def init(self, key, start):
        return jnp.zeros(())

    def step(self, memory, input, dt):
        place, six = jnp.full(3, jnp.where(memory < 1.0, 0.0, jnp.nan)), jnp.zeros(6)
        nis = jnp.zeros(len(input.measurements))
        return memory + dt, Estimate(place, level_attitude(0.0), six, jnp.zeros(6), 1e-4 * jnp.eye(12), nis, nis)


class Whole(rovtwin.Block):
    """Another autopilot with a command that is too large, and no number from 1 s to 2 s."""

    output: AutopilotOutput

    def init(self, key, start):
        return jnp.zeros(())

    def step(self, memory, input, dt):
        u = jnp.where((memory > 0.99) & (memory < 1.99), jnp.nan, 7.0)
        return memory + dt, replace(self.output, command=Command(u + self.output.command.u))


class Plain:
    pass


def broken(model):
    raise RuntimeError("no licence")


READY = Springs()
'''
SPRINGS = {"controller": "springs"}
NO_NUMBER = "a value that is no number at t ="
QUICK = ["duration=6", "log.rate=10"]


def silent(line): ...


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Installed once: its classes are then the same in all tests, and so are the programs that they are compiled to."""
    points = {"rovtwin.blocks": {"springs": "own_control:Springs"}}
    site = install(tmp_path_factory.mktemp("packages") / "site", "own_control", SOURCE, points)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(site)
        yield site
    sys.modules.pop("own_control", None)


@pytest.fixture(autouse=True)
def trusted(monkeypatch):
    """With consent to run what a scenario names (`test_trust.py` is about that)."""
    monkeypatch.setenv(VARIABLE, "1")


def scenario(section, *more):
    return rovtwin.load_scenario(load_scenario("square").model_dump(mode="json") | {"autopilot": section}, [*more])


@pytest.mark.system
@pytest.mark.parametrize(
    ("section", "why"),
    [
        (
            {"controller": "nowhere.at.all:X"},
            "autopilot.controller: nowhere.at.all:X: found no module 'nowhere'",
        ),
        ({"controller": "own_control:Nobody"}, "found no 'Nobody' in own_control"),
        ({"controller": "spring"}, r"found 'spring', expected package.module:Name.*\(one of springs\)"),
        ({"controller": "own control:X"}, "autopilot.*controller.*found 'own control:X'"),
        ({"controller": "own_control:Plain"}, "found the class Plain, expected a rovtwin.Block with init and step"),
        ({"controller": "own_control:Tall"}, r"output of step: found .tau float64\[3\], expected float64\[6\]"),
        ({"controller": "own_control:Bare"}, "output of step: found no .tau.*expected Wrench"),
        ({"controller": "own_control:Growing"}, r"memory after step: found .*float64\[3\], expected float64\[2\]"),
        ({"controller": "own_control:Raising"}, "step failed: AttributeError: .*nothing"),
        (
            {"controller": "own_control:Choosing"},
            r"autopilot.controller: own_control:Choosing: step failed: TracerBoolConversionError: .*\(own_control.py, "
            r"line \d+: if error\[0\] > 1.0:\); .* use jnp.where or jax.lax.cond in place of if",
        ),
        ({"controller": "own_control:Converting"}, r"line \d+: return memory, Wrench\(np.sin.*use jax.numpy in place"),
        ({"controller": "own_control:Rounding"}, r"line \d+: return memory, Wrench\(jnp.full.*in place of float\(\)"),
        ({"controller": "own_control:Texts"}, r"Texts.name: found str, expected a number or an array; declare"),
        ({"controller": "own_control:Halves"}, r"Halves.stiffness: found float16, expected one of float64"),
        ({"controller": "own_control:Complex"}, r"Complex.stiffness: found complex128, expected one of float64"),
        ({"controller": "own_control:Keyed"}, r"Keyed.key: found key<fry>, expected one of .* jax.random.key_data"),
        ({"controller": "own_control:Objects"}, r"Objects.things: found object, expected one of float64"),
        ({"controller": "own_control:Huge"}, r"Huge.number: found 1180591620717411303424, expected .* int64"),
        ({"controller": "own_control:Listed"}, r"Listed.axes: found list, which has no hash"),
        ({"controller": "own_control:Arrayed"}, r"Arrayed.axes: found ndarray, which has no hash"),
        ({"controller": "own_control:Remembering"}, r"memory.axes: found list, which has no hash"),
        ({"controller": "own_control:Single"}, r"step: found Wrench, expected \(memory, output\)"),
        ({"controller": "own_control:broken"}, "cannot be made: RuntimeError: no licence"),
        ({"controller": "own_control:Gravely"}, "cannot be made: TypeError: .*share"),
        ({"controller": {"block": "own_control:READY", "settings": {"a": 1}}}, "settings for a block that is made"),
        ({"controller": {"block": "own_control:Springs", "gain": 1}}, "gain.*no such key"),
        ({"allocation": "own_control:Springs"}, "allocation: own_control:Springs: step failed: AttributeError"),
        ({"controller": {"given": "own_control:Springs"}}, "a block that was handed over in Python, expected it again"),
        ({"type": "thesis", "controller": "own_control:Springs"}, "write type: model_based"),
    ],
)
def test_what_cannot_fly_is_refused_in_words_before_anything_flies(package, section, why):
    with pytest.raises(ConfigError, match=why):
        compose(scenario(section))


@pytest.mark.system
def test_by_address_by_entry_point_and_handed_over_they_fly_alike(package):
    import own_control

    found = []
    for section in ("own_control:Springs", "springs", {"block": "own_control:Springs"}, own_control.Springs()):
        flight = rovtwin.fly("square", overrides=QUICK, autopilot={"controller": section}, say=silent)
        found.append(flight.log["truth/eta"].values)
    assert np.abs(found[0][-1, :3] - found[0][0, :3]).max() > 0.2, "it did not move"
    for other in found[1:]:
        np.testing.assert_array_equal(found[0], other)


@pytest.mark.system
def test_settings_and_what_is_offered_reach_it(package):
    run = compose(scenario({"controller": {"block": "own_control:Gravely", "settings": {"share": 2.0}}}))
    assert float(run.loop.autopilot.control.stiffness) == pytest.approx(2.0 * float(run.model.inertia[0, 0]))
    assert run.loop.autopilot.guarded and not compose(scenario({"type": "model_based"})).loop.autopilot.guarded


@pytest.mark.system
def test_seeds_share_the_program_and_a_log_says_what_flew(package, tmp_path):
    rows = score_seeds(scenario({"controller": "springs"}, "duration=4"), [1, 2])
    assert len(rows) == 2
    flight = rovtwin.fly("square", tmp_path / "run", overrides=["duration=2"], autopilot=SPRINGS, say=print)
    code = {"module": "own_control", "sha256": sha256((package / "own_control.py").read_bytes()).hexdigest()}
    assert json.loads(flight.log.metadata["own_code"]) == {"springs": code | {"package": "own_control 1.0"}}
    again = load_scenario(tmp_path / "run" / "scenario.yaml")
    assert again.autopilot.controller.block == "springs" and again.autopilot == flight.scenario.autopilot


@pytest.mark.system
def test_what_is_no_number_aborts_and_turns_thrusters_off(package):
    flight = rovtwin.fly(
        "square", overrides=QUICK, autopilot={"controller": "own_control:Failing"}, say=lambda line: None
    )
    command, t = flight.log["autopilot/command"].values, flight.log["autopilot/command"].t
    assert np.isfinite(command).all()
    assert np.abs(command[t < 2.9]).max() > 0.0 and (command[t > 3.05] == 0.0).all()
    assert flight.log["autopilot/mode"].values[-1, 0] == ABORTED and "not a number" in str(flight.figures["reason"])
    assert flight.figures["why"] == f"autopilot.controller: own_control:Failing gave {NO_NUMBER} 3.00 s"
    assert REASONS[NOT_A_NUMBER] == "not a number"


def ticks(autopilot, run, requests, memory=None):
    """Memory, commands and outputs of an autopilot that gets no readings, one tick a request."""
    step = jax.jit(lambda memory, input: autopilot.step(memory, input, run.scenario.control_dt))
    memory, outputs = memory or autopilot.init(run.key, run.start), []
    for request in requests:
        memory, output = step(memory, AutopilotInput(run.loop.twin.empty(), jnp.asarray(request)))
        outputs.append(output)
    return memory, np.array([output.command.u for output in outputs]), outputs


@pytest.mark.system
def test_thrusters_are_off_whatever_an_allocation_gives(package):
    run = compose(scenario({"allocation": "own_control:Biased"}))
    _, u, _ = ticks(run.loop.autopilot, run, [PAUSE, PAUSE, NO_REQUEST, NO_REQUEST, ABORT, NO_REQUEST])
    assert (u[:2] == 0.0).all(), "idle"
    assert (u[2:4] == 0.3).all()
    assert (u[4:] == 0.0).all(), "aborted"


@pytest.mark.system
def test_once_no_number_aborts_leaves_the_estimate_and_can_be_armed_again(package):
    run = compose(scenario({"controller": "own_control:Once"}))
    autopilot, at = run.loop.autopilot, round(1.0 / run.scenario.control_dt)
    memory, u, outputs = ticks(autopilot, run, [NO_REQUEST] * (at + 5))
    assert (u[at - 1] != 0.0).any() and (u[at:] == 0.0).all()
    last = outputs[-1]
    assert int(last.setpoint.phase) == ABORTED and int(last.setpoint.reason) == NOT_A_NUMBER
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(outputs))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(memory.control))
    # The clock of the block stood still before the bad tick: put it past that.
    memory = eqx.tree_at(lambda m: m.control, memory, jnp.array([2.0, 0.0]))
    _, u, outputs = ticks(autopilot, run, [ARM, NO_REQUEST, NO_REQUEST], memory)
    assert [int(output.setpoint.phase) for output in outputs] == [PAUSED] * 3 and (u != 0.0).any(axis=1).all()


@pytest.mark.system
def test_the_console_starts_again_after_one_that_was_no_number(package):
    section = {"controller": "own_control:Once"}
    run = compose(scenario(section))
    helm = Helm(run, run.scenario)
    for again in (helm.start, helm.pilot, helm.start):
        again()
        u = np.array([helm.tick([], (0.0, 0.0, 0.0)).u for _ in range(55)])
        assert (u[:50] != 0.0).any(axis=1).all() and (u[50:] == 0.0).all()
        assert int(helm.output.setpoint.reason) == NOT_A_NUMBER


@pytest.mark.system
def test_a_force_that_is_no_number_is_named(package):
    square = load_scenario("square").model_dump(mode="json")
    world = square["world"] | {"forces": ["own_control:Breeze", "own_control:Gust"]}
    flight = rovtwin.fly(rovtwin.load_scenario(square | {"world": world}, ["duration=8", "log.rate=10"]), say=silent)
    assert not flight.completed and flight.figures["reason"] == (
        f"world.forces[1]: own_control:Gust gave {NO_NUMBER} 2.02 s"
    )
    assert flight.log["autopilot/mode"].values[-1, 1] == SENSOR_SILENT, "as the page says"
    command = flight.log["autopilot/command"].values
    assert np.isfinite(command).all()


@pytest.mark.system
def test_a_whole_autopilot(package, tmp_path):
    """One's own block in place of all: here ours with another spring."""
    mine = compose(scenario({"controller": "springs"})).loop.autopilot
    flight = rovtwin.fly("square", tmp_path / "run", overrides=QUICK, autopilot=mine, say=silent)
    named = rovtwin.fly("square", overrides=QUICK, autopilot=SPRINGS, say=silent)
    np.testing.assert_array_equal(flight.log["truth/eta"].values, named.log["truth/eta"].values)
    with pytest.raises(ConfigError, match="handed over in Python, expected it again"):
        compose(load_scenario(tmp_path / "run" / "scenario.yaml"))
    with pytest.raises(ConfigError, match="own_control:Springs: step failed: AttributeError"):
        rovtwin.fly("square", autopilot=sys.modules["own_control"].READY)


@pytest.mark.system
def test_an_observer_whose_estimate_is_no_number_is_named(package):
    section = {"observer": "own_control:Lost", "controller": "springs"}
    flight = rovtwin.fly("square", overrides=QUICK, autopilot=section, say=silent)
    assert flight.figures["reason"] == "not a number"
    assert flight.figures["why"].startswith(f"autopilot.observer: own_control:Lost gave {NO_NUMBER} 1.0")


@pytest.mark.system
def test_a_whole_autopilot_that_gives_no_number_is_turned_off(package):
    """In the same tick, as a single block; its command is cut, and who arms again tries it again."""
    import own_control

    run = compose(scenario({"type": "model_based"}))
    memory, input = run.loop.autopilot.init(run.key, run.start), AutopilotInput(run.loop.twin.empty(), jnp.asarray(0))
    _, form = jax.eval_shape(lambda m, i: run.loop.autopilot.step(m, i, run.scenario.control_dt), memory, input)
    mine = own_control.Whole(jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), form))
    autopilot, at = Guarded(mine), round(1.0 / run.scenario.control_dt)
    memory, u, outputs = ticks(autopilot, run, [NO_REQUEST] * (at + 5))
    assert (u[:at] == 1.0).all() and (u[at:] == 0.0).all()
    assert int(outputs[-1].setpoint.phase) == ABORTED and int(outputs[-1].setpoint.reason) == NOT_A_NUMBER
    assert float(memory.autopilot) == pytest.approx(1.0), "its clock stands still"
    memory = eqx.tree_at(lambda m: m.autopilot, memory, jnp.asarray(2.0))
    _, u, outputs = ticks(autopilot, run, [ARM, NO_REQUEST], memory)
    assert int(outputs[-1].setpoint.phase) != ABORTED and (u == 1.0).all()
    flight = rovtwin.fly("square", overrides=QUICK, autopilot=mine, say=silent)
    assert flight.figures["why"] == f"autopilot: own_control:Whole gave {NO_NUMBER} 1.00 s"
    assert flight.log["autopilot/mode"].values[-1, 0] == ABORTED


def test_tuning_is_refused(package):
    with pytest.raises(ConfigError, match="autopilot.controller: found springs, expected none of your own"):
        rovtwin.tune(scenario({"controller": "springs"}))


@pytest.mark.slow
def test_the_command_line_finds_the_file_beside_it(package, tmp_path):
    """In the folder where it is called, as python does; `--set` names it."""
    (tmp_path / "beside.py").write_text((package / "own_control.py").read_text())
    words = ["fly", "square", "--set", "autopilot.controller=beside:Springs", "--set", "duration=1", "--no-report"]
    code = "import sys; sys.path.remove(''); from rovtwin.cli import main; main()"
    env = os.environ | {"PYTHONPATH": str(Path(rovtwin.__file__).parents[1]), VARIABLE: ""}
    done = subprocess.run(
        [sys.executable, "-c", code, *words, "--out", "run"], cwd=tmp_path, env=env, capture_output=True, text=True
    )
    assert done.returncode == 1 and (tmp_path / "run" / "log.mcap").is_file(), done.stderr


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"autopilot": {"type": "model_based", "controller": "own_control:Springs"}}, "autopilot.controller"),
        ({"world": {"forces": ["own_control:Springs"]}}, r"world.forces\[0\]"),
        ({"sensors": {"murk": {"kind": "own_control:Springs"}}}, "sensors.murk.kind"),
    ],
)
def test_what_a_console_would_run_is_asked_for_before_it_starts(package, monkeypatch, change, where):
    from rovtwin.runs.compose.own_blocks import require_own_code

    monkeypatch.setenv(VARIABLE, "")
    scenario = rovtwin.load_scenario(load_scenario("square").model_dump(mode="json", exclude_unset=True) | change)
    with pytest.raises(ConfigError, match=f"square: {where}: names code, own_control:Springs"):
        require_own_code(scenario)
    monkeypatch.setenv(VARIABLE, "own_control:Springs")
    require_own_code(scenario)
