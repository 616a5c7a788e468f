"""Commands that name a place or a way: go there, turn, stay, come up; where home is."""

import math

from rovtwin.links.mavlink.firmware.guided import GLOBAL, GLOBAL_RELATIVE, Order, order_to
from rovtwin.links.mavlink.modes import GUIDED, POSHOLD
from rovtwin.links.mavlink.services.commands import Request
from rovtwin.links.mavlink.services.results import ACCEPTED, DENIED, FAILED, UNSUPPORTED
from rovtwin.links.mavlink.telemetry.motion_messages import home, origin
from rovtwin.links.mavlink.wire import whole

# MAV_CMD
LOITER, LAND, CONDITION_YAW, SET_HOME, REPOSITION = 17, 21, 115, 179, 192
SURFACE = 9  # ArduSub's mode
CHANGE_MODE = 1  # MAV_DO_REPOSITION_FLAGS
DEGREES = 1e7  # of a COMMAND_INT


def _mode(request: Request, number: int) -> int:
    request.changed = True
    return ACCEPTED if request.talk.autopilot.set_mode(number) else FAILED


def _loiter(request: Request) -> int:
    return _mode(request, POSHOLD.number)


def _land(request: Request) -> int:
    return _mode(request, SURFACE)


def _on_map(request: Request) -> tuple[int, int] | None:
    """Latitude and longitude [1e-7 deg], None where they are no numbers."""
    scale = DEGREES if request.frame is None else 1.0
    x, y = (value * scale for value in request.values[4:6])
    return (round(x), round(y)) if math.isfinite(x) and math.isfinite(y) else None


def _go(request: Request) -> int:
    """DO_REPOSITION, as ArduSub: in GUIDED, or with the flag that changes to it.

    Stricter than ArduSub: while the pilot is there, nobody else takes the vehicle out of the pilot's mode by it.
    """
    autopilot, scene = request.talk.autopilot, request.talk.scene
    if request.frame is None:  # ArduSub has it since 4.7, and never by this message
        return request.refuse("Reposition: by COMMAND_INT only", UNSUPPORTED)
    flags = max(0, whole(request.values[1], 0))
    if autopilot.mode is not GUIDED and not flags & CHANGE_MODE:
        return request.refuse("Reposition: not in GUIDED", DENIED)
    if (
        autopilot.mode is not GUIDED
        and not autopilot.is_pilot(request.by)
        and autopilot.has_pilot(request.talk.clock())
    ):
        return request.refuse(f"Reposition: system {request.by} is not the pilot, who is there", DENIED)
    here, where = scene.place(), _on_map(request)
    if here is None or where is None:
        known = "its latitude and longitude are no numbers" if here else "the vehicle does not know where it is"
        return request.refuse(f"Reposition: {known}", DENIED)
    heading = request.values[3]
    heading = heading if math.isfinite(heading) else here[3]
    order = order_to(*where, request.values[6], request.frame, heading, scene.datum, scene.ground)
    if order.refusal:
        return request.refuse(f"Reposition: {order.refusal}", DENIED)
    request.changed = True
    autopilot.set_mode(GUIDED.number)
    return ACCEPTED if autopilot.obey(request.by, order, request.talk.clock()) else FAILED


def _turn(request: Request) -> int:
    """CONDITION_YAW in GUIDED: to a heading [deg], or by an angle, where it is or is sent to."""
    autopilot, here = request.talk.autopilot, request.talk.scene.place()
    angle, way, relative = request.values[0], request.values[2], request.values[3]
    if not 0.0 <= angle <= 360.0 or relative not in (0.0, 1.0):
        return DENIED
    if autopilot.mode is not GUIDED or here is None:
        return request.refuse("Yaw: not in GUIDED" if here else "Yaw: the vehicle does not know where it is")
    kept = autopilot.target or here
    psi = math.radians(angle) * (-1.0 if relative and way < 0.0 else 1.0) + (here[3] if relative else 0.0)
    request.changed = True
    order = Order(target=(kept[0], kept[1], kept[2], math.remainder(psi, math.tau)))
    return ACCEPTED if autopilot.obey(request.by, order, request.talk.clock()) else FAILED


def _set_home(request: Request) -> int:
    """DO_SET_HOME: here, or a place; no place at all is here, as with ArduPilot. All clients get it."""
    scene = request.talk.scene
    where: tuple[int, int, float] | None = None
    place = _on_map(request)
    if request.values[0] == 1.0 or place == (0, 0):
        here = scene.place()
        where = None if here is None else scene.on_map(*here[:3])
    elif place is not None:
        over = scene.ground if request.frame in GLOBAL_RELATIVE else 0.0
        known = request.frame is None or request.frame in GLOBAL + GLOBAL_RELATIVE
        where = (*place, request.values[6] + over) if known else None
    if where is None or not _is_place(where):
        return request.refuse("Home not set: no such place")
    scene.home_given = (where[0] / DEGREES, where[1] / DEGREES, where[2])
    request.news += [origin(scene), home(scene)]
    return ACCEPTED


def _is_place(where: tuple[int, int, float]) -> bool:
    return abs(where[0]) <= 90e7 and abs(where[1]) <= 180e7 and math.isfinite(where[2]) and abs(where[2]) < 1e4


PLACE_COMMANDS = {LOITER: _loiter, LAND: _land, CONDITION_YAW: _turn, SET_HOME: _set_home, REPOSITION: _go}
