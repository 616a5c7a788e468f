"""COMMAND_LONG and COMMAND_INT: what each does, and its MAV_RESULT."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rovtwin.links.mavlink.peers import Peer
from rovtwin.links.mavlink.telemetry import MESSAGES, build
from rovtwin.links.mavlink.wire import whole

if TYPE_CHECKING:
    from rovtwin.links.mavlink.conversation import Conversation

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4  # MAV_RESULT
# MAV_CMD
DO_SET_MODE, COMPONENT_ARM_DISARM, GET_HOME = 176, 400, 410
GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, REQUEST_CAPABILITIES = 510, 511, 512, 520
FIRMWARE = (4, 5)  # the ArduSub whose behaviour this endpoint has
RELEASE = 255  # FIRMWARE_VERSION_TYPE: an official one
# MAV_PROTOCOL_CAPABILITY: float parameters, COMMAND_INT, set-points in n and on the map, MAVLink 2.
CAPABILITIES = 2 | 8 | 128 | 256 | 8192


@dataclass
class Request:
    """One command.

    Attributes:
        talk: The conversation it came in.
        peer: Who sent it.
        by: System that sent it.
        values: param1 to param7, NaN where they are no number.
        answers: Messages to send after the acknowledgement.
        changed: Whether the vehicle shall do something else now.
    """

    talk: "Conversation"
    peer: Peer
    by: int
    values: tuple[float, ...]
    answers: list[Any] = field(default_factory=list)
    changed: bool = False


def _arm(request: Request) -> int:
    autopilot = request.talk.autopilot
    wanted = request.values[0]
    if wanted not in (0.0, 1.0):
        return DENIED
    request.changed = True
    if wanted == 0.0:
        autopilot.disarm()
        return ACCEPTED
    armed = autopilot.arm(request.by, request.talk.clock(), request.talk.readiness())
    return ACCEPTED if armed else FAILED  # as ArduPilot answers a failed pre-arm check


def _mode(request: Request) -> int:
    base, custom = whole(request.values[0]), whole(request.values[1])
    if base < 0 or not base & 1:  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED: ArduPilot takes no other modes
        return DENIED
    request.changed = True
    return ACCEPTED if request.talk.autopilot.set_mode(custom) else FAILED


def _interval(request: Request) -> int:
    name = _message_name(request)
    interval = request.values[1]
    if name not in MESSAGES or interval != interval:
        return DENIED
    if interval == 0.0:  # back to what it was at first
        request.peer.schedule.reset_rate(name)
    else:
        request.peer.schedule.set_rate(name, 1e6 / interval if interval > 0.0 else 0.0)
    return ACCEPTED


def _interval_asked(request: Request) -> int:
    name = _message_name(request)
    rate = request.peer.schedule.rate(name)
    interval = round(1e6 / rate) if rate > 0.0 else (-1 if name in MESSAGES else 0)
    dialect = request.talk.scene.dialect
    request.answers.append(dialect.MAVLink_message_interval_message(max(0, whole(request.values[0])) % 65536, interval))
    return ACCEPTED


def _message(request: Request) -> int:
    name = _message_name(request)
    scene = request.talk.scene
    if name in ONCE:
        request.answers.append(ONCE[name](scene.dialect, request.talk))
        return ACCEPTED
    if name not in MESSAGES:
        return DENIED
    message = build(scene, name)
    if message is None:  # nothing is measured that could be told
        return FAILED
    request.answers.append(message)
    return ACCEPTED


def _capabilities(request: Request) -> int:
    request.answers.append(version(request.talk.scene.dialect, request.talk))
    return ACCEPTED


def _home(request: Request) -> int:
    request.answers.append(home(request.talk.scene.dialect, request.talk))
    return ACCEPTED


def _message_name(request: Request) -> str:
    found = request.talk.scene.dialect.mavlink_map.get(whole(request.values[0]))
    return found.msgname if found else ""


def version(dialect: Any, talk: "Conversation") -> Any:
    """AUTOPILOT_VERSION; the custom version says that it is no ArduSub."""
    number = int.from_bytes(bytes((*talk.firmware, 0, RELEASE)), "big")
    custom = list(b"rovtwin\0")
    return dialect.MAVLink_autopilot_version_message(
        CAPABILITIES, number, 0, 0, 0, custom, custom, custom, 0, 0, talk.system
    )


def home(dialect: Any, talk: "Conversation") -> Any:
    """HOME_POSITION: the origin of n."""
    datum = talk.scene.datum
    place = (round(datum.latitude * 1e7), round(datum.longitude * 1e7), round(datum.height * 1000.0))
    return dialect.MAVLink_home_position_message(*place, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)


ONCE: dict[str, Callable[[Any, "Conversation"], Any]] = {"AUTOPILOT_VERSION": version, "HOME_POSITION": home}

COMMANDS: dict[int, Callable[[Request], int]] = {
    COMPONENT_ARM_DISARM: _arm,
    DO_SET_MODE: _mode,
    GET_HOME: _home,
    SET_MESSAGE_INTERVAL: _interval,
    GET_MESSAGE_INTERVAL: _interval_asked,
    REQUEST_MESSAGE: _message,
    REQUEST_CAPABILITIES: _capabilities,
}
