"""Answers of a drone to requests: every one gets one, since the SDK waits for ever for a reply that is lost."""

from collections.abc import Sequence
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.links.blueye.drone.contents import listed
from rovtwin.links.blueye.drone.drone import Drone
from rovtwin.links.blueye.drone.telemetry import Telemetry
from rovtwin.links.blueye.mission.steps import Able
from rovtwin.links.blueye.protobuf import PACKAGE, message, parse
from rovtwin.links.blueye.wire import Request, parse_request, reply_name

CENTURY = (946_684_800.0, 4_102_444_800.0)  # 2000 to 2100: a time to set a clock to [s since 1970]


def answer(frames: Sequence[bytes], drone: Drone, telemetry: Telemetry, address: str, now: float) -> list[bytes]:
    """The two frames of the reply to a request that came from a network address; `now` is real time [s].

    What cannot be parsed gets an empty reply, which says "no" in all replies that can say so.
    """
    name = reply_name(frames)
    try:
        reply = _reply(parse_request(frames), drone, telemetry, address, now)
    except LinkError:
        drone.dropped += 1
        reply = {}
    return [(PACKAGE + name).encode(), message(name)(**reply).SerializeToString()]


def _reply(request: Request, drone: Drone, telemetry: Telemetry, address: str, now: float) -> dict[str, Any]:
    if request.name == "ConnectClient":
        client_id = drone.connect(request.client, address, now)
        return {"client_id": client_id, **_clients(drone)}
    if request.name == "DisconnectClient":
        drone.disconnect(request.client_id)
        return _clients(drone)
    if request.name == "SetPubFrequency":
        return {"success": telemetry.set_rate(request.message_type.removeprefix(PACKAGE), request.frequency)}
    if request.name == "SyncTime":
        return {"success": _set_clock(drone, request.time)}
    if request.name == "GetTelemetry":
        return _payload(telemetry, request.message_type.removeprefix(PACKAGE))
    if request.name == "GetBattery":
        payload = telemetry.build("BatteryTel")
        return {} if payload is None else {"battery": parse("BatteryTel", payload).battery}
    if request.name == "GetCameraParameters":
        return {"camera_parameters": {"camera": request.content.camera}}
    if request.name == "SetMission":
        if drone.may_command(address, now):
            drone.mission.load(request.content.mission, able(drone, telemetry))
        return {}
    if request.name == "GetMission":
        return {} if drone.mission.message is None else {"mission": drone.mission.message}
    # Overlays, storage, thickness gauge, speed tests, motor controllers, vision: the twin has none of them.
    return {}


def able(drone: Drone, telemetry: Telemetry) -> Able:
    """What the drone can do of a mission."""
    contents = telemetry.contents
    fastest = min(drone.fastest[0], drone.reaches[0]), min(drone.fastest[2], drone.reaches[1])
    return Able(contents.datum, drone.can_keep_position, contents.sees_the_floor, drone.here.place, fastest)


def _clients(drone: Drone) -> dict[str, Any]:
    return {"client_id_in_control": drone.clients.in_control, "connected_clients": listed(drone.clients)}


def _set_clock(drone: Drone, time: float) -> bool:
    if not CENTURY[0] <= time <= CENTURY[1]:
        return False
    drone.time_offset += time - drone.clock()
    return True


def _payload(telemetry: Telemetry, name: str) -> dict[str, Any]:
    payload = telemetry.build(name)
    if payload is None:
        return {}
    return {"payload": {"type_url": f"type.googleapis.com/{PACKAGE}{name}", "value": payload}}
