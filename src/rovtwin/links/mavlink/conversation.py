"""What the endpoint answers to each message of a peer, by MAVLink's micro-services as ArduSub has them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rovtwin.links.mavlink.autopilot import INFO, WARNING, Autopilot
from rovtwin.links.mavlink.commands import COMMANDS, FIRMWARE, UNSUPPORTED, Request
from rovtwin.links.mavlink.guided import order_of_global, order_of_local
from rovtwin.links.mavlink.peers import Peer
from rovtwin.links.mavlink.pilot import EXTENDED_SINCE, Sticks, axes_of_channels, axes_of_sticks
from rovtwin.links.mavlink.telemetry import STREAMS, Scene
from rovtwin.links.mavlink.wire import is_addressed, number

GROUND_STATION = 6  # MAV_TYPE_GCS
REFUSED_MISSION = 3  # MAV_MISSION_UNSUPPORTED


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
        ignored: Messages that nobody here understands, by type: counted, not answered.
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

    def take(self, message: Any, peer: Peer) -> bool:
        """Answer one message; whether it changed what the vehicle shall do."""
        if (message.get_srcSystem(), message.get_srcComponent()) == (self.system, self.component):
            return False  # our own, sent back by a router
        if not is_addressed(message, self.system, self.component):
            return False
        answer = ANSWERS.get(message.get_type())
        if answer is None:
            kind = message.get_type()
            self.ignored[kind] = self.ignored.get(kind, 0) + 1  # bounded: only types of the dialect come here
            return False
        return bool(answer(self, message, peer))

    def steer(self, message: Any, axes: Any) -> bool:
        """A pilot's input; a stranger is told once why it does not count."""
        system = message.get_srcSystem()
        taken = self.autopilot.steer(system, axes, self.clock())
        mine = int(self.autopilot.parameters["SYSID_MYGCS"])
        if not taken and system != mine and system not in self.strangers:
            self.strangers.add(system)
            self.autopilot.say(WARNING, f"Input of system {system} ignored: SYSID_MYGCS is {mine}")
        return taken

    def readiness(self) -> str:
        """What is missing before the vehicle may be armed; empty when nothing is."""
        return "" if self.scene.attitude() is not None else "no attitude yet"


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


def _local_target(talk: Conversation, message: Any, peer: Peer) -> bool:
    order = order_of_local(message, talk.scene.place(), talk.autopilot.target)
    return talk.autopilot.obey(order, talk.clock())


def _global_target(talk: Conversation, message: Any, peer: Peer) -> bool:
    order = order_of_global(message, talk.scene.place(), talk.autopilot.target, talk.scene.datum)
    return talk.autopilot.obey(order, talk.clock())


def _command_long(talk: Conversation, message: Any, peer: Peer) -> bool:
    values = tuple(number(getattr(message, f"param{i}"), float("nan")) for i in range(1, 8))
    return _command(talk, message, peer, values)


def _command_int(talk: Conversation, message: Any, peer: Peer) -> bool:
    values = (*(number(getattr(message, f"param{i}"), float("nan")) for i in range(1, 5)), message.x, message.y)
    return _command(talk, message, peer, (*values, number(message.z)))


def _command(talk: Conversation, message: Any, peer: Peer, values: tuple[float, ...]) -> bool:
    handler = COMMANDS.get(message.command)
    request = Request(talk, peer, message.get_srcSystem(), values)
    result = UNSUPPORTED if handler is None else handler(request)
    ack = talk.scene.dialect.MAVLink_command_ack_message(
        message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent()
    )
    peer.send(ack)
    for answer in request.answers:
        peer.send(answer)
    return request.changed


def _send_parameter(talk: Conversation, peer: Peer, name: str, index: int) -> None:
    found = talk.autopilot.parameters.find(name, index)
    if found is not None:
        place, parameter = found
        message = talk.scene.dialect.MAVLink_param_value_message
        count = len(talk.autopilot.parameters)
        peer.send(message(parameter.name.encode(), parameter.value, parameter.kind, count, place))


def _name(value: Any) -> str:
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)


def _parameter_list(talk: Conversation, message: Any, peer: Peer) -> None:
    for index in range(len(talk.autopilot.parameters)):
        _send_parameter(talk, peer, "", index)


def _parameter_read(talk: Conversation, message: Any, peer: Peer) -> None:
    _send_parameter(talk, peer, _name(message.param_id), message.param_index)


def _parameter_set(talk: Conversation, message: Any, peer: Peer) -> None:
    name = _name(message.param_id)
    if not talk.autopilot.parameters.set(name, message.param_value):
        talk.autopilot.say(WARNING, f"{name}: not set, out of range or read only")
    # The value that holds now: what a client takes for the answer, also when nothing was set.
    _send_parameter(talk, peer, name, -1)


def _missions(talk: Conversation, message: Any, peer: Peer) -> None:
    count = talk.scene.dialect.MAVLink_mission_count_message
    peer.send(count(message.get_srcSystem(), message.get_srcComponent(), 0, message.mission_type))


def _mission_offered(talk: Conversation, message: Any, peer: Peer) -> None:
    ack = talk.scene.dialect.MAVLink_mission_ack_message
    peer.send(ack(message.get_srcSystem(), message.get_srcComponent(), REFUSED_MISSION, message.mission_type))
    talk.autopilot.say(INFO, "Missions are not flown by this endpoint")


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
    "COMMAND_LONG": _command_long,
    "COMMAND_INT": _command_int,
    "PARAM_REQUEST_LIST": _parameter_list,
    "PARAM_REQUEST_READ": _parameter_read,
    "PARAM_SET": _parameter_set,
    "MISSION_REQUEST_LIST": _missions,
    "MISSION_COUNT": _mission_offered,
    "TIMESYNC": _timesync,
    "REQUEST_DATA_STREAM": _data_stream,
}
