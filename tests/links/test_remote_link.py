"""A link in a process of its own: whatever becomes of the autopilot, the vehicle's thrusters end at rest."""

import os
import signal
import socket
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from tests.links.vehicles import Opener, PlainLink, ThreadHosted, last_sent, moving, resting

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command
from rovtwin.core.link import COMMAND_LIFE
from rovtwin.links import host
from rovtwin.links.remote_link import RemoteLink

REPOSITORY = Path(__file__).parents[2]


def wait_for(condition, seconds=5.0):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "it never happened"
        time.sleep(0.005)


def test_a_vehicle_that_cannot_be_reached_says_why():
    with pytest.raises(LinkError, match="no route to the moon"):
        RemoteLink(Opener(refuses="no route to the moon"), 3)


def test_a_process_that_is_not_up_in_time_is_not_laid_on_the_vehicle():
    """Seen on a busy machine, where the vehicle was on all the time."""
    with pytest.raises(LinkError, match="the vehicle was not asked"):
        RemoteLink(Opener(), 3, patience=0.01)


def test_a_vehicle_that_is_lost_in_flight_is_an_error_at_the_next_read(tmp_path):
    with RemoteLink(Opener(tmp_path / "told", dies_after=0.2), 3) as link, pytest.raises(LinkError, match="gone"):
        until = time.monotonic() + 5.0
        while time.monotonic() < until:
            link.read()
            time.sleep(0.01)
    assert resting(tmp_path / "told")


# Whoever runs the tests may ignore signals, as nohup and background jobs do; a user's autopilot does not.
FLIES = """
    import signal, sys, time
    from pathlib import Path
    import numpy as np
    from tests.links.vehicles import Opener
    from rovtwin.core.flow import Command
    from rovtwin.links.remote_link import RemoteLink

    if __name__ == "__main__":
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number in (signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        told = Path(sys.argv[1])
        with RemoteLink(Opener(told), 3, told.with_name("stop")) as link:
            while True:
                link.send(Command(np.full(3, 0.5)))
                link.read()
                time.sleep(0.01)
                if len(sys.argv) > 2 and told.exists() and time.monotonic() > float(sys.argv[2]):
                    1 / 0
"""


@pytest.mark.system
@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGTERM, signal.SIGQUIT, signal.SIGKILL])
def test_a_terminal_that_is_closed_reaches_all_and_leaves_no_thrust(tmp_path, number):
    """A signal to the whole group of processes, as a dropped ssh or a shutdown sends it."""
    rests_after(lambda process: os.killpg(process.pid, number), tmp_path, new_session=True)


@pytest.mark.system
def test_a_host_that_hangs_holds_nobody_up(tmp_path):
    """Commands are not received then, but sending, stopping and closing return, and closing kills it."""
    link = RemoteLink(Opener(tmp_path / "told"), 3)
    os.kill(link.pid, signal.SIGSTOP)
    began = time.monotonic()
    for _ in range(5000):
        link.send(Command(np.full(3, 0.5)))
    link.stop()
    assert time.monotonic() - began < 2.0
    link.close()
    assert time.monotonic() - began < 6.0
    assert not link._process.is_alive()


def test_a_stop_that_a_hung_host_had_no_room_for_arrives_when_it_goes_on(tmp_path):
    reported = tmp_path / "told"
    with RemoteLink(Opener(reported), 3) as link:
        os.kill(link.pid, signal.SIGSTOP)
        while host.writable(link._pipe):
            link.send(Command(np.full(3, 0.5)))
        pressed = time.monotonic()
        link.stop()
        os.kill(link.pid, signal.SIGCONT)
        wait_for(lambda: link.read() is not None and link.stopped_at > pressed)
        assert resting(reported)


def flying(tmp_path, *arguments, new_session=False):
    """An autopilot in a process of its own that flies a vehicle in another."""
    script = tmp_path / "flies.py"
    script.write_text(textwrap.dedent(FLIES))
    environment = os.environ | {"PYTHONPATH": f"{REPOSITORY / 'src'}:{REPOSITORY}"}
    return subprocess.Popen(
        [sys.executable, script, tmp_path / "told", *arguments],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=new_session,
    )


def rests_after(strike, tmp_path, new_session=False):
    """The thrusters of a vehicle that flies are off in time after its autopilot was struck."""
    reported = tmp_path / "told"
    process = flying(tmp_path, new_session=new_session)
    try:
        wait_for(lambda: moving(reported), 30.0)
        strike(process)
        struck = time.monotonic()
        wait_for(lambda: resting(reported))
        assert last_sent(reported)[0] - struck < COMMAND_LIFE + 0.2
    finally:
        process.kill()
        process.communicate()


@pytest.mark.system
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM, signal.SIGINT])
def test_an_autopilot_that_is_killed_or_hangs_leaves_no_thrust(tmp_path, number):
    """Killed -9, terminated, interrupted, or stopped so that it no longer answers, and still holds the pipe."""
    rests_after(lambda process: process.send_signal(number), tmp_path)


@pytest.mark.system
def test_an_exception_in_the_autopilot_leaves_no_thrust(tmp_path):
    reported = tmp_path / "told"
    process = flying(tmp_path, str(time.monotonic() + 1.0))
    _, error = process.communicate(timeout=60)
    assert "ZeroDivisionError" in error
    assert resting(reported)


def test_a_computer_that_slept_flies_nothing_on(tmp_path, monkeypatch):
    """A lid that was closed: the clock that counts sleep has gone on, the other one has not."""
    slept = [0.0]
    monkeypatch.setattr(host, "_asleep", lambda: slept[0])
    reported = tmp_path / "told"
    with ThreadHosted(Opener(reported), 3) as link:
        link.send(Command(np.full(3, 0.5)))
        wait_for(lambda: moving(reported))
        slept[0] = 60.0
        with pytest.raises(LinkError, match="slept for 60 s"):
            while True:
                link.send(Command(np.full(3, 0.5)))
                link.read()
                time.sleep(0.01)
    assert resting(reported)


@pytest.mark.system
def test_an_autopilot_that_does_not_read_is_still_obeyed_and_memory_is_bounded(tmp_path, monkeypatch):
    """The pipe fills up with readings; commands go on expiring, and the newest readings are kept."""
    monkeypatch.setattr(host, "BACKLOG", 20)
    reported = tmp_path / "told"
    with ThreadHosted(Opener(reported), 3) as link:
        for _ in range(3):
            link.send(Command(np.full(3, 0.5)))
            wait_for(lambda: moving(reported))
            wait_for(lambda: resting(reported), 2.0)


def test_a_vendors_thread_that_ends_is_reported_in_one_line(monkeypatch):
    texts = []
    monkeypatch.setattr(host.logger, "warning", lambda text, *details: texts.append(text % details))
    what = threading.ExceptHookArgs((UnicodeError, UnicodeError("no text"), None, threading.current_thread()))
    host._ended(what)
    assert len(texts) == 1 and "no text" in texts[0] and "\n" not in texts[0]


def test_age_grows_while_the_host_is_silent(tmp_path):
    with ThreadHosted(Opener(), 3) as link:
        time.sleep(0.2)
        link.read()
        assert link.age < 0.2
        before = link.age
        time.sleep(0.1)
        assert link.age >= before + 0.09


STOP_WITHIN = 0.1  # from the click at the server until the thrusters are sent zero [s]


def press_stop(folder, patience=2.0):
    """Send STOP to the host, as the console does; what it sends back."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as red:
        red.bind(str(folder / "confirmed"))
        try:
            red.settimeout(patience)
            red.sendto(b"stop 1", str(folder / "stop"))
            return red.recv(64)
        finally:
            (folder / "confirmed").unlink()


@pytest.mark.system
def test_stop_leads_past_an_autopilot_that_hangs(tmp_path):
    """Its process is stopped in mid-flight; the vehicle's host is asked itself, and answers when thrusters are off."""
    reported = tmp_path / "told"
    process = flying(tmp_path)
    try:
        wait_for(lambda: moving(reported), 30.0)
        process.send_signal(signal.SIGSTOP)
        pressed = time.monotonic()
        assert press_stop(tmp_path) == b"stop 1"
        confirmed = time.monotonic()
        assert resting(reported)
        took = last_sent(reported)[0] - pressed
        print(
            f"STOP: thrusters told zero after {1e3 * took:.2f} ms, confirmed after {1e3 * (confirmed - pressed):.2f} ms"
        )
        assert took < STOP_WITHIN and confirmed - pressed < STOP_WITHIN
        process.send_signal(signal.SIGCONT)  # it goes on sending thrust, which is not obeyed
        time.sleep(0.2)
        assert resting(reported)
    finally:
        process.kill()
        process.communicate()


@dataclass(frozen=True)
class Armable(Opener):
    """Opens a vehicle that takes its time to arm, and may be armed again after a stop, as the twin."""

    takes: float = 0.0
    stop_fails: bool = False
    limits: tuple[str, ...] = ()
    reach: float = 1.0

    def __call__(self):
        opener = self

        class Link(PlainLink):
            def arm(self):
                time.sleep(opener.takes)
                self.stopped, self.limits, self.reach = False, opener.limits, opener.reach

            def stop(self):
                if opener.stop_fails and not self.stopped:
                    raise ValueError("the driver broke")
                super().stop()

        return Link(self.sent)


def fly_on(link, over=None):
    """Send thrust until something is so, or for a while, as an autopilot does that has not received a stop."""
    until = time.monotonic() + (0.1 if over is None else 5.0)
    while time.monotonic() < until and not (over and over()):
        link.send(Command(np.full(3, 0.5)))
        link.read()
        time.sleep(0.01)


@pytest.mark.system
def test_stop_while_arming_wins(tmp_path):
    reported = tmp_path / "told"
    with ThreadHosted(Armable(reported, takes=0.6), 3, tmp_path / "stop") as link:
        link.begin_arming()
        time.sleep(0.1)
        press_stop(tmp_path)
        wait_for(lambda: link.refused is not None)
        assert "stopped while it was being armed" in link.refused
        fly_on(link)
        assert resting(reported)


def test_arming_that_was_asked_for_before_a_stop_is_refused(tmp_path):
    reported = tmp_path / "told"
    with ThreadHosted(Armable(reported), 3, tmp_path / "stop") as link:
        asked_at = time.monotonic()
        press_stop(tmp_path)
        link.begin_arming(asked_at)
        wait_for(lambda: link.refused is not None)
        assert "stopped since" in link.refused
        fly_on(link)
        assert resting(reported)
        link.arm()  # asked for after it
        fly_on(link, lambda: moving(reported))
        assert moving(reported)


def test_what_the_vehicle_does_not_take_is_known_once_it_is_armed(tmp_path):
    with ThreadHosted(Armable(tmp_path / "log", limits=("the gain is 0.5",), reach=0.5), 3, tmp_path / "stop") as link:
        assert link.limits == () and link.reach == 1.0
        link.arm()
        assert link.limits == ("the gain is 0.5",) and link.reach == 0.5


def test_stop_holds_though_the_driver_fails_at_it_and_is_received_again(tmp_path):
    """Zeros go out by the other way; the thread that listens lives on."""
    reported = tmp_path / "told"
    with ThreadHosted(Armable(reported, stop_fails=True), 3, tmp_path / "stop") as link:
        fly_on(link, lambda: moving(reported))
        assert moving(reported)
        pressed = time.monotonic()
        for _ in range(2):
            with pytest.raises(TimeoutError):  # nothing to confirm
                press_stop(tmp_path, 0.1)
        fly_on(link, lambda: link.stopped_at > pressed + 0.1)  # of the second
        assert resting(reported) and link.stopped_at > pressed + 0.1
