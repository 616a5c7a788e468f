"""COMMAND_LONG and COMMAND_INT: what each does, and its MAV_RESULT. What is refused says why, once to each client."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rovtwin.links.mavlink.firmware.autopilot import INFO, WARNING
from rovtwin.links.mavlink.services.mission_service import choose
from rovtwin.links.mavlink.services.peers import Peer
from rovtwin.links.mavlink.services.results import ACCEPTED, DENIED, FAILED, UNSUPPORTED
from rovtwin.links.mavlink.telemetry.streams import MESSAGES, STREAM_ONLY
from rovtwin.links.mavlink.wire import whole

if TYPE_CHECKING:
    from rovtwin.links.mavlink.services.conversation import Conversation

# MAV_CMD
DO_SET_MODE, COMPONENT_ARM_DISARM, GET_HOME = 176, 400, 410
GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, REQUEST_CAPABILITIES = 510, 511, 512, 520
SET_MISSION_CURRENT, RUN_PREARM_CHECKS, SEND_BANNER, FENCE_ENABLE, TERMINATE = 224, 401, 42428, 207, 185
CALIBRATE = 241
FIRMWARE = (4, 5)  # the ArduSub whose behaviour this endpoint has
RELEASE = 255  # FIRMWARE_VERSION_TYPE: an official one
# MAV_PROTOCOL_CAPABILITY: missions, float parameters, set-points of attitude, in n and on the map, termination,
# MAVLink 2, fences, rally points; ArduSub's but for files and compass calibration.
CAPABILITIES = 1 | 2 | 4 | 64 | 128 | 256 | 2048 | 8192 | 16384 | 32768
CALIBRATIONS = "The twin's sensors have no calibration"
NO_CAMERA = "There is no camera here"
# Why a command that is none of this vehicle's is refused, by its number; others say that they are not supported.
REASONS = {
    **{20: "No return to launch: send it there in GUIDED", 22: "No take-off: a submarine dives, in ALT_HOLD"},
    **{34: "No orbit: send places in GUIDED", 178: "Its speed in GUIDED is not settable", 209: "No motor test"},
    **{211: "There is no gripper", 246: "No reboot: end serve and start it anew", 300: "AUTO is not flown here"},
    **{420: "No failures by command: give a scenario's faults to serve", 42600: "There is no winch"},
    **dict.fromkeys((42424, 42425, 42426, 42429, 42006), CALIBRATIONS),
    **dict.fromkeys((203, 205, 206, 521, 522, 525, 526, 527, 530, 2000, 2001, 2500, 2501, 2504, 2505), NO_CAMERA),
    **dict.fromkeys((1000, 1001), "There is no gimbal"),
}


@dataclass
class Request:
    """One command.

    Attributes:
        talk: The conversation it came in.
        peer: Who sent it.
        by: System that sent it.
        values: param1 to param7, NaN where they are no number; latitude and longitude of a COMMAND_INT in 1e-7 deg.
        frame: MAV_FRAME of a COMMAND_INT, None of a COMMAND_LONG.
        before, answers: Messages to send before the acknowledgement, and after it.
        news: Messages to send to everybody after it.
        changed: Whether the vehicle shall do something else now.
    """

    talk: "Conversation"
    peer: Peer
    by: int
    values: tuple[float, ...]
    frame: int | None = None
    before: list[Any] = field(default_factory=list)
    answers: list[Any] = field(default_factory=list)
    news: list[Any] = field(default_factory=list)
    changed: bool = False

    def refuse(self, text: str, result: int = FAILED) -> int:
        """Say why not; the result."""
        self.talk.autopilot.say(WARNING, text)
        return result


def _arm(request: Request) -> int:
    autopilot = request.talk.autopilot
    requested = request.values[0]
    if requested not in (0.0, 1.0):
        return UNSUPPORTED
    request.changed = True
    if requested == 0.0:
        autopilot.disarm()
        return ACCEPTED
    armed = autopilot.arm(request.by, request.talk.clock(), request.talk.scene.readiness())
    return ACCEPTED if armed else FAILED  # as ArduPilot answers a failed pre-arm check


def _checks(request: Request) -> int:
    missing = request.talk.scene.readiness()
    return request.refuse(f"PreArm: {missing}", ACCEPTED) if missing else ACCEPTED


def _terminate(request: Request) -> int:
    if not request.values[0] > 0.5:
        return FAILED
    request.changed = True
    request.talk.autopilot.disarm()
    return ACCEPTED


def _mode(request: Request) -> int:
    base, custom = whole(request.values[0]), whole(request.values[1])
    if base < 0 or not base & 1:  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED: ArduPilot takes no other modes
        return DENIED
    request.changed = True
    return ACCEPTED if request.talk.autopilot.set_mode(custom) else FAILED


def _interval(request: Request) -> int:
    name = _message_name(request)
    interval = request.values[1]
    if name not in MESSAGES or name in STREAM_ONLY:
        what = name or f"number {whole(request.values[0])}"
        request.talk.tell_once(request.by, INFO, f"No stream of a message {what}")
        return DENIED
    if math.isnan(interval):
        request.talk.tell_once(request.by, INFO, f"Interval of {name}: no number")
        return DENIED
    if interval == 0.0:  # back to what it was at first
        request.peer.schedule.reset_rate(name)
    else:
        request.peer.schedule.set_rate(name, 1e6 / interval if interval > 0.0 else 0.0)
    return ACCEPTED


def _interval_asked(request: Request) -> int:
    """The interval comes before the acknowledgement, as ArduPilot has it."""
    name = _message_name(request)
    rate = request.peer.schedule.rate(name)
    interval = round(1e6 / rate) if rate > 0.0 else (-1 if name in MESSAGES else 0)
    dialect = request.talk.scene.dialect
    number = max(0, whole(request.values[0])) % 65536
    request.before.append(dialect.MAVLink_message_interval_message(number, interval))
    return ACCEPTED if name in MESSAGES else FAILED


def _message(request: Request) -> int:
    """As ArduPilot: FAILED for what it cannot send, also where nothing is measured."""
    return _send(request, _message_name(request))


def _send(request: Request, name: str) -> int:
    found = [] if name in STREAM_ONLY else request.talk.telemetry(name)
    request.answers += found
    return ACCEPTED if found else FAILED


def _capabilities(request: Request) -> int:
    return _send(request, "AUTOPILOT_VERSION")


def _home(request: Request) -> int:
    """Home and the origin, both before the acknowledgement, as ArduPilot sends them."""
    names = ("HOME_POSITION", "GPS_GLOBAL_ORIGIN")
    request.before += [message for name in names for message in request.talk.telemetry(name)]
    return ACCEPTED if request.before else FAILED


def _message_name(request: Request) -> str:
    found = request.talk.scene.dialect.mavlink_map.get(whole(request.values[0]))
    return found.msgname if found else ""


def _banner(request: Request) -> int:
    request.answers += request.talk.banner()
    return ACCEPTED


def _current(request: Request) -> int:
    return ACCEPTED if choose(request.talk, whole(request.values[0])) else DENIED


def _fence(request: Request) -> int:
    """What nothing watches over can be switched off, not on."""
    return ACCEPTED if request.values[0] == 0.0 else request.refuse("Nothing watches over fences here", UNSUPPORTED)


def _calibrate(request: Request) -> int:
    if request.talk.autopilot.armed:
        return request.refuse("Disarm before calibration")
    return request.refuse(CALIBRATIONS, UNSUPPORTED)


def _start(request: Request) -> int:
    return request.refuse(REASONS[300])


COMMANDS: dict[int, Callable[[Request], int]] = {
    COMPONENT_ARM_DISARM: _arm,
    RUN_PREARM_CHECKS: _checks,
    TERMINATE: _terminate,
    DO_SET_MODE: _mode,
    GET_HOME: _home,
    SET_MESSAGE_INTERVAL: _interval,
    GET_MESSAGE_INTERVAL: _interval_asked,
    REQUEST_MESSAGE: _message,
    REQUEST_CAPABILITIES: _capabilities,
    SEND_BANNER: _banner,
    SET_MISSION_CURRENT: _current,
    FENCE_ENABLE: _fence,
    CALIBRATE: _calibrate,
    300: _start,  # MISSION_START
}
