"""Missions of a Blueye drone: what instructions ask for, and how they are flown by a vehicle that follows its target.

Times are made up; the messages are the vendor's own (blueye.protocol 3.5).
"""

import math
from dataclasses import replace

import blueye.protocol as bp
import pytest
from blueye.sdk.mission import create_waypoint_instruction, prepare_new_mission
from tests.links.blueye.vehicle import readings

from rovtwin.core.datum import Datum
from rovtwin.links.blueye.drone.drone import About, Drone
from rovtwin.links.blueye.drone.telemetry import KNOWN, SENSED, Telemetry
from rovtwin.links.blueye.mission import instructions, notes
from rovtwin.links.blueye.mission import supervisor as m
from rovtwin.links.blueye.mission.instructions import steps_of
from rovtwin.links.blueye.mission.status import status_of
from rovtwin.links.blueye.mission.steps import Able, Refused, Step
from rovtwin.links.blueye.mission.supervisor import Here, Supervisor
from rovtwin.links.blueye.services.answers import answer
from rovtwin.links.blueye.wire import Client, MissionOrder, Motion, ResetOdometer, Watchdog
from rovtwin.simulation.vehicle_firmware import FREQUENCY, INTEGRAL, RATE, REACH

DATUM = Datum(63.4415, 10.4174)
ABLE = Able(DATUM, position=True, altitude=True, here=(0.0, 0.0))
FLOOR, DT = 12.0, 0.1


def instruction(**command) -> bp.Instruction:
    return bp.Instruction(**command)


def waypoint(north: float, east: float, depth: float, **more) -> bp.Instruction:
    latitude, longitude, _ = DATUM.geodetic([north, east, 0.0])
    return create_waypoint_instruction("A", float(latitude), float(longitude), depth, **more)


def mission(*instructions: bp.Instruction, **more) -> object:
    made = prepare_new_mission(list(instructions), 7, "trial")
    for key, value in more.items():
        setattr(made, key, value)
    return bp.Mission.pb(made)


class Vehicle:
    """With mass, drag and little force, over a floor at 12 m; keeps its target as `vehicle_firmware` does, by axis.

    It turns at 1 rad/s at most. Its top speed is the square root of force over drag, 0.39 m/s.
    """

    MASS, DRAG, FORCE = 15.0, 66.0, 10.0  # [kg, N s2/m2, N]
    TOP = math.sqrt(FORCE / DRAG)

    def __init__(self, supervisor: Supervisor, able: float = 1.0):
        self.supervisor, self.able = supervisor, able  # share of the force that it can give
        self.heading = self.t = 0.0
        self.pose, self.nu, self.integral = [0.0, 0.0, 1.0], [0.0] * 3, [0.0] * 3  # n; b, heading only
        self._aimed, self._held = False, (0.0, 0.0, 1.0, 0.0)
        self.knows_place = self.sees_floor = True
        self.way: list[tuple[float, float, float]] = []
        self.notes: list[notes.Note] = []

    @property
    def north(self) -> float:
        return self.pose[0]

    @property
    def east(self) -> float:
        return self.pose[1]

    @property
    def depth(self) -> float:
        return self.pose[2]

    @property
    def here(self) -> Here:
        place = (self.north, self.east) if self.knows_place else None
        altitude = FLOOR - self.depth if self.sees_floor else None
        return Here(self.t, place, self.depth, self.heading, altitude)

    def live(self, seconds: float) -> None:
        for _ in range(round(seconds / DT)):
            self.t += DT
            self._push(self.supervisor.target)
            self.supervisor.look(self.here)
            self.notes += self.supervisor.taken_notes()
            self.way.append((self.north, self.east, self.depth))

    def _push(self, target: tuple[float, float, float, float] | None) -> None:
        if target is None and self._aimed:
            self._held = (*self.pose, self.heading)
        self._aimed, goal = target is not None, target or self._held
        rate = self._along(self.supervisor.velocity if target else (0.0, 0.0, 0.0))
        over = max(1.0, *(abs(r) / most for r, most in zip(rate[:2], RATE[:2], strict=True)))
        rate = rate[0] / over, rate[1] / over, max(-RATE[2], min(RATE[2], rate[2]))
        away = self._along(tuple(g - p for g, p in zip(goal[:3], self.pose, strict=True)))
        for i in range(3):
            e, w = max(-REACH[i], min(REACH[i], away[i])), FREQUENCY[i]
            asked = self.MASS * (w**2 * e + 2.0 * w * (rate[i] - self.nu[i])) + self.integral[i]
            most = self.FORCE * self.able
            if abs(asked) < most:
                self.integral[i] += self.MASS * INTEGRAL * w**3 * e * DT
            force = max(-most, min(most, asked)) - self.DRAG * abs(self.nu[i]) * self.nu[i]
            self.nu[i] += DT * force / self.MASS
        moved = self._along((*self.nu,), -1.0)
        self.pose = [p + DT * v for p, v in zip(self.pose, moved, strict=True)]
        self.heading += max(-DT, min(DT, math.remainder(goal[3] - self.heading, math.tau)))

    def _along(self, v: tuple[float, ...], way: float = 1.0) -> tuple[float, float, float]:
        """From n to ahead, starboard, down; with -1 back."""
        c, s = math.cos(self.heading), way * math.sin(self.heading)
        return c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]

    def texts(self, kind: int) -> list[str]:
        return [note.text for note in self.notes if note.kind == kind]


@pytest.fixture
def vehicle() -> Vehicle:
    return Vehicle(Supervisor())


def start(vehicle: Vehicle, *instructions: bp.Instruction, able: Able = ABLE, **more) -> Supervisor:
    supervisor = vehicle.supervisor
    supervisor.load(mission(*instructions, **more), able)
    assert supervisor.state == m.READY, supervisor.notes
    supervisor.run(vehicle.here, armed=True)
    return supervisor


def test_waypoints_are_reached_one_after_the_other_at_their_speed(vehicle):
    supervisor = start(vehicle, waypoint(10.0, 0.0, 3.0, speed_to_target=0.3), waypoint(10.0, 10.0, 3.0))
    vehicle.live(10.0)
    assert 2.2 < vehicle.north < 3.1 and abs(vehicle.east) < 0.1 and supervisor.state == m.RUNNING
    vehicle.live(60.0)
    assert supervisor.state == m.COMPLETED
    assert min(math.dist(place, (10.0, 0.0, 3.0)) for place in vehicle.way) < 1.1
    assert math.dist((vehicle.north, vehicle.east, vehicle.depth), (10.0, 10.0, 3.0)) < 1.3
    assert [note.kind for note in vehicle.notes] == [notes.LOADED, notes.STARTED, 20, 9, 20, 9, notes.COMPLETE]
    assert set(supervisor.modes) == {("auto_depth", True), ("auto_heading", True), ("station_keeping", True)}


@pytest.mark.parametrize("asked", [0.2, 0.3, 0.6, 2.0])
def test_leg_is_flown_at_the_speed_that_is_asked_for_or_the_vehicles_own(vehicle, asked):
    """20 m, from rest to the circle of acceptance, at 80 % of it."""
    supervisor = start(vehicle, waypoint(20.0, 0.0, 1.0, speed_to_target=asked))
    while supervisor.state == m.RUNNING and vehicle.t < 300.0:
        vehicle.live(DT)
    assert supervisor.state == m.COMPLETED
    assert 0.8 < vehicle.north / vehicle.t / min(asked, vehicle.TOP) < 1.05
    assert max(abs(east) for _, east, _ in vehicle.way) < 0.05


def test_vehicle_stays_where_the_mission_ends(vehicle):
    """What it was asked for on the way is not asked for any more."""
    supervisor = start(vehicle, waypoint(10.0, 0.0, 1.0, speed_to_target=0.6), waypoint(10.0, 0.0, 4.0))
    while len(vehicle.texts(notes.WAYPOINT_REACHED)) < 1:
        vehicle.live(DT)
    vehicle.live(0.5)
    assert supervisor.velocity[:2] == (0.0, 0.0) and supervisor.velocity[2] > 0.0
    vehicle.live(30.0)
    assert supervisor.state == m.COMPLETED and math.dist((vehicle.north, vehicle.east), (10.0, 0.0)) < 1.2


def test_speed_that_the_drone_does_not_reach_is_warned_of(vehicle):
    slow = replace(ABLE, fastest=(0.39, 0.3))
    points = [waypoint(5.0 * k, 0.0, 1.0, speed_to_target=speed) for k, speed in enumerate((0.2, 0.6, 2.0))]
    vehicle.supervisor.load(mission(*points), slow)
    assert vehicle.supervisor.state == m.READY
    (warning,) = [note for note in vehicle.supervisor.notes if note.level == notes.WARNING]
    assert warning.text == "instructions 2, 3: up to 2.00 m/s ahead asked for, the drone reaches 0.39 m/s: slower then"
    vehicle.supervisor.load(mission(points[0]), slow)
    assert len(vehicle.supervisor.notes) == 3


def test_example_of_the_seabed(vehicle):
    """As the SDK's example: to the seabed, a picture, to the surface."""
    take = instruction(camera_command={"camera_action": bp.CameraAction.CAMERA_ACTION_TAKE_PHOTO})
    down, up = (instruction(**{f"go_to_{end}_command": {"desired_speed": 0.3}}) for end in ("seabed", "surface"))
    supervisor = start(vehicle, down, take, up)
    vehicle.live(90.0)
    assert supervisor.state == m.COMPLETED
    assert max(depth for *_, depth in vehicle.way) == pytest.approx(FLOOR - 0.5, abs=0.35) and vehicle.depth < 0.3
    assert "no pictures" in vehicle.texts(notes.SKIPPED)[0]
    assert abs(vehicle.north) < 0.01 and abs(vehicle.east) < 0.01


def test_example_of_the_tilt(vehicle):
    """As the SDK's example: angles one after the other, four seconds each; the vehicle is left alone."""
    tilts = [instruction(tilt_main_camera_command={"tilt_angle": {"value": value}}) for value in (30.0, -30.0)]
    wait = instruction(wait_for_command={"wait_for_seconds": 4})
    supervisor = start(vehicle, tilts[0], wait, tilts[1], wait)
    seen = []
    for _ in range(9):
        vehicle.live(1.0)
        seen.append(supervisor.tilt)
    assert seen[0] == 30.0 and seen[-1] == -30.0 and supervisor.state == m.COMPLETED
    assert supervisor.target is None and not supervisor.modes


def test_altitude_depth_home_and_survey(vehicle):
    over = {"depth": 2.0, "depth_zero_reference": bp.DepthZeroReference.DEPTH_ZERO_REFERENCE_SEABED}
    points = [waypoint(4.0, east, 5.0).waypoint_command.waypoint for east in (0.0, 3.0)]
    supervisor = start(
        vehicle,
        instruction(depth_set_point_command={"depth_set_point": over}),
        instruction(survey_command={"waypoints": points}),
        instruction(go_to_home_command={"desired_speed": 0.5}),
        default_heave_speed=0.5,
    )
    vehicle.live(45.0)
    assert vehicle.texts(11) and max(depth for *_, depth in vehicle.way) == pytest.approx(10.0, abs=0.35)
    vehicle.live(120.0)
    assert supervisor.state == m.COMPLETED and math.hypot(vehicle.north, vehicle.east) < 1.1
    assert min(math.dist(place, (4.0, 3.0, 5.0)) for place in vehicle.way) < 1.4
    assert [note.kind for note in vehicle.notes if note.kind in (8, 9, 10, 11)] == [11, 9, 9]  # a survey is one


def test_control_modes_are_the_drones(vehicle):
    vertical = bp.ControlModeVertical.CONTROL_MODE_VERTICAL_AUTO_DEPTH
    horizontal = bp.ControlModeHorizontal.CONTROL_MODE_HORIZONTAL_STATION_KEEPING
    command = {"control_mode_vertical": vertical, "control_mode_horizontal": horizontal}
    supervisor = start(vehicle, instruction(control_mode_command=command))
    vehicle.live(0.2)
    assert supervisor.modes == [("auto_depth", True), ("auto_heading", True), ("station_keeping", True)]


@pytest.mark.parametrize(
    ("instructions", "able", "text", "kind"),
    [
        ([], ABLE, "without instructions", notes.FAILED_TO_LOAD),
        ([instruction()], ABLE, "no command", notes.FAILED_TO_LOAD),
        ([waypoint(5000.0, 0.0, 1.0)], ABLE, "way of 5000 m.*datum.latitude", notes.TOO_FAR),
        ([waypoint(5.0, 0.0, 900.0)], ABLE, "900 m, expected 0 to 500", 13),
        ([waypoint(5.0, 0.0, 1.0)], Able(DATUM, False, True, None), "half of a pair", notes.UNKNOWN_POSITION),
        ([waypoint(5.0, 0.0, 1.0)], Able(None, True, True, None), "no place on the map", notes.UNKNOWN_POSITION),
        ([waypoint(5.0, 0.0, math.nan)], ABLE, "finite", notes.FAILED_TO_LOAD),
        ([waypoint(5.0, 0.0, 1.0, speed_to_target=30.0)], ABLE, "speed 30 m/s", notes.FAILED_TO_LOAD),
        (
            [instruction(go_to_seabed_command={})],
            Able(DATUM, True, False, None),
            "sensors.altimeter",
            notes.FAILED_TO_LOAD,
        ),
        ([instruction(tilt_main_camera_command={"tilt_angle": {"value": 50}})], ABLE, "tilt 50", notes.FAILED_TO_LOAD),
        ([instruction(wait_for_command={"wait_for_seconds": -1})], ABLE, "wait -1", notes.FAILED_TO_LOAD),
        ([instruction(survey_command={"lane_spacing": 2.0})], ABLE, "planner", notes.FAILED_TO_LOAD),
        ([instruction(control_mode_command={"control_mode_vertical": 3})], ABLE, "auto altitude", notes.FAILED_TO_LOAD),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_reason(instructions, able, text, kind):
    with pytest.raises(Refused, match=text) as refused:
        steps_of(mission(*instructions), able)
    assert refused.value.notification == kind
    supervisor = Supervisor()
    supervisor.load(mission(*instructions), able)
    assert supervisor.state == m.FAILED_TO_LOAD and kind in [note.kind for note in supervisor.notes]
    supervisor.run(Here(0.0), armed=True)
    assert supervisor.state == m.FAILED_TO_LOAD and supervisor.notes[-1].kind == notes.NONE_LOADED


EXTREME = [
    (
        *(waypoint(10.0 * (k % 2), 0.0, 500.0, speed_to_target=0.02) for k in range(25)),
        *(instruction(wait_for_command={"wait_for_seconds": 3600}) for _ in range(25)),
    ),
    (instruction(wait_for_command={"wait_for_seconds": 1}, id=2**32 - 1),),
    (waypoint(999.0, 0.0, 0.0, speed_to_target=2.0),),
    (instruction(tilt_main_camera_command={"tilt_angle": {"value": -30.0}}),),
]


@pytest.mark.parametrize("instructions", EXTREME)
@pytest.mark.parametrize("after", [0.0, 1.0, 1e12])
def test_every_telemetry_message_is_built_after_every_mission(instructions, after):
    drone, failures = Drone("", About(), 2.0, can_keep_position=True), []
    telemetry = Telemetry(drone, DATUM, failures.append)
    drone.mission.load(mission(*instructions, id=2**32 - 1, name="n" * 1000), ABLE)
    assert drone.mission.state == m.READY
    drone.mission.run(Here(0.0, (0.0, 0.0), 1.0, 0.0, 11.0), armed=True)
    drone.mission.look(Here(after, (0.0, 0.0), 1.0, 0.0, 11.0))
    drone.mission._elapsed = after  # years of looks
    for note in drone.mission.taken_notes():
        telemetry.contents.note = note, 1.7e9
        assert telemetry.build("NotificationTel")
    taken = {name for name, _ in telemetry.take(0.0, readings(0.0, estimate=[1.0] * 12))}
    assert taken >= set(SENSED) | set(KNOWN) and not failures
    status = bp.MissionStatusTel.deserialize(telemetry.build("MissionStatusTel") or b"").mission_status
    assert status.id == 2**32 - 1 and status.time_elapsed in (int(after), 2**32 - 1)


@pytest.mark.parametrize("speed", [1e-9, 0.019, -0.1])
def test_speeds_that_never_arrive_are_refused(speed):
    with pytest.raises(Refused, match="expected 0.02 to 2"):
        steps_of(mission(waypoint(0.0, 0.0, 1.0), waypoint(10.0, 0.0, 1.0, speed_to_target=speed)), ABLE)


def test_status_of_ways_without_end_is_carried():
    steps = [Step(0, 1, place=(0.0, 0.0)), Step(1, 2, place=(1e300, 0.0), speed=1e-9, wait=math.inf)]
    counts = status_of(steps, 0, math.inf)
    assert bp.MissionStatus.pb(bp.MissionStatus(**counts)).estimated_time_to_complete == 2**32 - 1


def test_message_that_cannot_be_built_is_left_out_and_reported_once():
    failures = []
    drone = Drone("", About(), 2.0)
    telemetry = Telemetry(drone, None, failures.append)
    drone.mission.tilt = "no number"  # pyright: ignore[reportAttributeAccessIssue]
    names = [name for _ in range(3) for name, _ in telemetry.take(float(len(failures)), [])]
    assert telemetry.build("TiltAngleTel") is None and "MissionStatusTel" in names and "TiltAngleTel" not in names
    assert len(failures) == 1 and "TiltAngleTel cannot be built" in failures[0]


def survey(count: int) -> bp.Instruction:
    return instruction(survey_command={"waypoints": [waypoint(1.0, 0.0, 1.0).waypoint_command.waypoint] * count})


def test_too_many_waypoints_are_refused_before_they_are_converted(monkeypatch):
    assert len(steps_of(mission(survey(499), waypoint(1.0, 0.0, 1.0)), ABLE)) == 500
    monkeypatch.setattr(Datum, "position", lambda *_: pytest.fail("converted"))
    for many in ((survey(501),), (survey(250), survey(250), waypoint(1.0, 0.0, 1.0))):
        with pytest.raises(Refused, match="501 way-points, expected at most 500"):
            steps_of(mission(*many), ABLE)


@pytest.mark.parametrize("radius", [-1.0, 100.1, 1e30])
def test_circles_of_acceptance(radius):
    point = waypoint(1.0, 0.0, 1.0)
    point.waypoint_command.waypoint.circle_of_acceptance = 0.0
    with pytest.raises(Refused, match="circle of acceptance .* at most 100"):
        steps_of(mission(point, default_circle_of_acceptance=radius), ABLE)
    point.waypoint_command.waypoint.circle_of_acceptance = radius
    with pytest.raises(Refused, match="circle of acceptance .* at most 100"):
        steps_of(mission(point), ABLE)


def test_command_that_is_not_known_is_refused(monkeypatch):
    """As one of a later protocol would be, with a package that knows it."""
    monkeypatch.delitem(instructions._READERS, "go_to_home_command")
    with pytest.raises(Refused, match="instruction 1 .go_to_home.: no command"):
        steps_of(mission(instruction(go_to_home_command={})), ABLE)


def test_too_many_instructions():
    many = bp.Mission.pb(bp.Mission(instructions=[instruction(wait_for_command={"wait_for_seconds": 1})] * 51))
    with pytest.raises(Refused, match="51 instructions, expected at most 50"):
        steps_of(many, ABLE)


def test_thrusters_off_and_unknown_places_do_not_start(vehicle):
    vehicle.supervisor.load(mission(waypoint(5.0, 0.0, 2.0)), ABLE)
    vehicle.supervisor.run(vehicle.here, armed=False)
    assert vehicle.supervisor.state == m.FAILED_TO_START and "watchdog" in vehicle.supervisor.notes[-1].text
    vehicle.supervisor.load(mission(waypoint(5.0, 0.0, 2.0)), ABLE)
    vehicle.knows_place = False
    vehicle.supervisor.run(vehicle.here, armed=True)
    assert vehicle.supervisor.state == m.FAILED_TO_START and vehicle.supervisor.target is None


def test_pause_and_go_on(vehicle):
    supervisor = start(vehicle, waypoint(10.0, 0.0, 1.0))
    vehicle.live(5.0)
    supervisor.pause("for a look")
    assert supervisor.state == m.PAUSED and supervisor.target is None
    there = vehicle.north
    vehicle.live(5.0)
    assert abs(vehicle.north - there) < 0.5
    supervisor.load(mission(waypoint(1.0, 0.0, 1.0)), ABLE)
    assert supervisor.state == m.PAUSED and "clear it first" in supervisor.notes[-1].text
    supervisor.run(vehicle.here, armed=True)
    vehicle.live(30.0)
    assert supervisor.state == m.COMPLETED and notes.RESUMED in [note.kind for note in vehicle.notes]


def test_stuck_vehicle_ends_the_mission(vehicle):
    supervisor = start(vehicle, waypoint(10.0, 0.0, 1.0))
    vehicle.live(3.0)
    vehicle.able, vehicle.nu = 0.0, [0.0] * 3  # in a net
    vehicle.live(40.0)
    assert (
        supervisor.state == m.ABORTED and "no progress" in vehicle.texts(notes.STUCK)[0] and supervisor.target is None
    )


@pytest.mark.parametrize("lost", ["knows_place", "sees_floor"])
def test_what_a_step_needs_and_has_not_for_a_while_ends_the_mission(vehicle, lost):
    over = {"depth": 2.0, "depth_zero_reference": bp.DepthZeroReference.DEPTH_ZERO_REFERENCE_SEABED}
    point = waypoint(20.0, 0.0, 1.0)
    point.waypoint_command.waypoint.depth_set_point = bp.DepthSetPoint(over)
    supervisor = start(vehicle, point)
    vehicle.live(3.0)
    setattr(vehicle, lost, False)
    vehicle.live(4.0)
    assert supervisor.state == m.RUNNING
    vehicle.live(3.0)
    assert supervisor.state == m.ABORTED and "unknown for 5 s" in vehicle.texts(notes.ABORTED_NOW)[0]


def test_vehicle_is_not_pushed_on_while_its_place_is_unknown(vehicle):
    supervisor = start(vehicle, waypoint(20.0, 0.0, 1.0, speed_to_target=0.3))
    vehicle.live(5.0)
    assert supervisor.velocity[0] == pytest.approx(0.3, abs=1e-3)
    vehicle.knows_place = False
    vehicle.live(DT)
    assert supervisor.velocity == (0.0, 0.0, 0.0) and supervisor.state == m.RUNNING
    vehicle.knows_place = True
    vehicle.live(DT)
    assert supervisor.velocity[0] == pytest.approx(0.3, abs=1e-3)


def test_dive_without_a_position_does_not_lead_to_the_origin(vehicle):
    """A drone that has positions begins where it is, or not at all; half of a pair has none and only dives."""
    dive = instruction(depth_set_point_command={"depth_set_point": {"depth": 9.0}})
    vehicle.pose, vehicle.knows_place = [40.0, -30.0, 1.0], False
    vehicle.supervisor.load(mission(dive), ABLE)
    vehicle.supervisor.run(vehicle.here, armed=True)
    assert vehicle.supervisor.state == m.FAILED_TO_START and vehicle.supervisor.target is None
    assert vehicle.supervisor.notes[-1].kind == notes.UNKNOWN_POSITION
    vehicle.supervisor.load(mission(dive), replace(ABLE, position=False))
    vehicle.supervisor.run(vehicle.here, armed=True)
    assert vehicle.supervisor.state == m.RUNNING and vehicle.supervisor.target is not None


def test_place_that_is_lost_before_a_dive_begins_is_waited_for(vehicle):
    dive = instruction(depth_set_point_command={"depth_set_point": {"depth": 3.0}})
    supervisor = start(vehicle, instruction(wait_for_command={"wait_for_seconds": 1}), dive)
    vehicle.pose = [40.0, -30.0, 1.0]
    vehicle._held = (*vehicle.pose, 0.0)
    vehicle.knows_place = False
    vehicle.live(2.0)
    assert supervisor.state == m.RUNNING and supervisor.target is None
    vehicle.knows_place = True
    vehicle.live(DT)
    assert supervisor.target is not None and supervisor.target[:2] == (40.0, -30.0)


def test_status(vehicle):
    supervisor = start(vehicle, waypoint(10.0, 0.0, 1.0), waypoint(10.0, 30.0, 1.0))
    vehicle.live(40.0)
    status = supervisor.status()
    assert status["state"] == m.RUNNING and status["completed_instruction_ids"] == [0] and status["id"] == 7
    assert status["time_elapsed"] in (39, 40) and status["total_number_of_instructions"] == 2
    vehicle.live(90.0)
    assert (
        supervisor.status()["completed_instruction_ids"] == [0, 1] and supervisor.status()["distance_to_complete"] == 0
    )
    supervisor.clear()
    assert supervisor.status()["state"] == m.INACTIVE and supervisor.message is None


# In the drone

HOST = "10.0.0.1"


@pytest.fixture
def drone() -> Drone:
    """With a pilot, armed, and on its way."""
    drone = Drone("", About(), watchdog_s=2.0, can_keep_position=True)
    drone.connect(Client(), HOST, 0.0)
    drone.obey(Watchdog(1), HOST, 0.0)
    drone.fly(Here(0.0, (0.0, 0.0), 1.0, 0.0, 11.0))
    drone.mission.load(mission(waypoint(10.0, 0.0, 1.0)), ABLE)
    drone.obey(MissionOrder("run"), HOST, 0.1)
    assert drone.command().target is not None
    return drone


def test_pilots_stick_pauses_the_mission_and_the_vehicle_holds(drone):
    drone.obey(Motion((0.0,) * 6), HOST, 0.2)  # as the SDK sends it when it connects
    assert drone.mission.state == m.RUNNING
    drone.obey(Motion((0.0, 0.0, 0.3, 0.0, 0.0, 0.0)), HOST, 0.3)
    order = drone.command()
    assert drone.mission.state == m.PAUSED and order.target is None and order.motion[2] == 0.3
    assert order.hold_depth and order.hold_heading and order.hold_position


def test_sticks_move_with_the_target(drone):
    """Turned to the north-east, a target that moves north is ahead and to port."""
    drone.fly(Here(0.1, (0.0, 0.0), 1.0, math.pi / 4, 11.0))
    order = drone.command()
    speed = 0.6 * math.cos(math.pi / 4)  # as far as it faces where it goes
    share = speed * math.cos(math.pi / 4) / 0.5
    assert order.motion == pytest.approx((share, -share, 0.0, 0.0, 0.0, 0.0)) and order.target[0] == pytest.approx(
        0.1 * speed
    )


def test_watchdog_that_runs_out_ends_the_mission(drone):
    assert drone.look(3.0)
    assert drone.mission.state == m.ABORTED and not drone.command().armed and drone.command().target is None
    drone.obey(Watchdog(1), HOST, 4.0)
    drone.obey(Watchdog(1), HOST, 5.0)
    assert drone.command().armed and drone.command().target is None and not drone.modes


def test_control_that_changes_hands_ends_the_mission(drone):
    drone.connect(Client(), "10.0.0.2", 0.2)
    drone.disconnect(1)
    drone.obey(Watchdog(2), "10.0.0.2", 0.3)
    assert drone.mission.state == m.ABORTED and drone.command().armed and drone.command().target is None


def test_nobody_but_the_pilot_starts_a_mission(drone):
    drone.obey(MissionOrder("clear"), "10.0.0.9", 0.2)
    assert drone.mission.state == m.RUNNING and drone.dropped == 1


def set_mission(drone: Drone, address: str, name: str, now: float = 0.2) -> None:
    """As a client's request does it."""
    content = bp.SetMissionReq(mission=bp.Mission(instructions=[waypoint(5.0, 0.0, 1.0)], name=name))
    request = [b"blueye.protocol.SetMissionReq", bp.SetMissionReq.serialize(content)]
    telemetry = Telemetry(drone, DATUM)
    assert len(answer(request, drone, telemetry, address, now)) == 2


def test_nobody_but_the_pilot_loads_a_mission(drone):
    drone.obey(MissionOrder("clear"), HOST, 0.1)
    set_mission(drone, HOST, "mine")
    drone.mission.notes.clear()
    drone.connect(Client(), "10.0.0.9", 0.2)
    for k in range(20):
        set_mission(drone, "10.0.0.9", "theirs", 0.2 + 0.1 * k)
    assert drone.mission.message.name == "mine" and drone.mission.state == m.READY and drone.dropped == 20
    assert [note.level for note in drone.mission.notes] == [notes.WARNING], "a flood of them is reported once"
    assert "10.0.0.9 was dropped: not in control" in drone.mission.notes[0].text


def test_nobody_but_the_pilot_resets_the_odometer(drone):
    drone.odometer = 7.0
    drone.obey(ResetOdometer(), "10.0.0.9", 0.2)
    assert drone.odometer == 7.0 and drone.dropped == 1
    drone.obey(ResetOdometer(), HOST, 0.3)
    assert drone.odometer == 0.0


def test_mission_without_anybody_in_control_is_not_loaded():
    drone = Drone("", About(), watchdog_s=2.0, can_keep_position=True)
    set_mission(drone, HOST, "mine")
    assert drone.mission.state == m.INACTIVE and "connect first" in drone.mission.notes[0].text


def test_next_pilot_does_not_start_the_mission_of_the_one_before(drone):
    drone.obey(MissionOrder("clear"), HOST, 0.1)
    set_mission(drone, HOST, "theirs")
    drone.connect(Client(), "10.0.0.2", 0.2)
    drone.disconnect(1)
    assert drone.mission.state == m.INACTIVE and drone.mission.message is None
    assert "changed hands" in drone.mission.notes[-1].text
    drone.obey(Watchdog(2), "10.0.0.2", 0.3)
    drone.obey(MissionOrder("run"), "10.0.0.2", 0.4)
    assert drone.command().armed and drone.command().target is None


def test_mission_that_comes_before_the_first_watchdog_starts_with_it():
    """As the SDK's examples do: it feeds the watchdog a second after it has connected."""
    drone = Drone("", About(), watchdog_s=2.0, can_keep_position=True)
    drone.connect(Client(), HOST, 0.0)
    drone.fly(Here(0.0, (0.0, 0.0), 1.0, 0.0, 11.0))
    drone.mission.load(mission(waypoint(10.0, 0.0, 1.0)), ABLE)
    drone.obey(MissionOrder("run"), HOST, 0.1)
    assert drone.mission.state == m.READY
    drone.obey(Watchdog(1), HOST, 1.0)
    assert drone.mission.state == m.RUNNING and drone.command().target is not None


def test_mission_does_not_wait_for_thrusters_for_ever():
    drone = Drone("", About(), watchdog_s=60.0, can_keep_position=True)
    drone.connect(Client(), HOST, 0.0)
    drone.mission.load(mission(waypoint(10.0, 0.0, 1.0)), ABLE)
    drone.obey(MissionOrder("run"), HOST, 0.1)
    drone.look(5.0)
    assert drone.mission.state == m.READY
    drone.look(5.2)
    assert drone.mission.state == m.FAILED_TO_START and "watchdog" in drone.mission.notes[-1].text
    drone.obey(Watchdog(1), HOST, 6.0)
    assert drone.mission.state == m.FAILED_TO_START and drone.command().target is None


@pytest.mark.parametrize("looked", [True, False], ids=["looked at meanwhile", "backlog first"])
@pytest.mark.parametrize("first", ["watchdog", "run"])
def test_order_to_run_from_a_backlog_starts_nothing(drone, looked, first):
    """The line was down for three seconds; the pilot's order comes with what was held back, and starts nothing."""
    drone.obey(MissionOrder("clear"), HOST, 0.1)
    drone.mission.load(mission(waypoint(10.0, 0.0, 1.0)), ABLE)
    if looked:
        drone.look(2.5)
    orders = [Watchdog(1), MissionOrder("run")]
    for order in orders if first == "watchdog" else reversed(orders):
        drone.obey(order, HOST, 3.0)
    assert drone.mission.state != m.RUNNING and "thrusters are off" in drone.mission.notes[-1].text
    for k in range(1, 8):
        drone.obey(Watchdog(1), HOST, 3.0 + k)
        drone.look(3.0 + k)
    assert drone.command().armed and drone.command().target is None
