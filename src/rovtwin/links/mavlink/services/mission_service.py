"""Answers to the messages that upload, download, clear and choose missions and fences."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rovtwin.links.mavlink.firmware.autopilot import INFO, WARNING
from rovtwin.links.mavlink.firmware.missions import (
    ACCEPTED,
    ASK_AGAIN,
    CANCELLED,
    DENIED,
    ERROR,
    FENCE,
    MISSION,
    ON_MAP,
    RALLY,
    SILENT,
    UNSUPPORTED,
    Item,
    fence_fault,
)
from rovtwin.links.mavlink.services.peers import Peer

if TYPE_CHECKING:
    from rovtwin.links.mavlink.services.conversation import Conversation

KEPT = {
    MISSION: "Mission kept; AUTO is not flown here",
    FENCE: "Fence kept; nothing watches over it here",
    RALLY: "Rally points kept; nothing goes there here",
}


def _client(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _acknowledge(talk: "Conversation", message: Any, peer: Peer, result: int, kind: int) -> None:
    peer.send(talk.scene.dialect.MAVLink_mission_ack_message(*_client(message), result, kind))


def _ask(talk: "Conversation", peer: Peer) -> None:
    upload = talk.autopilot.missions.upload
    assert upload is not None
    # ArduSub asks by the older message; it takes an item in either form.
    message = talk.scene.dialect.MAVLink_mission_request_message
    peer.send(message(*upload.client, len(upload.items), upload.kind))


def _listed(talk: "Conversation", message: Any, peer: Peer) -> None:
    missions, kind = talk.autopilot.missions, message.mission_type
    if not missions.knows(kind) or missions.upload is not None:
        _acknowledge(talk, message, peer, DENIED if missions.knows(kind) else UNSUPPORTED, kind)
        return
    count = talk.scene.dialect.MAVLink_mission_count_message
    peer.send(count(*_client(message), len(missions.items(kind)), kind))


def _offered(talk: "Conversation", message: Any, peer: Peer) -> None:
    kind = message.mission_type
    result = talk.autopilot.missions.begin(kind, _client(message), message.count, talk.clock())
    if result == ACCEPTED and message.count:
        talk.uploading = peer
        _ask(talk, peer)
    else:
        _acknowledge(talk, message, peer, result, kind)


def _item(talk: "Conversation", message: Any, peer: Peer) -> None:
    missions, item = talk.autopilot.missions, Item.of(message)
    before = missions.upload
    known = item.command in talk.scene.dialect.enums["MAV_CMD"]
    result = missions.take(item, message.mission_type, message.seq, _client(message), known, talk.clock())
    if result is None:
        _ask(talk, peer)
        return
    _acknowledge(talk, message, peer, result, message.mission_type)
    if result == ACCEPTED:
        talk.tell_once(message.get_srcSystem(), INFO, KEPT[message.mission_type])
    elif result == ERROR and before is not None and missions.upload is None:
        talk.autopilot.say(WARNING, f"Fence refused: {fence_fault(before.items)}")


def _asked(talk: "Conversation", message: Any, peer: Peer) -> None:
    items, kind = talk.autopilot.missions.items(message.mission_type), message.mission_type
    if message.seq >= len(items):
        _acknowledge(talk, message, peer, ERROR, kind)
        return
    fields = asdict(items[message.seq])
    make, scale = talk.scene.dialect.MAVLink_mission_item_int_message, 1
    if message.get_type() == "MISSION_REQUEST":
        make = talk.scene.dialect.MAVLink_mission_item_message
        scale = 10_000_000 if fields["frame"] in ON_MAP else 1
    fields["x"], fields["y"] = (fields[name] if scale == 1 else fields[name] / scale for name in ("x", "y"))
    system, component = _client(message)
    current = int(kind == MISSION and message.seq == talk.autopilot.missions.current)
    peer.send(
        make(
            target_system=system,
            target_component=component,
            seq=message.seq,
            current=current,
            mission_type=kind,
            **fields,
        )
    )


def _cleared(talk: "Conversation", message: Any, peer: Peer) -> None:
    kind = message.mission_type
    # All kinds at once (255) are none that ArduPilot knows.
    result = talk.autopilot.missions.clear(kind)
    _acknowledge(talk, message, peer, result, kind)


def _chosen(talk: "Conversation", message: Any, peer: Peer) -> None:
    choose(talk, message.seq)
    telemetry = talk.telemetry("MISSION_CURRENT")
    for answer in telemetry:
        peer.send(answer)


def choose(talk: "Conversation", sequence: int) -> bool:
    """Set the current item; whether there is one, else a text says that there is not."""
    missions = talk.autopilot.missions
    if missions.choose(sequence):
        return True
    talk.autopilot.say(WARNING, f"No item {sequence}: the mission has {len(missions.items(MISSION))}")
    return False


def _partial(talk: "Conversation", message: Any, peer: Peer) -> None:
    _acknowledge(talk, message, peer, UNSUPPORTED, message.mission_type)


def remind(talk: "Conversation", now: float) -> None:
    """Ask again for an item that does not come, and give up on a client that is silent; `now` is real time [s]."""
    upload, peer = talk.autopilot.missions.upload, talk.uploading
    if upload is None or peer is None:
        return
    if now - upload.active_at > SILENT:
        talk.autopilot.missions.upload = None
        message = talk.scene.dialect.MAVLink_mission_ack_message
        peer.send(message(*upload.client, CANCELLED, upload.kind))
    elif now - upload.asked_at > ASK_AGAIN:
        upload.asked_at = now
        _ask(talk, peer)


ANSWERS = {
    "MISSION_REQUEST_LIST": _listed,
    "MISSION_COUNT": _offered,
    "MISSION_ITEM": _item,
    "MISSION_ITEM_INT": _item,
    "MISSION_REQUEST": _asked,
    "MISSION_REQUEST_INT": _asked,
    "MISSION_CLEAR_ALL": _cleared,
    "MISSION_SET_CURRENT": _chosen,
    "MISSION_REQUEST_PARTIAL_LIST": _partial,
    "MISSION_WRITE_PARTIAL_LIST": _partial,
}
