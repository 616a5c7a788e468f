"""The same questions to an ArduSub and to the served twin, and what each answers.

`python -m tests.links.mavlink.firmware_talk URL NAME ANSWERS.json` asks the autopilot at a URL in pymavlink's form, of
a simulated or real vehicle that may arm and move, and adds its answers to the file under a name. Streams are switched
off first, so that whatever comes after a question is its answer. Only the firmware's ways are kept, not where it is.
"""

import json
import os
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.links.mavlink.firmware_questions import (
    ARM,
    GUIDED,
    IN_GUIDED,
    MANUAL,
    MODES,
    QUESTIONS,
    SET_MODE,
    STICKS,
    long,
)

RECORD = Path(__file__).with_name("ardusub_answers.json")
WINDOW = 0.4  # an answer comes within this [s]
BEAT = 0.5  # between heartbeats of a ground station [s]
STICK = 0.1  # between messages of a stick [s]
# What comes by itself.
UNASKED = {"HEARTBEAT", "TIMESYNC", "BAD_DATA", "PARAM_VALUE"}
# Fields that are the answer; of what is not here only the name counts.
FIELDS = {
    "COMMAND_ACK": ("command", "result"),
    "MESSAGE_INTERVAL": ("message_id", "interval_us"),
    "MISSION_ACK": ("type", "mission_type"),
    "MISSION_COUNT": ("count", "mission_type"),
    "MISSION_REQUEST": ("seq", "mission_type"),
    "MISSION_REQUEST_INT": ("seq", "mission_type"),
    "MISSION_ITEM": ("seq", "frame", "command", "current", "mission_type"),
    "MISSION_ITEM_INT": ("seq", "frame", "command", "current", "mission_type"),
    "MISSION_CURRENT": ("seq", "total"),
    "PARAM_VALUE": ("param_id", "param_value", "param_type"),
    "STATUSTEXT": ("severity", "text"),
    "PING": ("seq", "target_system"),
}


class Line:
    """A ground station at a vehicle: heartbeats and sticks while it listens."""

    def __init__(self, url: str, system: int = 255):
        from pymavlink import mavutil

        os.environ["MAVLINK20"] = "1"  # pymavlink would begin with MAVLink 1, which has no s and t
        self._line = mavutil.mavlink_connection(
            url, source_system=system, source_component=190, dialect="ardupilotmega"
        )
        self.beats = True
        self.sticks: tuple[int, ...] | None = None
        self._beat_at = self._stick_at = 0.0

    @property
    def mav(self) -> Any:
        return self._line.mav

    def close(self) -> None:
        self._line.close()

    def listen(self, seconds: float, until: Callable[[Any], bool] = lambda message: False) -> list[tuple[float, Any]]:
        """The vehicle's messages of some seconds with their times, or up to one that ends it."""
        found, end = [], time.monotonic() + seconds
        while (now := time.monotonic()) < end:
            self._keep_up(now)
            message = self._line.recv_match(blocking=True, timeout=0.02)
            if message is None or (message.get_srcSystem(), message.get_srcComponent()) != (1, 1):
                continue
            found.append((time.monotonic(), message))
            if until(message):
                break
        return found

    def _keep_up(self, now: float) -> None:
        if self.beats and now - self._beat_at > BEAT:
            self._beat_at = now
            self.mav.heartbeat_send(6, 8, 0, 0, 0)
        if self.sticks is not None and now - self._stick_at > STICK:
            self._stick_at = now
            self.mav.manual_control_send(1, *self.sticks)

    def answers(
        self, ask: Callable[[Any], None], window: float = WINDOW, also: tuple[str, ...] = ()
    ) -> list[list[Any]]:
        """What comes after a question, as a list of names and fields; parameters only where they are asked for."""
        self.listen(0.05)
        ask(self.mav)
        kinds = UNASKED - set(also)
        return [shape(m) for _, m in self.listen(window) if m.get_type() not in kinds]

    def command(self, number: int, *values: float) -> int | None:
        """MAV_RESULT of a command, None where none comes."""
        long(number, *values)(self.mav)
        found = self.listen(2.0, lambda m: m.get_type() == "COMMAND_ACK" and m.command == number)
        return found[-1][1].result if found and found[-1][1].get_type() == "COMMAND_ACK" else None

    def quiet(self) -> None:
        """All streams off."""
        for stream in (0, 1, 2, 3, 6, 10, 11, 12):
            self.mav.request_data_stream_send(1, 1, stream, 0, 0)
        self.listen(1.0)
        for kind, number in {m.get_type(): m.get_msgId() for _, m in self.listen(2.5)}.items():
            if kind not in ("HEARTBEAT", "COMMAND_ACK", "STATUSTEXT"):
                self.command(511, number, -1)


def shape(message: Any) -> list[Any]:
    """A message as its name and the fields that count."""
    kind = message.get_type()
    values = [getattr(message, name) for name in FIELDS.get(kind, ())]
    return [kind, *(round(v, 6) if isinstance(v, float) else v for v in values)]


def questioned(line: Line) -> dict[str, Any]:
    """Answers to every question, disarmed."""
    also = {True: ("PARAM_VALUE",), False: ()}
    return {name: line.answers(ask, also=also["parameter" in name]) for name, ask in QUESTIONS.items()}


def guided(line: Line) -> dict[str, Any]:
    """Answers in GUIDED, disarmed."""
    assert line.command(SET_MODE, 1, GUIDED) == 0
    return {name: line.answers(ask) for name, ask in IN_GUIDED.items()}


def modes(line: Line, armed: bool) -> dict[str, Any]:
    """What becomes of asking for each mode from MANUAL, and the mode of the heartbeat after it."""
    found = {}
    for mode in MODES:
        assert line.command(SET_MODE, 1, MANUAL) == 0
        if armed:
            line.sticks = STICKS["neutral"]
            assert line.command(ARM, 1) == 0
        answers = line.answers(long(SET_MODE, 1, mode), 0.5)
        beats = [m for _, m in line.listen(1.3) if m.get_type() == "HEARTBEAT"]
        found[str(mode)] = {"answers": answers, "mode": beats[-1].custom_mode, "base": beats[-1].base_mode}
    line.command(SET_MODE, 1, MANUAL)
    line.command(ARM, 0)
    line.sticks = None
    return found


def channels(line: Line) -> dict[str, Any]:
    """RC channels 1 to 12 [us] of sticks, with what gain."""
    line.command(511, 65, 50000)
    found = {}
    for name, sticks in STICKS.items():
        line.sticks = sticks
        seen = [m for _, m in line.listen(0.6) if m.get_type() == "RC_CHANNELS"]
        found[name] = [getattr(seen[-1], f"chan{i}_raw") for i in range(1, 13)]
    line.sticks = None
    line.command(511, 65, -1)
    return found


def rates(line: Line, seconds: float = 10.0) -> dict[str, dict[str, float]]:
    """Messages a second of each stream at 4 Hz and of all at the usual rates [Hz]."""
    found = {}
    for stream in (1, 2, 3, 6, 10, 11, 12):
        line.mav.request_data_stream_send(1, 1, stream, 4, 1)
        line.listen(0.5)
        counts = Counter(m.get_type() for _, m in line.listen(seconds / 2.0))
        found[str(stream)] = {k: round(n / (seconds / 2.0), 1) for k, n in sorted(counts.items()) if k not in UNASKED}
        line.mav.request_data_stream_send(1, 1, stream, 0, 0)
        line.listen(0.5)
    return found


def lost(line: Line, beats: bool, sticks: bool, mode: int = MANUAL, limit: float = 12.0) -> dict[str, Any]:
    """What happens, and when [s], when heartbeats or sticks cease while it drives ahead in MANUAL, or in a mode."""
    line.beats, line.sticks = True, STICKS["ahead"]
    assert line.command(SET_MODE, 1, mode) == 0
    line.command(511, 36, 50000)
    line.command(511, 65, 50000)
    assert line.command(ARM, 1) == 0
    line.listen(2.0)
    line.beats, line.sticks = beats, STICKS["ahead"] if sticks else None
    began = time.monotonic()
    found, events, neutral, armed = line.listen(limit), [], None, True
    for at, message in found:
        kind, after = message.get_type(), round(at - began, 2)
        if kind == "STATUSTEXT":
            events.append([after, "STATUSTEXT", message.severity, message.text])
        elif kind == "HEARTBEAT" and armed and not message.base_mode & 128:
            armed = False
            events.append([after, "disarmed"])
        elif kind == "RC_CHANNELS" and neutral is None and message.chan5_raw == 1500:
            neutral = after
            events.append([after, "channel neutral"])
        elif kind == "SERVO_OUTPUT_RAW" and ["thrusters off"] not in [e[1:] for e in events]:
            if all(abs(getattr(message, f"servo{i}_raw") - 1500) < 2 for i in range(1, 9)):
                events.append([after, "thrusters off"])
    line.beats, line.sticks = True, None
    line.command(ARM, 0)
    line.command(511, 36, -1)
    line.command(511, 65, -1)
    return {"events": events}


def silent(line: Line) -> dict[str, Any]:
    """Whether it stays armed without sticks, 8 s after such as came before have ceased."""
    line.sticks = None
    line.command(SET_MODE, 1, MANUAL)
    line.listen(5.0)
    assert line.command(ARM, 1) == 0
    beats = [m for _, m in line.listen(8.0) if m.get_type() == "HEARTBEAT"]
    line.command(ARM, 0)
    return {"armed": bool(beats[-1].base_mode & 128)}


def arming(line: Line) -> dict[str, Any]:
    """Arming and disarming, and a few questions to an armed vehicle."""
    line.sticks = STICKS["neutral"]
    found = {"arm": line.answers(long(ARM, 1), 1.2), "arm again": line.answers(long(ARM, 1))}
    found["land"] = line.answers(long(21), 0.6)
    found["manual"] = line.answers(long(SET_MODE, 1, MANUAL))
    found["loiter"] = line.answers(long(17), 0.6)
    found["manual again"] = line.answers(long(SET_MODE, 1, MANUAL))
    found["gyro calibration"] = line.answers(long(241, 1))
    found["reboot"] = line.answers(long(246, 1))
    found["motor test"] = line.answers(long(209, 1, 0, 5, 1))
    line.command(ARM, 1)  # whatever the motor test has made of it
    found["disarm"] = line.answers(long(ARM, 0), 1.2)
    found["arm by force"] = line.answers(long(ARM, 1, 21196), 1.2)
    found["termination"] = line.answers(long(185, 1), 1.2)
    line.command(ARM, 0)
    line.sticks = None
    return found


def parameters(line: Line) -> dict[str, Any]:
    """What a list of all parameters is: banner, count, rate [1/s], the first names, whether it comes whole."""
    line.listen(0.1)
    began = time.monotonic()
    line.mav.param_request_list_send(1, 1)
    found = line.listen(60.0, lambda m: m.get_type() == "PARAM_VALUE" and m.param_index == m.param_count - 1)
    values = [m for _, m in found if m.get_type() == "PARAM_VALUE"]
    texts = [m.text.split("(")[0].strip() for _, m in found if m.get_type() == "STATUSTEXT"]
    seconds = time.monotonic() - began
    return {
        "banner": texts,
        "count": values[-1].param_count,
        "whole": len({m.param_index for m in values}) == values[-1].param_count,
        "in_order": [m.param_index for m in values] == sorted(m.param_index for m in values),
        "per_second": round(len(values) / seconds),
        "first": [m.param_id for m in values[:6]],
        "values": {
            m.param_id: [round(m.param_value, 5), m.param_type]
            for m in values
            if m.param_id.startswith(("FS_", "JS_", "SYSID_", "MAV_", "FRAME_", "BARO_SPEC", "ARMING_"))
        },
    }


def placeless(line: Line) -> dict[str, Any]:
    """Answers to modes while the vehicle does not know where it is; to be asked for by name."""
    return {str(mode): line.answers(long(SET_MODE, 1, mode)) for mode in (0, 2, 3, 4, 7, 9, 16, 21, MANUAL)}


PARTS: dict[str, Callable[[Line], Any]] = {
    "parameters": parameters,
    "questions": questioned,
    "channels": channels,
    "guided": guided,
    "arming": arming,
    "modes disarmed": lambda line: modes(line, False),
    "modes armed": lambda line: modes(line, True),
    "streams": rates,
    "sticks cease": lambda line: lost(line, True, False),
    "heartbeats cease": lambda line: lost(line, False, True),
    "all ceases": lambda line: lost(line, False, False),
    "sticks cease in guided": lambda line: lost(line, True, False, GUIDED),
    "no sticks": silent,
    "without position": placeless,
}
USUAL = [name for name in PARTS if name != "without position"]


def record(url: str, parts: list[str] | None = None) -> dict[str, Any]:
    """All of the conversation, or some parts of it."""
    line = Line(url)
    try:
        line.listen(3.0, lambda m: m.get_type() == "HEARTBEAT")
        line.quiet()
        return {name: PARTS[name](line) for name in parts or USUAL}
    finally:
        line.close()


if __name__ == "__main__":
    url, name, path, *parts = sys.argv[1:]
    answers = json.loads(Path(path).read_text()) if Path(path).exists() else {}
    answers[name] = answers.get(name, {}) | record(url, parts)
    Path(path).write_text(json.dumps(answers, indent=1) + "\n")
