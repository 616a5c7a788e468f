"""Code that a scenario's file names runs with consent only, and nothing but makers of blocks is called."""

import sys

import pytest
import yaml

import rovtwin
import rovtwin.cli
from rovtwin._version import __version__
from rovtwin.campaign.flying import fly_samples
from rovtwin.campaign.schema import Campaign, complete
from rovtwin.campaign.workers import Dask
from rovtwin.core.errors import ConfigError
from rovtwin.core.trust import VARIABLE, consent
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import load_scenario

SOURCE = """
from functools import partial
from os import system
from pathlib import Path
from subprocess import getoutput

import jax.numpy as jnp
import rovtwin

Path("imported").touch()


class Calm(rovtwin.Block):
    def init(self, key, start):
        return None

    def step(self, memory, input, dt):
        return memory, jnp.zeros(6)


def calm():
    return Calm()


touch = partial(system, "touch called")
TEXT = "text"
"""
CALLS = {"system": {"command": "touch called"}, "getoutput": {"cmd": "touch called"}, "touch": {}, "TEXT": {}}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working directory, with a module that leaves a mark when it is imported; nothing is consented to."""
    monkeypatch.setenv(VARIABLE, "")
    monkeypatch.setattr(sys, "path", [one for one in sys.path if one])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "calm_water.py").write_text(SOURCE)
    yield tmp_path
    sys.modules.pop("calm_water", None)


def written(*forces) -> str:
    """A scenario's file with these forces."""
    with open("mine.yaml", "w") as file:
        yaml.safe_dump({"mission": "square", "world": {"forces": list(forces)}}, file)
    return "mine.yaml"


def run(capsys, *words: str) -> tuple[int, str]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["rovtwin", *words])
        with pytest.raises(SystemExit) as stopped:
            rovtwin.cli.main()
    return int(stopped.value.code or 0), capsys.readouterr().err


@pytest.mark.parametrize("consented", ["", "1", "os:system"])
def test_a_command_of_the_system_is_no_force(folder, monkeypatch, consented):
    monkeypatch.setenv(VARIABLE, consented)
    file = written({"block": "os:system", "settings": {"command": "touch called"}})
    with pytest.raises(ConfigError, match=r"mine: world.forces\[0\]: found os:system, a part of Python itself"):
        compose(load_scenario(file))
    assert not (folder / "called").exists()


@pytest.mark.parametrize("name", list(CALLS))
def test_nothing_but_a_maker_of_blocks_is_called(folder, monkeypatch, name):
    monkeypatch.setenv(VARIABLE, "1")
    file = written({"block": f"calm_water:{name}", "settings": CALLS[name]})
    with pytest.raises(ConfigError, match=f"calm_water:{name}: found .*, expected a rovtwin.Block .*calm_water itself"):
        compose(load_scenario(file))
    assert not (folder / "called").exists()


@pytest.mark.parametrize(
    "section",
    [{"world": {"forces": ["calm_water:Calm"]}}, {"autopilot": {"controller": "calm_water:Calm"}}],
)
def test_without_consent_nothing_is_imported(folder, section):
    (folder / "mine.yaml").write_text(yaml.safe_dump({"mission": "square", **section}))
    why = r"mine: (world.forces\[0\]|autopilot.controller): names code, calm_water:Calm, which would be run.*consent"
    with pytest.raises(ConfigError, match=why):
        compose(load_scenario("mine.yaml"))
    with pytest.raises(ConfigError, match="names code"):
        compose(rovtwin.load_scenario(yaml.safe_load((folder / "mine.yaml").read_text()) | {"name": "mine"}))
    assert "calm_water" not in sys.modules and not (folder / "imported").exists()


@pytest.mark.parametrize("consented", ["1", "calm_water:Calm", "a:B, calm_water:Calm"])
def test_with_consent_it_is_composed_and_the_folder_leaves_the_path(folder, monkeypatch, consented):
    monkeypatch.setenv(VARIABLE, consented)
    before = list(sys.path)
    assert len(compose(load_scenario(written("calm_water:Calm"))).loop.twin.world.forces) == 1
    assert (folder / "imported").exists() and sys.path == before
    if consented != "1":
        with pytest.raises(ConfigError, match="names code, calm_water:calm, which"):
            compose(load_scenario(written("calm_water:calm")))


def test_what_is_named_by_hand_needs_no_more_consent(folder):
    scenario = load_scenario("square", ["world.forces=[{block: 'calm_water:calm'}]"])
    assert len(compose(scenario).loop.twin.world.forces) == 1
    with pytest.raises(ConfigError, match="found no module 'nowhere'"):
        rovtwin.fly("square", autopilot={"controller": {"block": "nowhere:Found"}})
    assert consent() == "calm_water:calm,nowhere:Found"
    # A file that --set names is a file.
    (folder / "pilot.yaml").write_text("controller: calm_water:Calm\n")
    with pytest.raises(ConfigError, match="names code, calm_water:Calm, which"):
        compose(load_scenario("square", ["autopilot=pilot.yaml"]))


def test_the_commands_ask_for_consent(folder, capsys):
    file = written("calm_water:Calm")
    for words in (["scenario", "check", file], ["sea", file], ["fly", file, "--no-report"]):
        code, err = run(capsys, *words)
        assert code == 2 and "rovtwin --trust-code COMMAND" in err, words
    assert not (folder / "imported").exists()
    code, err = run(capsys, "scenario", "check", "square", "--set", "world.forces=[calm_water:Calm]")
    assert code == 0, err
    code, err = run(capsys, "--trust-code", "scenario", "check", written("calm_water:calm"))
    assert code == 0 and consent() == "1", err


def test_workers_of_a_campaign_have_the_consent_of_who_began_it():
    scenario = load_scenario("square").model_dump(mode="json")
    scenario["world"]["forces"] = ["nowhere:Found"]
    text = complete(Campaign(scenario=scenario, samples=1)).model_dump_json()
    (refused,) = fly_samples(text, [0], 1, __version__)
    assert "names code, nowhere:Found" in refused["reason"]
    (tried,) = fly_samples(text, [0], 1, __version__, consent="nowhere:Found")
    assert "found no module 'nowhere'" in tried["reason"] and consent() == "nowhere:Found"

    class Client:
        def nthreads(self):
            return {}

        def submit(self, *work, **options):
            raise InterruptedError(options["consent"])

        def cancel(self, futures, force): ...

    with pytest.raises(InterruptedError, match="nowhere:Found"):
        list(Dask(Client(), "").fly(text, [[0]], 1, lambda: False))
