"""What clients of a Blueye drone send: control messages and requests, from bytes that anybody may have written.

Motion is FRD: heave down, yaw clockwise, each -1 to 1 and linear in force; lights 0 to 1; water density g/l.
Source: blueye.protocol 3.5 (control.proto, req_rep.proto), protocols.md.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.links.blueye.protobuf import frame_name, parse

LARGEST = 65536  # bytes of a control message or request; a mission of 50 way-points has less than a tenth
LONGEST_TEXT = 100  # characters kept of what a client says of itself
STILL = (0.0,) * 6
FASTEST = 100.0  # Hz: rates of telemetry, req_rep.proto

# Messages that switch something on or off -> what they switch
MODES = {
    "AutoDepthCtrl": "auto_depth",
    "AutoHeadingCtrl": "auto_heading",
    "AutoAltitudeCtrl": "auto_altitude",
    "StationKeepingCtrl": "station_keeping",
    "WeatherVaningCtrl": "weather_vaning",
}
MISSION_ORDERS = {"RunMissionCtrl": "run", "PauseMissionCtrl": "pause", "ClearMissionCtrl": "clear"}


@dataclass(frozen=True)
class Watchdog:
    """A client lives; `client` is its id."""

    client: int


@dataclass(frozen=True)
class Motion:
    """Surge, sway, heave, roll, pitch, yaw, shares of the largest force or moment, -1 to 1, shape (6,)."""

    share: tuple[float, ...] = STILL


@dataclass(frozen=True)
class Mode:
    """A mode of the drone's own controller, one of `MODES`' values, on or off."""

    name: str
    on: bool


@dataclass(frozen=True)
class Lights:
    """Main lights, 0 to 1."""

    value: float


@dataclass(frozen=True)
class WaterDensity:
    """Density to turn pressure into depth with [g/l]."""

    value: float


@dataclass(frozen=True)
class MissionOrder:
    """The mission that is loaded shall "run", "pause" or be cleared ("clear")."""

    name: str


@dataclass(frozen=True)
class ResetOdometer:
    """The way that the drone has gone counts from now."""


@dataclass(frozen=True)
class Ignored:
    """A control message that the twin has nothing to obey with: camera, recording, gripper, ..."""

    name: str


Control = Watchdog | Motion | Mode | Lights | WaterDensity | MissionOrder | ResetOdometer | Ignored


def _two_frames(frames: Sequence[bytes]) -> tuple[bytes, bytes]:
    if len(frames) != 2:
        raise LinkError(f"{len(frames)} frames, expected 2: the name of a message and the message")
    if len(frames[1]) > LARGEST:
        raise LinkError(f"a message of {len(frames[1])} bytes, expected at most {LARGEST}")
    return frames[0], frames[1]


def parse_control(frames: Sequence[bytes]) -> Control:
    """A control message. A motion with a number that is none is no motion at all: nothing moves.

    Raises:
        LinkError: The frames are no control message of the protocol.
    """
    head, payload = _two_frames(frames)
    name = frame_name(head, "Ctrl")
    content = parse(name, payload)
    if name == "MotionInputCtrl":
        return Motion(_motion(content.motion_input))
    if name == "WatchdogCtrl":
        return Watchdog(content.client_id)
    if name in MODES:
        return Mode(MODES[name], content.state.enabled)
    if name == "LightsCtrl":
        return Lights(_finite(content.lights.value, "lights", 0.0, 1.0))
    if name == "WaterDensityCtrl":
        # From ice-cold fresh water to the Dead Sea, with some room.
        return WaterDensity(_finite(content.density.value, "water density", 900.0, 1300.0))
    if name in MISSION_ORDERS:
        return MissionOrder(MISSION_ORDERS[name])
    return ResetOdometer() if name == "ResetOdometerCtrl" else Ignored(name)


def _motion(motion: Any) -> tuple[float, ...]:
    share = (motion.surge, motion.sway, motion.heave, motion.roll, motion.pitch, motion.yaw)
    if not all(math.isfinite(s) for s in share):
        return STILL
    return tuple(min(1.0, max(-1.0, s)) for s in share)


def _finite(value: float, what: str, low: float, high: float) -> float:
    if not low <= value <= high:
        raise LinkError(f"{what} {value}: expected {low} to {high}")
    return value


@dataclass(frozen=True)
class Client:
    """What a client says of itself: `ClientInfo` of the protocol, texts cut to 100 characters."""

    text: dict[str, str] = field(default_factory=dict)
    observer: bool = False

    @property
    def name(self) -> str:
        """For people, in printable ASCII: an escape sequence would command the operator's terminal."""
        words = " ".join(self.text[key] for key in ("type_", "version", "name") if self.text.get(key))
        return words.encode("unicode_escape").decode() or "a client"


@dataclass(frozen=True)
class Request:
    """A request. `name` without "Req"; of the other fields those of its kind are set, as the protocol has them."""

    name: str
    client: Client = Client()
    client_id: int = 0
    message_type: str = ""
    frequency: float = 0.0
    time: float = 0.0
    content: Any = None


def parse_request(frames: Sequence[bytes]) -> Request:
    """A request.

    Raises:
        LinkError: The frames are no request of the protocol.
    """
    head, payload = _two_frames(frames)
    full = frame_name(head, "Req")
    content, name = parse(full, payload), full.removesuffix("Req")
    if name == "ConnectClient":
        return Request(name, client=_client(content.client_info))
    if name == "DisconnectClient":
        return Request(name, client_id=content.client_id)
    if name == "GetTelemetry":
        return Request(name, message_type=content.message_type)
    if name in ("SetPubFrequency", "SetLogFrequency"):
        return Request(name, message_type=content.message_type, frequency=content.frequency)
    if name == "SyncTime":
        stamp = content.time.unix_timestamp
        return Request(name, time=stamp.seconds + 1e-9 * stamp.nanos)
    return Request(name, content=content)


def _client(info: Any) -> Client:
    fields = ("type_", "type", "version", "device_type", "platform", "platform_version", "name")
    found = {key: str(getattr(info, key))[:LONGEST_TEXT] for key in fields if hasattr(info, key)}
    return Client({("type_" if key == "type" else key): text for key, text in found.items()}, info.is_observer)


def reply_name(frames: Sequence[bytes]) -> str:
    """What the reply to a request is called, `PingRep` for what is no request: a client waits for one in any case."""
    try:
        return frame_name(frames[0], "Req").removesuffix("Req") + "Rep"
    except (LinkError, IndexError):
        return "PingRep"
