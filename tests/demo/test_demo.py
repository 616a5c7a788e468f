"""Ctrl-C in the demonstration: what is done stays, what is not is removed, and it ends with one sentence."""

from types import SimpleNamespace
from typing import Any

import pytest

from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.demo import demo
from rovtwin.runs.under_way import remove_unfinished, under_way


class NoProcess:
    """Stands in for the process beside: the payload's step is done, the camera's is half done when it is killed."""

    def __init__(self, tasks):
        self.folder = tasks[0].args[0].parent

    def __enter__(self):
        for name in ("payload", "camera"):
            (self.folder / name).mkdir(parents=True)
            (self.folder / name / "log.mcap").write_text("")
        (self.folder / "camera.unfinished").write_text("")
        return self

    def __exit__(self, *_):
        pass

    def result(self, say):
        raise AssertionError("Ctrl-C came before")


@pytest.fixture(autouse=True)
def no_process(monkeypatch):
    monkeypatch.setattr(demo, "Aside", NoProcess)


def flies(how_many, by_itself):
    """Flies so many scenarios; the next one is interrupted, in the midst of it or with a whole log."""
    left = [how_many]

    def fly(scenario, folder, truth) -> Any:
        assert folder.with_name(f"{folder.name}.unfinished").is_file()
        folder.mkdir(parents=True)
        (folder / "log.mcap").write_text("")
        left[0] -= 1
        if left[0] < 0 and not by_itself:
            raise KeyboardInterrupt
        return SimpleNamespace(figures={"interrupted": left[0] < 0}, scenario=scenario, folder=folder)

    return fly


@pytest.mark.parametrize("by_itself", [True, False])
def test_ctrl_c_keeps_what_is_done_and_removes_the_rest(tmp_path, by_itself):
    folder = tmp_path / "demo"
    with pytest.raises(RovtwinError, match=": lawnmower_waves_thesis, payload; the rest is removed"):
        demo.run_demo(folder, flies(1, by_itself))
    assert sorted(path.name for path in folder.iterdir()) == ["lawnmower_waves_thesis", "payload"]


def test_ctrl_c_at_once_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(NoProcess, "__enter__", lambda self: self)
    with pytest.raises(RovtwinError, match="no step was done"):
        demo.run_demo(tmp_path / "demo", flies(0, False))
    assert not (tmp_path / "demo").exists()


def test_ctrl_c_while_the_page_is_written_keeps_all_steps(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    (tmp_path / "flown").mkdir()
    payload = SimpleNamespace(changes=[], learnt=[])
    monkeypatch.setattr(demo, "_steps", lambda folder, fly, say: ({}, payload, "", {}))
    monkeypatch.setattr(demo, "write_comparison", interrupted)
    with pytest.raises(RovtwinError, match=": flown; the rest is removed"):
        demo.run_demo(tmp_path, flies(0, False))


def test_a_folder_that_was_there_is_not_marked_nor_removed(tmp_path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(ConfigError), under_way(tmp_path / "mine"):
        raise ConfigError("mine: exists already")
    assert remove_unfinished(tmp_path) == ["mine"]


def test_a_step_that_ends_well_or_makes_nothing_leaves_no_mark(tmp_path):
    with under_way(tmp_path / "done"):
        (tmp_path / "done").mkdir()
    with pytest.raises(ConfigError), under_way(tmp_path / "none"):
        raise ConfigError("pip install")
    assert [path.name for path in tmp_path.iterdir()] == ["done"]
