"""What the endpoint answers to each message of a peer, by MAVLink's micro-services as ArduSub has them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rovtwin.links.mavlink.firmware.autopilot import INFO, WARNING, Autopilot
from rovtwin.links.mavlink.firmware.guided import order_of_attitude, order_of_global, order_of_local
from rovtwin.links.mavlink.firmware.pilot import EXTENDED_SINCE, Sticks, axes_of_channels, axes_of_sticks
from rovtwin.links.mavlink.modes import GUIDED
from rovtwin.links.mavlink.services import mission_service
from rovtwin.links.mavlink.services import other_requests as services
from rovtwin.links.mavlink.services.commands import (
    CAPABILITIES,
    COMMANDS,
    FIRMWARE,
    NO_CAMERA,
    REASONS,
    RELEASE,
    Request,
)
from rovtwin.links.mavlink.services.peers import Peer
from rovtwin.links.mavlink.services.place_commands import PLACE_COMMANDS
from rovtwin.links.mavlink.services.results import UNSUPPORTED
from rovtwin.links.mavlink.telemetry.scene import Scene
from rovtwin.links.mavlink.telemetry.streams import MESSAGES, STREAMS, build
from rovtwin.links.mavlink.wire import is_addressed, number, text_of

GROUND_STATION = 6  # MAV_TYPE_GCS
MOST_TEXTS = 1000  # different things said once; names of parameters come from outside
CAMERAS = range(100, 106)  # MAV_COMP_ID_CAMERA to CAMERA6
# Messages that answer ours, or end a service: they want no answer.
NO_QUESTION = ("COMMAND_ACK", "MISSION_ACK", "LOG_REQUEST_END", "PARAM_VALUE")


@dataclass
class Conversation:
    """One vehicle that talks with its peers.

    Attributes:
        autopilot: What is decided.
        scene: What is measured.
        system, component: Its own address.
        clock: Real time [s].
        everybody: Sends a message to all peers.
        firmware: Major and minor version of the ArduSub whose behaviour this is.
        ignored: Messages that nobody here understands, by type: counted, and said once to whoever aims one at us.
        strangers: Systems whose sticks do not count and that know it.
        elsewhere: Other components of the vehicle that sent: they answer for themselves.
        uploading: Who sends the list that is under way.
    """

    autopilot: Autopilot
    scene: Scene
    system: int
    component: int
    clock: Callable[[], float]
    everybody: Callable[[Any], None]
    firmware: tuple[int, int] = FIRMWARE
    ignored: dict[str, int] = field(default_factory=dict)
    strangers: set[int] = field(default_factory=set)
    elsewhere: set[int] = field(default_factory=set)
    uploading: Peer | None = None
    _texts: set[tuple[int, str]] = field(default_factory=set)

    def take(self, message: Any, peer: Peer) -> bool:
        """Answer one message; whether it changed what the vehicle shall do."""
        system, component = message.get_srcSystem(), message.get_srcComponent()
        if system == self.system and component != self.component:
            self.elsewhere.add(component)
        if (system, component) == (self.system, self.component):
            return False  # our own, sent back by a router
        if not is_addressed(message, self.system, self.component):
            return self._refuse_elsewhere(message, peer)
        answer = ANSWERS.get(message.get_type())
        if answer is None:
            self._ignore(message)
            return False
        return bool(answer(self, message, peer))

    def _ignore(self, message: Any) -> None:
        kind = message.get_type()
        self.ignored[kind] = self.ignored.get(kind, 0) + 1  # bounded: only types of the dialect come here
        if getattr(message, "target_system", 0) == self.system and kind not in NO_QUESTION:
            self.tell_once(message.get_srcSystem(), WARNING, f"{kind} is not supported")

    def _refuse_elsewhere(self, message: Any, peer: Peer) -> bool:
        """Answer for a component that the vehicle does not have, such as a camera."""
        component = getattr(message, "target_component", 0)
        if getattr(message, "target_system", 0) != self.system or component in self.elsewhere:
            return False
        text = NO_CAMERA if component in CAMERAS else f"There is no component {component} here"
        self.tell_once(message.get_srcSystem(), WARNING, text)
        if message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
            peer.send(self._ack(message, UNSUPPORTED), component)
        return False

    def _ack(self, message: Any, result: int) -> Any:
        make = self.scene.dialect.MAVLink_command_ack_message
        return make(message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent())

    def command(self, message: Any, peer: Peer, values: tuple[float, ...], frame: int | None) -> bool:
        """Do a command and acknowledge it; whether it changed what the vehicle shall do."""
        handler = COMMANDS.get(message.command) or PLACE_COMMANDS.get(message.command)
        request = Request(self, peer, message.get_srcSystem(), values, frame)
        result = UNSUPPORTED if handler is None else handler(request)
        if handler is None:
            known = self.scene.dialect.enums["MAV_CMD"].get(message.command)
            name = known.name.removeprefix("MAV_CMD_") if known else f"command {message.command}"
            self.tell_once(request.by, WARNING, REASONS.get(message.command, f"{name} is not supported"))
        for answer in (*request.before, self._ack(message, result), *request.answers):
            peer.send(answer)
        for one in request.news:
            self.everybody(one)
        return request.changed

    def telemetry(self, name: str) -> list[Any]:
        """Messages of a name as of now; empty where there are none, or nothing is measured that they could tell."""
        if name in ONCE:
            made = ONCE[name](self)
            return [] if made is None else [made]
        return build(self.scene, name) if name in MESSAGES else []

    def tell_once(self, system: int, severity: int, text: str) -> None:
        """Say something that a client need not get again; nothing new any more to whoever makes it say too much."""
        if (system, text) not in self._texts and len(self._texts) < MOST_TEXTS:
            self._texts.add((system, text))
            self.autopilot.say(severity, text)

    def banner(self) -> list[Any]:
        """What it is, as ArduPilot says it to whoever asks for its parameters."""
        version = ".".join(str(part) for part in (*self.firmware, 0))
        make = self.scene.dialect.MAVLink_statustext_message
        return [make(INFO, text.encode()) for text in (f"ArduSub V{version} (rovtwin)", "Frame: VECTORED_6DOF")]

    def steer(self, message: Any, axes: Any) -> bool:
        """A pilot's input; a stranger is informed once why it does not count."""
        system = message.get_srcSystem()
        taken = self.autopilot.steer(system, axes, self.clock())
        mine = int(self.autopilot.parameters["SYSID_MYGCS"])
        if not taken and system != mine and system not in self.strangers:
            self.strangers.add(system)
            self.autopilot.say(WARNING, f"Input of system {system} ignored: SYSID_MYGCS is {mine}")
        return taken


def _heartbeat(talk: Conversation, message: Any, peer: Peer) -> None:
    if message.type == GROUND_STATION or message.autopilot == 8:  # 8: MAV_AUTOPILOT_INVALID, no vehicle
        talk.autopilot.heartbeat(message.get_srcSystem(), talk.clock())


def _manual_control(talk: Conversation, message: Any, peer: Peer) -> bool:
    if message.target != talk.system:
        return False
    sticks = Sticks(message.x, message.y, message.z, message.r, message.s, message.t, message.enabled_extensions)
    parameters, extended = talk.autopilot.parameters, talk.firmware >= EXTENDED_SINCE
    axes = axes_of_sticks(sticks, parameters["JS_GAIN_DEFAULT"], parameters["JS_THR_GAIN"], extended)
    return talk.steer(message, axes)


def _rc_override(talk: Conversation, message: Any, peer: Peer) -> bool:
    if message.target_system != talk.system:
        return False
    channels = [getattr(message, f"chan{i}_raw") for i in range(1, 7)]
    return talk.steer(message, axes_of_channels(channels, talk.autopilot.axes))


def _set_mode(talk: Conversation, message: Any, peer: Peer) -> bool:
    return bool(message.base_mode & 1) and talk.autopilot.set_mode(message.custom_mode)


def _in_guided(talk: Conversation, message: Any, what: str = "Set-points") -> bool:
    if talk.autopilot.mode is GUIDED:
        return True
    talk.tell_once(message.get_srcSystem(), WARNING, f"{what} count in GUIDED only")
    return False


def _local_target(talk: Conversation, message: Any, peer: Peer) -> bool:
    if not _in_guided(talk, message):
        return False
    order = order_of_local(message, talk.scene.place(), talk.autopilot.target)
    return talk.autopilot.obey(message.get_srcSystem(), order, talk.clock())


def _global_target(talk: Conversation, message: Any, peer: Peer) -> bool:
    if not _in_guided(talk, message):
        return False
    scene = talk.scene
    order = order_of_global(message, scene.place(), talk.autopilot.target, scene.datum, scene.ground)
    return talk.autopilot.obey(message.get_srcSystem(), order, talk.clock())


def _attitude_target(talk: Conversation, message: Any, peer: Peer) -> bool:
    if not _in_guided(talk, message, "Attitudes"):
        return False
    order = order_of_attitude(message, talk.scene.place(), talk.autopilot.fastest[2])
    return talk.autopilot.obey(message.get_srcSystem(), order, talk.clock())


def _command_long(talk: Conversation, message: Any, peer: Peer) -> bool:
    values = tuple(number(getattr(message, f"param{i}"), float("nan")) for i in range(1, 8))
    return talk.command(message, peer, values, None)


def _command_int(talk: Conversation, message: Any, peer: Peer) -> bool:
    values = (*(number(getattr(message, f"param{i}"), float("nan")) for i in range(1, 5)), message.x, message.y)
    return talk.command(message, peer, (*values, number(message.z, float("nan"))), message.frame)


def _send_parameter(talk: Conversation, peer: Peer, name: str, index: int) -> None:
    found = talk.autopilot.parameters.find(name, index)
    if found is not None:
        place, parameter = found
        message = talk.scene.dialect.MAVLink_param_value_message
        count = len(talk.autopilot.parameters)
        peer.send(message(parameter.name.encode(), parameter.value, parameter.kind, count, place))


def _parameter_list(talk: Conversation, message: Any, peer: Peer) -> None:
    for text in talk.banner():
        peer.send(text)
    for index in range(len(talk.autopilot.parameters)):
        _send_parameter(talk, peer, "", index)


def _parameter_read(talk: Conversation, message: Any, peer: Peer) -> None:
    name = text_of(message.param_id)
    if talk.autopilot.parameters.find(name, message.param_index) is None:
        what = name if message.param_index < 0 else f"number {message.param_index}"
        talk.tell_once(message.get_srcSystem(), WARNING, f"No parameter {what}")
    _send_parameter(talk, peer, name, message.param_index)


def _parameter_set(talk: Conversation, message: Any, peer: Peer) -> None:
    name = text_of(message.param_id)
    if talk.autopilot.parameters.find(name, -1) is None:
        talk.tell_once(message.get_srcSystem(), WARNING, f"No parameter {name}")
    elif not talk.autopilot.parameters.set(name, message.param_value):
        talk.autopilot.say(WARNING, f"{name}: not set, out of range or read only")
    # The value that holds now: what a client takes for the answer, also when nothing was set.
    _send_parameter(talk, peer, name, -1)


def _timesync(talk: Conversation, message: Any, peer: Peer) -> None:
    if message.tc1 == 0:  # a question; else it is an answer to somebody
        peer.send(talk.scene.dialect.MAVLink_timesync_message(round(talk.scene.station.now * 1e9), message.ts1))


def _data_stream(talk: Conversation, message: Any, peer: Peer) -> None:
    for name in STREAMS.get(message.req_stream_id, ()):
        peer.schedule.set_rate(name, float(message.req_message_rate) if message.start_stop else 0.0)


Answer = Callable[[Conversation, Any, Peer], bool | None]
ANSWERS: dict[str, Answer] = {
    "HEARTBEAT": _heartbeat,
    "MANUAL_CONTROL": _manual_control,
    "RC_CHANNELS_OVERRIDE": _rc_override,
    "SET_MODE": _set_mode,
    "SET_POSITION_TARGET_LOCAL_NED": _local_target,
    "SET_POSITION_TARGET_GLOBAL_INT": _global_target,
    "SET_ATTITUDE_TARGET": _attitude_target,
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "PARAM_REQUEST_LIST": _parameter_list,
    "PARAM_REQUEST_READ": _parameter_read,
    "PARAM_SET": _parameter_set,
    "TIMESYNC": _timesync,
    "REQUEST_DATA_STREAM": _data_stream,
    **mission_service.ANSWERS,
    **services.ANSWERS,
}


def _version(talk: Conversation) -> Any:
    """AUTOPILOT_VERSION; the custom version says that it is no ArduSub."""
    number = int.from_bytes(bytes((*talk.firmware, 0, RELEASE)), "big")
    custom = list(b"rovtwin\0")
    make = talk.scene.dialect.MAVLink_autopilot_version_message
    return make(CAPABILITIES, number, 0, 0, 0, custom, custom, custom, 0, 0, talk.system)


# Messages that are sent when asked for only, beside telemetry.
ONCE: dict[str, Callable[[Conversation], Any]] = {
    "AUTOPILOT_VERSION": _version,
}
