"""The served twin answers as ArduSub's firmware does: the same questions to both, what the firmware said is recorded.

`firmware_talk` made the recording, of ArduSub 4.5.0-beta1 (with its pilot-input fail-safe, which simulation leaves out)
and 4.7.0-dev, compiled without CAN, networking and scripting and run with the vehicle
that they simulate themselves. The twin is a 4.5.
"""

import json
import re
import threading
from functools import partial

import numpy as np
import pytest
from tests.links.mavlink.firmware_questions import GUIDED, IN_GUIDED, MANUAL, MODES, QUESTIONS, SET_MODE, STICKS, long
from tests.links.mavlink.firmware_talk import RECORD, Line, shape
from tests.links.mavlink.vehicle import endpoint, measured, soon
from tests.links.serving import serving

from rovtwin.core.flow import Measurement
from rovtwin.links.mavlink.firmware.autopilot import Autopilot
from rovtwin.links.mavlink.firmware.parameters import Parameters
from rovtwin.links.mavlink.firmware.pilot import Sticks, pulses_of_sticks
from rovtwin.links.mavlink.modes import REFUSED
from rovtwin.links.mavlink.telemetry.streams import STREAMS

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'rovtwin[mavlink]'")

FIRMWARE = json.loads(RECORD.read_text())
OURS = FIRMWARE["4.5.0"]
TEXTS = ("STATUSTEXT",)  # the twin says things in its own words
NOT_THERE = "the twin has none: refused, where ArduSub takes what then does nothing, or fails"
SAYS_SO = "it answers, where ArduSub is silent"
# Questions that the twin answers otherwise, and why.
DELIBERATE = {
    "target by message": "refused while there is no target; ArduSub accepts and sends nothing",
    "turn out of guided": "refused, since it does nothing there; ArduSub accepts it",
    "speed": "its speeds in GUIDED are not settable",
    "motor test without preparation": NOT_THERE,
    "fence on": "nothing watches over fences here",
    "gripper": NOT_THERE,
    "relay": NOT_THERE,
    "servo": NOT_THERE,
    "camera trigger": NOT_THERE,
    "gimbal pitch and yaw": NOT_THERE,
    "mount control": NOT_THERE,
    "compass calibration cancelled": NOT_THERE,
    "fixed yaw compass calibration": NOT_THERE,
    "storage": NOT_THERE,
    "roi": NOT_THERE,
    "ping": SAYS_SO,
    "no such item": "4.5 repeats the count first; 4.7 says MAV_MISSION_INVALID_SEQUENCE",
    "current of no such item": SAYS_SO,
    "part of a mission": "said to be not supported; ArduSub takes parts of what is there",
    "shell": SAYS_SO,
    "command for another component": "there is no such component; ArduSub answers for all",
}
DELIBERATE_GUIDED = {
    "speed": "its speeds in GUIDED are not settable",
    "reposition": "4.7 has DO_REPOSITION, by COMMAND_INT, 4.5 has not",
    "reposition in no frame": "as 4.7",
    "reposition out of guided": "as 4.7",
    "reposition to guided": "as 4.7",
}
# Messages of a stream that the twin does not send, and why.
NOT_STREAMED = {
    "SCALED_IMU3": "a third imu of the simulation",
    "SCALED_PRESSURE3": "a thermometer of the simulation",
    "SIMSTATE": "of ArduPilot's simulation",
    "STATUSTEXT": "no stream",
}


class Asked:
    """A served vehicle that stands still, and a line to it."""

    def __init__(self, line, served):
        self.line, self.served, self._number = line, served, 0

    def answers(self, ask):
        """What comes before the answer to a ping that is sent after the question."""
        self._number += 1
        ask(self.line.mav)
        self.line.mav.ping_send(0, 1000 + self._number, 0, 0)

        def last(m):
            return m.get_type() == "PING" and m.seq == 1000 + self._number

        found = self.line.listen(3.0, last)
        assert found and last(found[-1][1]), "the endpoint is silent"
        return [shape(m) for _, m in found[:-1] if m.get_type() not in ("HEARTBEAT", *TEXTS)]


def shows(pulses, message):
    """Whether it is RC_CHANNELS with these pulses."""
    return message.get_type() == "RC_CHANNELS" and [getattr(message, f"chan{i}_raw") for i in range(1, 13)] == pulses


@pytest.fixture(scope="module")
def asked():
    server = endpoint(rates={"HOME_POSITION": 0.0})
    with serving(server) as served:
        assert soon(lambda: bool(served.messages))
        line = Line(f"udpout:127.0.0.1:{server.udp_port}")
        served.feed(1.0, measured(1.0, estimate=True))
        line.listen(0.6)
        yield Asked(line, served)
        line.close()


def of_firmware(answers):
    """What the firmware answered, without texts and streams that it sent meanwhile."""
    return [answer for answer in answers if answer[0] not in TEXTS]


def without_streams(answers):
    """Answers without the repeats of a stream that was asked for: how many come is a matter of time."""
    return [answer for k, answer in enumerate(answers) if len(answer) > 1 or answer not in answers[:k]]


def compared(asked, questions, recorded, deliberate):
    """Questions that are answered otherwise than by the firmware but not for a reason, and reasons without need."""
    wrong, needless = {}, []
    for name, ask in questions.items():
        ours, theirs = asked.answers(ask), of_firmware(recorded[name])
        alike = without_streams(ours) == without_streams(theirs)
        if name in deliberate:
            needless += [name] if alike else []
        elif not alike:
            wrong[name] = (ours, theirs)
    return wrong, needless


def test_questions_are_answered_as_by_the_firmware(asked):
    # Streams need new readings: the twin repeats none. A feed that goes on would mix them into other answers.
    streamed = {name: ask for name, ask in QUESTIONS.items() if not name.startswith("interval")}
    assert compared(asked, streamed, OURS["questions"], DELIBERATE) == ({}, [])


@pytest.mark.parametrize("name", [name for name in QUESTIONS if name.startswith("interval")])
def test_intervals_are_acknowledged_as_by_the_firmware(asked, name):
    def acknowledged(answers):
        return [a for a in answers if a[0] in ("COMMAND_ACK", "MESSAGE_INTERVAL")]

    assert acknowledged(asked.answers(QUESTIONS[name])) == acknowledged(OURS["questions"][name])


def test_guided_is_answered_as_by_the_firmware(asked):
    assert asked.answers(long(SET_MODE, 1, GUIDED)) == [["COMMAND_ACK", SET_MODE, 0]]
    assert compared(asked, IN_GUIDED, OURS["guided"], DELIBERATE_GUIDED) == ({}, [])


@pytest.mark.parametrize("mode", MODES)
def test_modes_are_taken_as_by_the_firmware(asked, mode):
    asked.answers(long(SET_MODE, 1, MANUAL))
    theirs = of_firmware(OURS["modes disarmed"][str(mode)]["answers"])
    expected = [["COMMAND_ACK", SET_MODE, 4]] if mode in REFUSED else theirs  # what is not flown here says why
    assert asked.answers(long(SET_MODE, 1, mode)) == expected


NO_PLACE = {
    "no sensor": [],
    "an estimate, which a served twin always has": [Measurement("estimate", np.zeros(12), 1.0)],
    "a position of long ago": [Measurement("position", np.zeros(2), -30.0)],
}


@pytest.mark.parametrize("more", NO_PLACE.values(), ids=NO_PLACE)
def test_modes_without_a_place_are_refused_as_by_the_firmware(more):
    bare = [m for m in measured(1.0) if m.sensor not in ("position", "dvl", "estimate")] + more
    server = endpoint(rates={"HOME_POSITION": 0.0})
    with serving(server) as served:
        assert soon(lambda: bool(served.messages))
        line = Line(f"udpout:127.0.0.1:{server.udp_port}")
        served.feed(1.0, bare)
        line.listen(0.3)
        asked = Asked(line, served)
        for mode, answers in OURS["without position"].items():
            if int(mode) not in REFUSED:
                assert asked.answers(long(SET_MODE, 1, int(mode))) == of_firmware(answers), mode
        line.close()


@pytest.mark.parametrize("version", FIRMWARE)
@pytest.mark.parametrize("name", STICKS)
def test_pulses_are_the_firmwares(version, name):
    x, y, z, r, _, _, bits, s, t = STICKS[name]
    gain = FIRMWARE[version]["parameters"]["values"]["JS_GAIN_DEFAULT"][0]
    pulses = pulses_of_sticks(Sticks(x, y, z, r, s, t, bits), gain)
    assert pulses is not None and pulses.tolist() == FIRMWARE[version]["channels"][name][:6]


def test_channels_of_the_twin_are_the_firmwares(asked):
    over = threading.Event()

    def feed():
        for k in range(10_000):
            if over.wait(0.02):
                return
            asked.served.feed(2.0 + 0.02 * k, measured(2.0 + 0.02 * k, estimate=True))

    thread = threading.Thread(target=feed)
    thread.start()
    asked.answers(long(511, 65, 20000))
    for name, expected in OURS["channels"].items():
        asked.line.mav.manual_control_send(1, *STICKS[name])
        same = partial(shows, expected)
        assert same(asked.line.listen(2.0, same)[-1][1]), name
    over.set()
    thread.join()


@pytest.mark.parametrize("stream", OURS["streams"])
def test_streams_have_the_firmwares_messages(stream):
    theirs = set(OURS["streams"][stream]) - NOT_STREAMED.keys()
    assert theirs <= set(STREAMS[int(stream)])


def seconds(part, text):
    """When something was said after a pilot or all of the ground station had fallen silent [s]."""
    return next(event[0] for event in OURS[part]["events"] if text in str(event[-1]))


@pytest.mark.parametrize(
    ("part", "text", "beats"),
    [("sticks cease", "Lost manual control", True), ("all ceases", "heartbeat lost", False)],
)
def test_time_to_thrusters_off_is_the_firmwares(part, text, beats):
    texts = []
    pilot = Autopilot(Parameters(1, 0.5, 1000.0), lambda _, words: texts.append(words))
    pilot.arm(255, 0.0, "")
    off, last = None, 0.0
    for now in np.arange(0.0, 5.0, 0.05):
        if beats and now - last > 0.5:
            pilot.heartbeat(255, now)
            last = now
        pilot.check(now)
        off = now if off is None and not pilot.armed else off
    assert off == pytest.approx(seconds(part, text), abs=0.2)
    assert any(text in words for words in texts)


def test_sticks_alone_are_a_sign_of_life_as_for_the_firmware():
    assert OURS["heartbeats cease"]["events"] == []
    pilot = Autopilot(Parameters(1, 0.5, 1000.0), lambda *_: None)
    pilot.arm(255, 0.0, "")
    for now in np.arange(0.0, 12.0, 0.1):
        pilot.steer(255, np.zeros(6), now)
        pilot.check(now)
    assert pilot.armed


def test_sticks_that_cease_disarm_in_guided_too_as_with_the_firmware():
    off = seconds("sticks cease in guided", "Lost manual control")
    pilot = Autopilot(Parameters(1, 0.5, 1000.0), lambda *_: None)
    assert pilot.set_mode(GUIDED)
    pilot.arm(255, 0.0, "")
    pilot.steer(255, np.zeros(6), 0.0)
    for now, armed in ((off - 0.3, True), (off + 0.3, False)):
        pilot.heartbeat(255, now)
        pilot.check(now)
        assert pilot.armed is armed


def test_without_any_sticks_the_twin_is_stricter_than_the_firmware():
    """ArduSub waits for ever for a pilot whom it never heard; the twin disarms, but in GUIDED."""
    assert OURS["no sticks"] == {"armed": True}
    for mode, armed in ((MANUAL, False), (GUIDED, True)):
        pilot = Autopilot(Parameters(1, 0.5, 1000.0), lambda *_: None)
        assert pilot.set_mode(mode)
        pilot.arm(255, 0.0, "")
        pilot.heartbeat(255, 3.1)
        pilot.check(3.1)
        assert pilot.armed is armed


def test_our_parameters_are_the_firmwares():
    theirs = OURS["parameters"]["values"]
    added = {"FS_GCS_TIMEOUT"}  # of 4.7
    for parameter in Parameters(1, 0.5, 1000.0).listed():
        if parameter.name not in added:
            assert theirs[parameter.name][1] == parameter.kind, parameter.name
            assert theirs[parameter.name][0] == pytest.approx(parameter.value), parameter.name


def test_the_record_is_small_and_names_no_place():
    text = RECORD.read_text()
    assert len(text) < 200_000 and not re.search(r"/(tmp|work|home)/", text)
    assert set(FIRMWARE) == {"4.5.0", "4.7.0"}
