"""Answers to what else clients ask: ping, origin, logs, files, a shell; a refusal says why."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rovtwin.core.errors import ConfigError
from rovtwin.links.mavlink.firmware.autopilot import INFO, WARNING
from rovtwin.links.mavlink.services.peers import Peer
from rovtwin.links.mavlink.telemetry import motion_messages as motion

if TYPE_CHECKING:
    from rovtwin.links.mavlink.services.conversation import Conversation

NO_LOGS = "It keeps no logs on board: serve --log keeps the truth"
LOG_CHUNK = 90  # bytes of a LOG_DATA
SERIAL_REPLY, SERIAL_BYTES = 1, 70  # SERIAL_CONTROL_FLAG_REPLY, bytes of a SERIAL_CONTROL
FTP_ANSWERS, FTP_NAK, FTP_UNKNOWN_COMMAND, FTP_BYTES = 128, 129, 6, 251  # answers have opcodes from 128


def _ping(talk: "Conversation", message: Any, peer: Peer) -> None:
    if message.target_system == 0:  # a question; else it is an answer to somebody
        ping = talk.scene.dialect.MAVLink_ping_message
        peer.send(ping(message.time_usec, message.seq, message.get_srcSystem(), message.get_srcComponent()))


def _origin(talk: "Conversation", message: Any, peer: Peer) -> None:
    """ArduSub takes an origin while it has none; one that has a position knows where it is."""
    scene = talk.scene
    if scene.reading("position") is not None:
        talk.autopilot.say(WARNING, "Origin not set: the vehicle has positions")
    else:
        try:
            scene.datum = replace(
                scene.datum,
                latitude=message.latitude * 1e-7,
                longitude=message.longitude * 1e-7,
                height=message.altitude * 1e-3,
            )
        except ConfigError as error:
            talk.autopilot.say(WARNING, f"Origin not set: {error}")
    talk.everybody(motion.origin(scene))


def _logs(talk: "Conversation", message: Any, peer: Peer) -> None:
    peer.send(talk.scene.dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0))
    talk.tell_once(message.get_srcSystem(), INFO, NO_LOGS)


def _log_data(talk: "Conversation", message: Any, peer: Peer) -> None:
    data = talk.scene.dialect.MAVLink_log_data_message
    peer.send(data(message.id, message.ofs, 0, [0] * LOG_CHUNK))
    talk.tell_once(message.get_srcSystem(), INFO, NO_LOGS)


def _log_erase(talk: "Conversation", message: Any, peer: Peer) -> None:
    talk.autopilot.say(INFO, NO_LOGS)


def _serial(talk: "Conversation", message: Any, peer: Peer) -> None:
    if message.flags & SERIAL_REPLY:
        return  # of another vehicle: two that answered answers would do so for ever
    text = b"no shell here\n"
    data = [*text, *[0] * (SERIAL_BYTES - len(text))]
    serial = talk.scene.dialect.MAVLink_serial_control_message
    peer.send(serial(message.device, SERIAL_REPLY, 0, 0, len(text), data))


def _files(talk: "Conversation", message: Any, peer: Peer) -> None:
    """MAVFTP: every command is one it does not know; answers of others get no answer."""
    asked = list(message.payload)
    if asked[3] >= FTP_ANSWERS:
        return
    sequence = (int.from_bytes(bytes(asked[:2]), "little") + 1) % 65536
    head = [*sequence.to_bytes(2, "little"), asked[2], FTP_NAK, 1, asked[3], 0, 0, 0, 0, 0, 0, FTP_UNKNOWN_COMMAND]
    payload = [*head, *[0] * (FTP_BYTES - len(head))]
    ftp = talk.scene.dialect.MAVLink_file_transfer_protocol_message
    peer.send(ftp(0, message.get_srcSystem(), message.get_srcComponent(), payload))


ANSWERS = {
    "PING": _ping,
    "SET_GPS_GLOBAL_ORIGIN": _origin,
    "LOG_REQUEST_LIST": _logs,
    "LOG_REQUEST_DATA": _log_data,
    "LOG_ERASE": _log_erase,
    "SERIAL_CONTROL": _serial,
    "FILE_TRANSFER_PROTOCOL": _files,
}
