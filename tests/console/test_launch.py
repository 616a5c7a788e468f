"""Finding, starting and ending engines: which process is one, and which only has its number."""

import fcntl
import json
import os
import signal
import socket
import tempfile
import threading
from pathlib import Path

import pytest

from rovtwin.console import launch, locks
from rovtwin.console.wire import LONGEST, Place
from rovtwin.core.errors import ConfigError
from rovtwin.scenario.files import load_scenario


@pytest.fixture
def place(tmp_path):
    return Place(tmp_path)


def note(place, pid):
    place.note.write_text(json.dumps({"pid": pid, "scenario": "calm", "link": "twin://"}))


def test_the_number_of_a_killed_engine_is_nobody(place, monkeypatch):
    """It left its note and its lock's file; its number is that of another process now, which must not be ended."""
    note(place, os.getpid())
    place.lock.touch()
    killed = []
    monkeypatch.setattr(os, "kill", lambda *what: killed.append(what))
    assert launch.running(place) is None
    launch.end(place)
    assert killed == []


def test_an_engine_that_lives_is_found(place):
    note(place, 77)
    with place.lock.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert launch.running(place) == launch.Running(77, "calm", "twin://")
        place.note.write_text("{")  # half written
        assert launch.running(place) is None and launch.alive(place)
    assert not launch.alive(place)


def test_an_engine_that_does_not_end_is_killed(place, monkeypatch):
    note(place, 77)
    killed = []
    monkeypatch.setattr(os, "kill", lambda pid, number: killed.append((pid, number)))
    monkeypatch.setattr(launch, "ENDING", 0.1)
    with place.lock.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        launch.end(place)
    assert killed == [(77, launch.signal.SIGTERM), (77, launch.signal.SIGKILL)]


def test_who_looks_for_an_engine_keeps_none_from_beginning(place, monkeypatch):
    monkeypatch.setattr(locks, "TRIES", 200)
    looked = place.lock.open("w")
    fcntl.flock(looked, fcntl.LOCK_SH)
    threading.Timer(0.1, looked.close).start()
    assert locks.Lock(place.lock).take()
    assert launch.alive(place)
    monkeypatch.setattr(locks, "TRIES", 2)
    assert not locks.Lock(place.lock).take()  # a second one


def test_a_second_console_on_a_port_ends_nobodys_autopilot(monkeypatch, tmp):
    pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
    from rovtwin.cli.flight.console import console

    done = []
    monkeypatch.setattr(launch, "start", lambda *_: done.append("start"))
    monkeypatch.setattr(launch, "end", lambda *_: done.append("end"))
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(ConfigError, match=f"{port}: cannot be served at"):
            console(port=port, browser=False)
    assert done == []


def test_sigterm_ends_the_autopilot_as_ctrl_c_does(monkeypatch, tmp):
    """From systemd and docker. Without a handler the process would be gone before it ended anything."""
    pytest.importorskip("nicegui", reason="the console needs NiceGUI: pip install 'rovtwin[console]'")
    from rovtwin.cli.flight import console as module
    from rovtwin.console.web import app

    def serve(*_):
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        os.kill(os.getpid(), signal.SIGTERM)

    done = []
    monkeypatch.setattr(launch, "start", lambda *_: done.append("start"))
    monkeypatch.setattr(launch, "end", lambda *_: done.append("end"))
    monkeypatch.setattr(app, "build", lambda *_: None)
    monkeypatch.setattr(module, "_serve", serve)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(SystemExit) as ended:
        module.console(port=port, browser=False)
    assert ended.value.code == 0 and done == ["start", "end"]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_an_engine_whose_start_is_interrupted_is_ended(monkeypatch, place):
    """By Ctrl-C, or SIGTERM: it would be there with nobody who knows of it."""
    ended = []

    class Starting:
        def __init__(self, *_, **__):
            pass

        def poll(self):
            raise KeyboardInterrupt

        def kill(self):
            ended.append(self)

    monkeypatch.setattr(launch.subprocess, "Popen", Starting)
    with pytest.raises(KeyboardInterrupt):
        launch.start(place, load_scenario("square"), "twin://", [], 1.0, place.folder)
    assert len(ended) == 1


def test_a_free_port_is_free_and_stays_so():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
    launch.require_free("127.0.0.1", port)
    launch.require_free("127.0.0.1", port)


@pytest.fixture
def tmp(monkeypatch):
    """The folder for temporary files of this machine: a short path, since sockets lie in it."""
    with tempfile.TemporaryDirectory(prefix="rov", dir="/tmp") as folder:
        monkeypatch.setattr("tempfile.tempdir", folder)
        yield Path(folder)


def test_a_place_is_ones_own_and_found_again(tmp):
    place = Place.of(8800)
    assert place.folder.stat().st_mode & 0o777 == 0o700
    assert Place.of(8800) == place and Place.of(8801) != place


@pytest.mark.parametrize("kind", ["link", "open", "file", "dangling"])
def test_a_place_that_others_laid_out_is_refused(tmp, kind):
    folder = tmp / f"rovtwin-{os.getuid()}-8800"
    if kind == "link":
        (tmp / "private").mkdir(mode=0o700)
        folder.symlink_to(tmp / "private")
    elif kind == "dangling":
        folder.symlink_to(tmp / "nowhere")
    elif kind == "open":
        folder.mkdir()
        folder.chmod(0o777)
    else:
        folder.touch()
    with pytest.raises(ConfigError, match="yours alone"):
        Place.of(8800)


def test_a_place_too_deep_for_sockets_is_reported(monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", "/tmp/" + "x" * LONGEST)
    with pytest.raises(ConfigError, match="TMPDIR"):
        Place.of(8800)
