"""What the instructions of a Blueye mission ask for, read from a client's message (mission_planning.proto 3.5).

A mission is refused as a whole, with the reason, where one of its instructions cannot be done; what the twin has no
device for (pictures, a sonar's servo) is left out when its turn comes, as the protocol provides for.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.links.blueye.mission import notes
from rovtwin.links.blueye.mission.steps import ACCEPTANCE, HEAVE, SPEED, Able, Refused, Step

MOST = 50  # instructions of a mission, as the SDK has it
MOST_POINTS = 500  # way-points of a mission, those of surveys counted
FARTHEST = 1000.0  # from one way-point to the next [m]; a drone's own limit is not published
DEEPEST = 500.0  # [m], deeper than any Blueye goes
TILT = 30.0  # of the camera, up and down [deg]
WIDEST = 100.0  # circle of acceptance [m]
SLOWEST, FASTEST = 0.02, 2.0  # [m/s]
LONGEST_WAIT = 3600.0  # [s]
SEABED_ALTITUDE = 0.5  # at which "go to the seabed" ends [m]; a drone's own is not published
SURFACE, SEABED = 1, 2  # what a depth is counted from


def steps_of(mission: Any, able: Able) -> list[Step]:
    """The steps of a mission.

    Args:
        mission: Protobuf message of the protocol.
        able: What the drone can do.

    Raises:
        Refused: Something of it cannot be done; says which instruction, and why.
    """
    if not mission.instructions:
        raise Refused("a mission without instructions")
    if len(mission.instructions) > MOST:
        raise Refused(f"{len(mission.instructions)} instructions, expected at most {MOST}")
    points = sum(_points(instruction) for instruction in mission.instructions)
    if points > MOST_POINTS:  # before they are converted, which takes its time
        raise Refused(f"{points} way-points, expected at most {MOST_POINTS}")
    steps: list[Step] = []
    for number, instruction in enumerate(mission.instructions):
        kind = instruction.WhichOneof("command")
        try:
            read = _READERS.get(kind or "")
            if kind is None or read is None:
                raise Refused("no command in it, or one that protocol 3.5 has not")
            steps += read(_Reader(mission, number, instruction.id, able), getattr(instruction, kind))
        except Refused as refused:
            what = (kind or "unknown").removesuffix("_command")
            raise Refused(f"instruction {number + 1} ({what}): {refused}", refused.notification) from None
    _check_ways(steps, able)
    return steps


def too_fast(steps: list[Step], able: Able) -> Iterator[str]:
    """What is asked of the drone that it does not reach, for people; it is flown all the same, as fast as it can."""
    ahead = [(step.speed, step.number + 1) for step in steps if step.place is not None]
    dive = [(step.heave, step.number + 1) for step in steps if step.depth is not None or step.altitude is not None]
    for asked, reached, way in ((ahead, able.fastest[0], "ahead"), (dive, able.fastest[1], "up and down")):
        beyond = sorted({number for speed, number in asked if speed > 1.01 * reached})
        if beyond:
            most = max(speed for speed, _ in asked)
            who = f"instruction{'s' if len(beyond) > 1 else ''} {', '.join(map(str, beyond))}"
            yield f"{who}: up to {most:.2f} m/s {way} asked for, the drone reaches {reached:.2f} m/s: slower then"


def _check_ways(steps: list[Step], able: Able) -> None:
    before = able.here
    for step in steps:
        if step.place is None:
            continue
        way = 0.0 if before is None else math.dist(before, step.place)
        if way > FARTHEST:
            raise Refused(
                f"instruction {step.number + 1}: a way of {way:.0f} m to its place, expected at most {FARTHEST:.0f} m. "
                "Is the scenario's datum (datum.latitude, datum.longitude) where the mission is?",
                notes.TOO_FAR,
            )
        before = step.place


class _Reader:
    """Reads one instruction."""

    def __init__(self, mission: Any, number: int, id: int, able: Able):
        self.able, self.number, self.id = able, number, id
        self._mission = mission

    def step(self, **what: Any) -> Step:
        return Step(self.number, self.id, **what)

    def speed(self, asked: float, default: float) -> float:
        """A speed [m/s]; zero stands for the mission's own."""
        value = _number(asked, "speed") or default
        if not SLOWEST - 1e-6 <= value <= FASTEST:  # it came as a float of 32 bits
            raise Refused(f"speed {value:g} m/s, expected {SLOWEST:g} to {FASTEST:g}, or 0 for the mission's own")
        return value

    @property
    def surge(self) -> float:
        return self.speed(self._mission.default_surge_speed, SPEED)

    @property
    def heave(self) -> float:
        return self.speed(self._mission.default_heave_speed, HEAVE)

    def level(self, point: Any) -> dict[str, Any]:
        """Depth or altitude of a set-point, and the speed there."""
        depth = _number(point.depth, "depth")
        if not 0.0 <= depth <= DEEPEST:
            raise Refused(f"depth or altitude {depth:g} m, expected 0 to {DEEPEST:g}", notes.TOO_DEEP)
        speed = self.speed(point.speed_to_depth, self.heave)
        if point.depth_zero_reference == SEABED:
            self.needs_altitude()
            return {"altitude": depth, "heave": speed}
        return {"depth": depth, "heave": speed}

    def needs_altitude(self) -> None:
        if not self.able.altitude:
            raise Refused("the drone measures no altitude: it needs an altimeter (sensors.altimeter and world.floor)")

    def needs_position(self) -> None:
        if not self.able.position:
            raise Refused("the drone does not know its position, as half of a pair does not", notes.UNKNOWN_POSITION)

    def place(self, where: Any) -> tuple[float, float]:
        self.needs_position()
        if self.able.datum is None:
            raise Refused("the twin has no place on the map", notes.UNKNOWN_POSITION)
        latitude, longitude = _number(where.latitude, "latitude"), _number(where.longitude, "longitude")
        try:
            north, east, _ = self.able.datum.position(latitude, longitude, 0.0).tolist()
        except ConfigError as error:
            raise Refused(str(error)) from None
        return north, east

    def acceptance(self, asked: float) -> float:
        """Radius around a place [m]; zero stands for the mission's own."""
        own = _number(self._mission.default_circle_of_acceptance, "circle of acceptance")
        value = _number(asked, "circle of acceptance") or own or ACCEPTANCE
        if not 0.0 < value <= WIDEST:
            raise Refused(f"circle of acceptance {value:g} m, expected more than 0 and at most {WIDEST:g}")
        return value

    def waypoint(self, point: Any) -> Step:
        what: dict[str, Any] = {
            "place": self.place(point.global_position),
            "speed": self.speed(point.speed_to_target, self.surge),
            "acceptance": self.acceptance(point.circle_of_acceptance),
        }
        with_depth = point.HasField("depth_set_point")
        level = self.level(point.depth_set_point) if with_depth else {}
        begins = notes.GO_WAYPOINT_DEPTH if with_depth else notes.GO_WAYPOINT
        return self.step(begins=begins, ends=notes.WAYPOINT_REACHED, **what, **level)


def _points(instruction: Any) -> int:
    kind = instruction.WhichOneof("command")
    return len(instruction.survey_command.waypoints) if kind == "survey_command" else kind == "waypoint_command"


def _number(value: float, what: str) -> float:
    if not math.isfinite(value):
        raise Refused(f"{what}: expected a finite number")
    return float(value)


def _waypoint(reader: _Reader, command: Any) -> Iterator[Step]:
    yield reader.waypoint(command.waypoint)


def _survey(reader: _Reader, command: Any) -> Iterator[Step]:
    """The way-points that the planner computed, as the protocol wants it; nothing is planned here."""
    if not command.waypoints:
        raise Refused("a survey without way-points; the client's planner makes them")
    for point in command.waypoints:
        yield reader.waypoint(point)


def _depth(reader: _Reader, command: Any) -> Iterator[Step]:
    level = reader.level(command.depth_set_point)
    yield reader.step(
        begins=notes.GO_DEPTH, ends=notes.ALTITUDE_REACHED if "altitude" in level else notes.DEPTH_REACHED, **level
    )


def _surface(reader: _Reader, command: Any) -> Iterator[Step]:
    heave = reader.speed(command.desired_speed, reader.heave)
    yield reader.step(begins=notes.GO_SURFACE, ends=notes.DEPTH_REACHED, depth=0.0, heave=heave)


def _seabed(reader: _Reader, command: Any) -> Iterator[Step]:
    reader.needs_altitude()
    heave = reader.speed(command.desired_speed, reader.heave)
    yield reader.step(begins=notes.GO_SEABED, ends=notes.ALTITUDE_REACHED, altitude=SEABED_ALTITUDE, heave=heave)


def _home(reader: _Reader, command: Any) -> Iterator[Step]:
    """Home is where the position is zero."""
    reader.needs_position()
    speed = reader.speed(command.desired_speed, reader.surge)
    yield reader.step(begins=notes.GO_HOME, ends=notes.WAYPOINT_REACHED, place=(0.0, 0.0), speed=speed)


def _wait(reader: _Reader, command: Any) -> Iterator[Step]:
    seconds = _number(command.wait_for_seconds, "wait")
    if not 0.0 <= seconds <= LONGEST_WAIT:
        raise Refused(f"wait {seconds:g} s, expected 0 to {LONGEST_WAIT:g}")
    yield reader.step(begins=notes.WAIT, wait=seconds)


def _tilt(reader: _Reader, command: Any) -> Iterator[Step]:
    angle = _number(command.tilt_angle.value, "tilt")
    if abs(angle) > TILT:
        raise Refused(f"tilt {angle:g} degrees, expected -{TILT:g} to {TILT:g}")
    yield reader.step(begins=notes.SET_TILT, tilt=angle)


def _camera(reader: _Reader, command: Any) -> Iterator[Step]:
    yield reader.step(begins=notes.CAMERA, skipped="the twin's drone takes no pictures and no video")


def _multibeam(reader: _Reader, command: Any) -> Iterator[Step]:
    yield reader.step(begins=notes.SET_MULTIBEAM, skipped="the twin's drone has no multibeam sonar")


def _modes(reader: _Reader, command: Any) -> Iterator[Step]:
    """Vertical: 1 by hand, 2 auto depth, 3 auto altitude; horizontal: 1 by hand, 2 auto heading, 3 station keeping."""
    vertical, horizontal = command.control_mode_vertical, command.control_mode_horizontal
    if vertical == 3:
        raise Refused("auto altitude, which the twin's drone has not")
    if horizontal == 3:
        reader.needs_position()
    modes = [("auto_depth", vertical == 2)] if vertical else []
    if horizontal:
        modes += [("auto_heading", horizontal >= 2), ("station_keeping", horizontal == 3)]
    yield reader.step(modes=tuple(modes))


_READERS: dict[str, Callable[[_Reader, Any], Iterator[Step]]] = {
    "waypoint_command": _waypoint,
    "survey_command": _survey,
    "depth_set_point_command": _depth,
    "go_to_surface_command": _surface,
    "go_to_seabed_command": _seabed,
    "go_to_home_command": _home,
    "wait_for_command": _wait,
    "tilt_main_camera_command": _tilt,
    "tilt_multibeam_command": _multibeam,
    "camera_command": _camera,
    "control_mode_command": _modes,
}
