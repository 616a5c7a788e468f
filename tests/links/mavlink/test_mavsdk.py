"""The twin under unmodified MAVSDK: it finds the vehicle, reads it, arms it, steers it and sends it to places."""

import json
import math
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from tests.links.mavlink.vehicle import ATTITUDE, PLACE, endpoint, measured, soon
from tests.links.serving import serving

from rovtwin.core.user_files.config import parse
from rovtwin.planning.exchange.missions import FORMATS, route_of
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import MissionSection

try:
    import mavsdk
    from mavsdk.plugins.action import Action, ActionError
    from mavsdk.plugins.manual_control import ManualControl
    from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage
    from mavsdk.plugins.mission_raw import MissionRaw
    from mavsdk.plugins.offboard import Offboard, PositionNedYaw, VelocityBodyYawspeed
    from mavsdk.plugins.telemetry import Telemetry
except Exception as error:  # its shared library may be missing, or made for another machine
    pytest.skip(f"MAVSDK cannot be loaded ({error}): pip install 'mavsdk>=4.1'", allow_module_level=True)


class Flying:
    """A served vehicle that measures at 20 Hz, and MAVSDK's system for it."""

    def __init__(self, served, system):
        self.served, self.system = served, system
        self.telemetry = Telemetry(system)  # a plugin knows only what came since it was made

    def has(self, done) -> bool:
        return soon(lambda: bool(self.served.commands) and done(self.served.commands[-1]))


@pytest.fixture(scope="module")
def flying():
    server = endpoint()
    with serving(server) as served:
        assert soon(lambda: bool(served.messages))
        # SYSID_MYGCS is 255: as MAVSDK's own 245 it would be received, but not steer.
        kit = mavsdk.Mavsdk(mavsdk.Configuration.create_manual(255, 190, True))
        kit.add_any_connection(f"udpin://{server.ground_station}")
        system = kit.first_autopilot(5.0)
        assert system is not None, "MAVSDK finds no autopilot"
        refused = None
        try:
            Action(system).arm()
        except ActionError as error:
            refused = error
        ending = threading.Event()

        def measure():
            k = 0
            while not ending.wait(0.05):
                k += 1
                served.feed(k * 0.05, measured(k * 0.05, estimate=True))

        thread = threading.Thread(target=measure)
        thread.start()
        found = Flying(served, system)
        found.refused = refused
        yield found
        ending.set()
        thread.join()
        kit.destroy()


@pytest.fixture
def armed(flying):
    assert soon(lambda: math.isfinite(flying.telemetry.attitude_euler().yaw_deg))
    Action(flying.system).arm()
    yield flying
    Action(flying.system).disarm()
    assert flying.has(lambda command: not command.armed)


def set_mode(flying, number):
    fields = {"command": 176, "confirmation": 0, "target_system": 1, "target_component": 1, "param1": 1}
    fields |= {f"param{i}": 0 for i in range(3, 8)} | {"param2": number}
    message = MavlinkMessage("COMMAND_LONG", 255, 190, 1, 1, json.dumps(fields))
    MavlinkDirect(flying.system).send_message(message)


@pytest.mark.system
def test_refused_arming_is_an_error(flying):
    assert flying.refused is not None


def test_telemetry(flying):
    telemetry = flying.telemetry
    assert soon(lambda: math.isfinite(telemetry.battery().voltage_v) and telemetry.position().latitude_deg > 60)
    euler = telemetry.attitude_euler()
    np.testing.assert_allclose(np.radians([euler.roll_deg, euler.pitch_deg, euler.yaw_deg]), ATTITUDE, atol=1e-5)
    place = telemetry.position_velocity_ned().position
    np.testing.assert_allclose([place.north_m, place.east_m, place.down_m], PLACE)
    assert telemetry.position().relative_altitude_m == -2.5
    assert telemetry.battery().remaining_percent == 83.0
    assert soon(lambda: telemetry.health().is_local_position_ok)


def test_rates_are_obeyed(flying):
    telemetry, times = flying.telemetry, []
    telemetry.set_rate_attitude_euler(20.0)
    subscription = telemetry.subscribe_attitude_euler(lambda euler, _: times.append(time.monotonic()))
    time.sleep(0.2)
    times.clear()
    time.sleep(0.6)
    count = len(times)
    telemetry.unsubscribe_attitude_euler(subscription)
    assert 8 <= count <= 14


def test_arms_and_steers(armed):
    assert armed.has(lambda command: command.armed)
    assert soon(lambda: armed.telemetry.armed())
    ManualControl(armed.system).set_manual_control_input(0.5, -0.25, 0.75, 0.1)  # MAVSDK: z from 0 to 1, 0.5 neutral
    assert armed.has(lambda command: any(command.motion))
    np.testing.assert_allclose(armed.served.commands[-1].motion, [0.25, -0.125, -0.25, 0, 0, 0.05], atol=1e-3)


def test_offboard_set_points(armed):
    """MAVSDK 4.1 knows no modes of a submarine: GUIDED is asked for by a message; its set-points then count."""
    set_mode(armed, 4)
    assert armed.has(lambda command: command.hold_position)
    offboard = Offboard(armed.system)
    offboard.set_velocity_body(VelocityBodyYawspeed(0.2, 0.0, 0.1, math.degrees(0.3)))
    moving = armed.has(lambda command: any(command.motion))
    offboard.set_position_ned(PositionNedYaw(1.0, 2.0, 3.0, 90.0))
    going = armed.has(lambda command: command.target is not None)
    target = armed.served.commands[-1].target
    velocities = [command.motion for command in armed.served.commands if any(command.motion) and command.hold_position]
    set_mode(armed, 19)
    assert armed.has(lambda command: not command.hold_position)
    assert moving and going
    np.testing.assert_allclose(velocities[-1], [0.2, 0, 0.2, 0, 0, 0.3], atol=1e-3)
    np.testing.assert_allclose(target, [1, 2, 3, math.pi / 2], atol=1e-6)


@pytest.mark.system
def test_the_script_of_the_docs_steers():
    page = (Path(__file__).parents[3] / "docs" / "links_mavlink.md").read_text()
    (script,) = re.findall(r"```python\n(.*?)```", page, re.S)
    server = endpoint()
    with serving(server) as served:
        assert soon(lambda: bool(served.messages))
        script = script.replace("127.0.0.1:14550", server.ground_station)
        # A process of its own, as a user has it, which does not share MAVSDK's state with the tests above.
        command = [sys.executable, "-c", script]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        k = 0
        while process.poll() is None and k < 1000:
            k += 1
            served.feed(k * 0.05, measured(k * 0.05, estimate=True))
            time.sleep(0.05)
        process.kill()
        printed, complaints = process.communicate()
        assert process.returncode == 0, complaints
        yaw, altitude = map(float, printed.split()[-2:])
        assert yaw == pytest.approx(math.degrees(ATTITUDE[2]), abs=1e-3) and altitude == -PLACE[2]
        assert any(
            pilot_command.armed and pilot_command.motion[0] == pytest.approx(0.15) for pilot_command in served.commands
        )
        assert soon(lambda: not served.commands[-1].armed)


@pytest.mark.system
def test_a_plan_written_for_qgroundcontrol_is_read(flying):
    """By MAVSDK's own reader: items, a speed that changes, the fence."""
    changes = ["datum={latitude: 63.44, longitude: 10.42}"]
    changes += [f"autopilot.supervisor.geofence.polygon={[[-9, -9], [99, -9], [99, 99]]}"]
    scenario = load_scenario("square", changes)
    points = [{"position": [0, 0, 3], "speed": 0.3}, {"position": [20, 5, 2.5], "speed": 0.2, "hold_time": 4.0}]
    mission = parse(MissionSection, {"waypoints": points}, "mine")
    text = FORMATS["plan"].write(route_of(mission, scenario.origin, scenario))
    taken = MissionRaw(flying.system).import_qgroundcontrol_mission_from_string(text)
    home, *items = taken.mission_items  # which ArduPilot has first
    assert (home.command, home.frame, home.z) == (16, 5, 0.0)
    commands = [(item.command, item.frame, item.param1) for item in items]
    assert commands == [(178, 2, 1.0), (16, 3, 0.0), (178, 2, 1.0), (16, 3, 4.0)]
    first, last = (items[i] for i in (1, 3))
    assert (first.x, first.y, first.z) == (634400000, 104200000, -3.0) and math.isnan(first.param4)
    north_east = scenario.origin.position(last.x / 1e7, last.y / 1e7, -last.z)
    np.testing.assert_allclose(north_east, [20, 5, 2.5], atol=0.01)  # 1e-7 degrees are a centimetre
    assert [item.command for item in taken.geofence_items] == [5001] * 3


def test_modes_that_mavsdk_cannot_ask_for(flying):
    """Documented in docs/links_mavlink.md: if this fails, MAVSDK learnt to, and the page can say so."""
    with pytest.raises(ActionError):
        Action(flying.system).hold()
