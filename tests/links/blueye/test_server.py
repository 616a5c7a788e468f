"""The vendor's unmodified SDK and our server: it takes the twin for a Blueye drone.

All ports are fixed, so every test that binds these addresses is in this module.
"""

import asyncio
import pickle
import socket
import threading
import time
from collections.abc import Iterator

import blueye.protocol as bp
import pytest
import requests
import zmq
from blueye.sdk import Drone
from blueye.sdk.logs import LogStream
from blueye.sdk.mission import create_waypoint_instruction, prepare_new_mission
from tests.links.blueye.vehicle import Feeder
from tests.links.serving import Served, serving, wait_for

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LinkError
from rovtwin.links.blueye.protobuf import names
from rovtwin.links.blueye.server import BlueyeServer
from rovtwin.links.blueye.wire import STILL
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import require_loopback

PORT, STARBOARD = "127.0.0.4", "127.0.0.5"  # not 127.0.0.2 and .3, where tests of `rovtwin serve` may be at work
ESTIMATE = [12.0, -7.0, 3.5, *[0.0] * 9]
HTTP = 8780  # not 80, so that tests need no root


@pytest.fixture(autouse=True)
def proxy(monkeypatch):
    """As a user without root tells the SDK where port 80 is."""
    monkeypatch.setenv("http_proxy", f"http://{PORT}:{HTTP}")
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)


@pytest.fixture
def server() -> BlueyeServer:
    return BlueyeServer(hosts=(PORT,), http_port=HTTP, datum=Datum(63.0, 10.0))


@pytest.fixture
def served(server) -> Iterator[Served]:
    with serving(server) as served:
        assert wait_for(lambda: served.messages)
        yield served


@pytest.fixture
def drone(served) -> Iterator[Drone]:
    drone = Drone(PORT)
    yield drone
    if drone.connected:
        drone.disconnect()


def arm(drone: Drone, served: Served) -> None:
    """Feed the watchdog at once: the SDK does from one second after connecting."""
    drone._ctrl_client._messages_to_send.put(bp.WatchdogCtrl(client_id=drone.client_id))
    assert wait_for(lambda: served.commands and served.commands[-1].armed)


@pytest.mark.system
def test_sdk_connects_to_both_drones_and_each_obeys_its_own():
    with serving(BlueyeServer(hosts=(PORT, STARBOARD), http_port=HTTP), drones=("port", "starboard")) as served:
        assert wait_for(lambda: served.messages)
        drones = {"port": Drone(PORT), "starboard": Drone(STARBOARD)}
        assert drones["port"].serial_number.endswith("port")
        assert drones["starboard"].serial_number.endswith("starboard")
        assert all(drone.in_control for drone in drones.values())
        drones["port"].motion.send_thruster_setpoint(0.1, 0.2, 0.3, 0.4)
        drones["starboard"].motion.set_surge(-0.5)

        def newest(name):
            return next((w for w in reversed(served.commands) if w.drone == name), None)

        # The SDK's own watchdog arms after a second.
        assert wait_for(lambda: all(newest(name) and newest(name).armed for name in drones), 5)
        assert newest("port").motion == pytest.approx((0.1, 0.2, 0.3, 0.0, 0.0, 0.4))
        assert newest("starboard").motion == pytest.approx((-0.5, 0, 0, 0, 0, 0))
        Feeder(served).feed(0.2, pressure=[7.0])
        assert wait_for(lambda: drones["starboard"].get_depth() == 7.0)
        for drone in drones.values():
            drone.disconnect()
        assert wait_for(lambda: not newest("port").armed and not newest("starboard").armed)


def test_every_value_of_telemetry_is_what_was_fed(served, drone):
    Feeder(served).feed(1.2)
    assert wait_for(lambda: drone.telemetry.get(bp.ErrorFlagsTel) is not None)
    assert drone.get_depth() == 3.5
    pose = drone.get_pose()
    assert (pose["roll"], pose["pitch"], pose["yaw"]) == pytest.approx(
        (5.729578, 360 - 11.459156, 171.887339), abs=1e-4
    )
    for kind in (bp.CalibratedImuTel, bp.Imu1Tel, bp.Imu2Tel):
        imu = drone.telemetry.get(kind).imu
        assert (imu.gyroscope.x, imu.gyroscope.y, imu.gyroscope.z) == (0.01, -0.02, 0.3)
        force = (imu.accelerometer.x, imu.accelerometer.y, imu.accelerometer.z)
        assert force == pytest.approx((0.5 / 9.80665, -0.25 / 9.80665, -9.75 / 9.80665))
        assert imu.magnetometer.x**2 + imu.magnetometer.y**2 + imu.magnetometer.z**2 == pytest.approx(
            51.94**2, rel=1e-3
        )
    force = drone.telemetry.get(bp.ControlForceTel).control_force
    assert (force.surge, force.sway, force.heave, force.yaw) == (4.0, -2.0, 5.5, 1.5)
    assert drone.battery.get_state_of_charge() == 0.75
    smart = drone.telemetry.get(bp.BatteryBQ40Z50Tel).battery
    assert smart.voltage.total * smart.current == pytest.approx(-60.0, rel=1e-5)
    velocity = drone.telemetry.get(bp.DvlVelocityTel).dvl_velocity.velocity
    assert (velocity.x, velocity.y, velocity.z) == (0.5, -0.25, -0.125)
    assert drone.get_altitude() == 2.5
    place = drone.telemetry.get(bp.PositionEstimateTel).position_estimate
    assert (place.northing, place.easting, place.is_valid) == (12.0, -7.0, True)
    assert place.heading == pytest.approx(3.0)
    assert drone.get_error_flags()["inner_pressure_spike"] is False
    assert drone.get_lights() == 0.0
    assert drone.get_active_video_streams() == {"main": 0, "guestport": 0}
    assert drone.get_water_temperature() == 8.0
    info = drone.telemetry.get(bp.DroneInfoTel).drone_info
    assert info.model == bp.Model.MODEL_PIONEER and info.blunux_version == drone.software_version
    clock = drone.telemetry.get(bp.DroneTimeTel)
    assert clock.real_time_clock.unix_timestamp.timestamp() == pytest.approx(time.time(), abs=5)
    assert clock.monotonic_clock.unix_timestamp.timestamp() == pytest.approx(1.2, abs=0.6)
    assert drone.get_client_in_control() == drone.client_id
    assert drone.telemetry.get(bp.DataStorageSpaceTel).storage_space.free_space > 0
    assert drone.motion.is_auto_depth_active() is False
    # What the twin does not have is nothing, not an error.
    assert drone.telemetry.get(bp.MultibeamPingTel) is None


def test_leak_and_dive_time(served, drone):
    feeder = Feeder(served, pace=0.1)
    feeder.feed(4.2)
    feeder.feed(1.2, leak=[1.0], pressure=[0.1])
    assert wait_for(lambda: drone.get_error_flags()["inner_pressure_spike"])
    assert drone.get_dive_time() == 4


def test_readings_that_are_no_numbers_are_not_published(served, drone):
    Feeder(served, pace=0.1).feed(1.2, pressure=[float("nan")], gyro=[float("inf"), 0, 0], battery=[float("nan"), 1])
    assert drone.get_depth() is None
    assert drone.battery.get_state_of_charge() is None
    imu = drone.telemetry.get(bp.CalibratedImuTel).imu
    assert "gyroscope" not in imu and imu.accelerometer.z < 0


def test_motion_modes_and_lights(served, drone):
    arm(drone, served)
    drone.motion.send_thruster_setpoint(0.5, -0.5, 0.25, -1.0)
    drone.motion.enable_auto_depth(True)
    drone.motion.enable_auto_heading(True)
    drone.motion.enable_auto_altitude(True)
    drone.set_lights(0.5)
    drone.config.set_water_density(997)
    assert wait_for(lambda: served.commands[-1].lights == 0.5)
    command = served.commands[-1]
    assert command.motion == (0.5, -0.5, 0.25, 0.0, 0.0, -1.0) and command.hold_depth and command.hold_heading
    # Told at once, without new readings
    assert wait_for(lambda: drone.motion.is_auto_depth_active() and drone.get_lights() == 0.5)
    assert drone.motion.is_auto_heading_active() and not drone.motion.is_auto_altitude_active()
    drone.motion.enable_auto_depth(False)
    assert wait_for(lambda: not served.commands[-1].hold_depth and not drone.motion.is_auto_depth_active())
    assert served.commands[-1].hold_heading


@pytest.mark.system
def test_command_is_repeated_while_the_watchdog_is_fed(served, drone):
    """The SDK sends a motion once; a wish holds for 0.3 s at the vehicle."""
    drone.motion.set_heave(0.5)
    arm(drone, served)
    before = len(served.commands)
    time.sleep(1.0)
    assert len(served.commands) - before >= 10
    assert {w.motion[2] for w in served.commands[before:]} == {0.5}


def test_unfed_watchdog_stops_the_thrusters_in_time():
    server = BlueyeServer(hosts=(PORT,), http_port=HTTP, watchdog_s=0.4)
    with serving(server) as served:
        assert wait_for(lambda: served.messages)
        drone = Drone(PORT)
        drone._watchdog_publisher.stop()
        drone.motion.set_surge(1.0)
        drone.motion.enable_auto_depth(True)
        arm(drone, served)
        fed = time.monotonic()
        assert wait_for(lambda: not served.commands[-1].armed, 2.0)
        # The watchdog, the period of repetition, and a slow machine
        assert 0.3 < time.monotonic() - fed < 0.4 + 0.4
        assert not any(served.commands[-1].motion) and not served.commands[-1].hold_depth
        result = len(served.commands)
        time.sleep(0.3)
        assert len(served.commands) == result, "nothing is wished for a client that is gone"
        assert any("thrusters off" in text for text in served.messages)
        assert wait_for(lambda: not drone.motion.is_auto_depth_active())
        drone.disconnect()


def test_second_client_observes_and_takes_control(served, drone):
    arm(drone, served)
    drone.motion.set_surge(0.5)
    second = Drone(PORT)
    assert not second.in_control and second.client_id == 2
    assert wait_for(lambda: len(second.get_connected_clients() or []) == 2)
    Feeder(served).feed(0.2)
    assert wait_for(lambda: second.get_depth() == 3.5)
    arm(second, served)  # feeds its own watchdog only
    assert served.commands[-1].motion[0] == 0.5
    before = len(served.commands)
    second.take_control()
    # What the first one wanted ends with its control. Armed or not: the second one's watchdog may be on its way.
    assert second.in_control and wait_for(lambda: any(command.motion == STILL for command in served.commands[before:]))
    arm(second, served)
    second.motion.set_surge(-0.25)
    assert wait_for(lambda: served.commands[-1].motion[0] == -0.25)
    # The first one's watchdog does not count any more
    assert drone.get_client_in_control() == 2
    second.disconnect()


def test_disconnecting_other_clients_when_connecting(served, drone):
    second = Drone(PORT, disconnect_other_clients=True)
    assert second.in_control
    second.disconnect()


def test_control_passes_on_when_the_pilot_leaves(served, drone):
    second = Drone(PORT)
    third = Drone(PORT, connect_as_observer=True)
    arm(drone, served)
    drone.disconnect()
    assert wait_for(lambda: second.get_client_in_control() == second.client_id)
    assert wait_for(lambda: not served.commands[-1].armed)
    second.disconnect()
    assert wait_for(lambda: third.get_client_in_control() == 0)
    third.disconnect()


def test_rates_are_those_of_simulated_time(served, drone):
    counted: dict[str, int] = {}

    def count(name, payload):
        counted[name] = counted.get(name, 0) + 1

    drone.telemetry.set_msg_publish_frequency(bp.DepthTel, 50)
    drone.telemetry.set_msg_publish_frequency(bp.AttitudeTel, 5)
    drone.telemetry.set_msg_publish_frequency("CalibratedImuTel", 0)
    with pytest.raises(RuntimeError):
        drone.telemetry.set_msg_publish_frequency(bp.DepthTel, 101)
    with pytest.raises(RuntimeError):
        drone.telemetry.set_msg_publish_frequency("NoSuchTel", 10)
    drone.telemetry.add_msg_callback([], count, raw=True)
    Feeder(served, pace=0.2).feed(4.0)  # ten times as fast as the vehicle's time at best
    assert wait_for(lambda: counted.get("DepthTel") == 200)
    assert 20 <= counted["AttitudeTel"] <= 21 and "CalibratedImuTel" not in counted
    assert 40 <= counted["ControlForceTel"] <= 45 and 4 <= counted["BatteryTel"] <= 5


def test_every_request_of_the_sdk_is_answered(served, drone):
    for name in sorted(names("Req")):
        reply = getattr(bp, name.removesuffix("Req") + "Rep")
        assert isinstance(drone._req_rep_client._send_request_get_response(getattr(bp, name)(), reply, 2.0), reply), (
            name
        )
    drone.ping()
    assert drone._req_rep_client.get_overlay_parameters(2.0) is not None
    assert drone.camera.get_bitrate() == 0
    assert len(drone.mission.get_active().instructions) == 0


@pytest.mark.system
def test_mission_by_the_sdk(served, drone):
    """Loaded and started as its examples do, a second before its first watchdog; the target moves where it leads."""
    feeder = Feeder(served)
    feeder.feed(0.1, estimate=ESTIMATE)
    down = bp.Instruction(depth_set_point_command={"depth_set_point": {"depth": 9.0, "speed_to_depth": 0.5}})
    drone.mission.load_and_run(prepare_new_mission([down], 3, "down"))
    assert len(drone.mission.get_active().instructions) == 1
    arm(drone, served)
    feeder.feed(3.0, estimate=ESTIMATE)
    assert wait_for(lambda: served.commands[-1].target is not None and served.commands[-1].target[2] > 3.9)
    assert served.commands[-1].target[:2] == (12.0, -7.0) and drone.mission.get_status().state == 3
    feeder.feed(1.0, estimate=[*ESTIMATE[:2], 9.0, *ESTIMATE[3:]])
    assert wait_for(lambda: drone.mission.get_status().state == bp.MissionState.MISSION_STATE_COMPLETED)
    assert wait_for(lambda: served.commands[-1].target is None and served.commands[-1].hold_depth)


def test_mission_that_is_refused_says_why(served, drone):
    notes = []
    drone.telemetry.add_msg_callback([bp.NotificationTel], lambda name, note: notes.append(note))
    far = create_waypoint_instruction("far", 0.0, 0.0, 1.0)
    with pytest.raises(RuntimeError, match="Failed to load the mission"):
        drone.mission.load_and_run(prepare_new_mission([far]))
    assert wait_for(lambda: len(notes) == 2)
    assert [note.notification.level for note in notes] == [3, 3]
    assert any("mission: instruction 1 (waypoint): " in text for text in served.messages)


@pytest.mark.system
def test_log_is_found_and_read_as_the_sdks_example_does(served, drone):
    """Its records hold what telemetry had, at most once a second each, and any number of readers gets the same."""
    Feeder(served).feed(5.0)
    log = drone.logs[0]
    assert log.is_dive and log.max_depth_magnitude == 3 and log.filesize > 1000
    records = list(LogStream(log.download(write_to_file=False)))
    depths = [(since.total_seconds(), content) for _, since, kind, content in records if kind == bp.DepthTel]
    assert len(depths) == 5 and all(content.depth.value == 3.5 for _, content in depths)
    assert depths[-1][0] - depths[0][0] == pytest.approx(4.0, abs=0.3)
    assert {bp.PositionEstimateTel, bp.AttitudeTel, bp.MissionStatusTel} <= {kind for _, _, kind, _ in records}
    assert abs(records[-1][0].timestamp() - time.time()) < 60.0
    unknown = requests.get(f"http://{PORT}/logs/none/binlog", timeout=2)
    assert unknown.status_code == 404


def test_malformed_messages_are_dropped_and_the_rest_goes_on(served, drone):
    arm(drone, served)
    context = zmq.Context.instance()
    bad = [[b""], [b"x", b"y"], [b"blueye.protocol.MotionInputCtrl", b"\x0a\xff"], [b"a"] * 20, [b"\xff" * 60000, b""]]
    with context.socket(zmq.PUB) as control, context.socket(zmq.REQ) as request:
        control.connect(f"tcp://{PORT}:5557")
        time.sleep(0.2)
        for frames in bad * 20:
            control.send_multipart(frames)
        request.connect(f"tcp://{PORT}:5556")
        for frames in bad:
            request.send_multipart(frames)
            assert request.poll(2000), "a request without a reply"
            assert len(request.recv_multipart()) == 2
    with socket.create_connection((PORT, 5556)) as raw:
        raw.sendall(b"GET / HTTP/1.1\r\n\r\n" * 10)
    drone.motion.set_sway(0.75)
    assert wait_for(lambda: served.commands[-1].motion[1] == 0.75)
    drone.ping()


def test_flood_of_commands_starves_nobody(served, drone):
    """Ten thousand motion inputs at once: requests are answered meanwhile, wishes stay below a hundred a second."""
    arm(drone, served)
    before, start = len(served.commands), time.monotonic()
    for k in range(10_000):
        drone.motion.set_surge(k / 10_000)
    while not drone._ctrl_client._messages_to_send.empty():
        drone.ping()
    assert wait_for(lambda: served.commands[-1].motion[0] > 0.9)
    assert len(served.commands) - before <= 100 * (time.monotonic() - start) + 2


def test_http_without_a_proxy_serves_who_it_is(served):
    direct = requests.Session()
    direct.trust_env = False
    found = direct.get(f"http://{PORT}:{HTTP}/diagnostics/drone_info", timeout=2).json()
    assert found["sw_version"].startswith("4.0.5") and found["serial_number"] and found["hardware_id"]
    assert direct.get(f"http://{PORT}:{HTTP}/nonsense", timeout=2).status_code == 404
    assert direct.post(f"http://{PORT}:{HTTP}/logs", timeout=2).status_code == 405


@pytest.mark.parametrize("sent", [b"\r\n\r\n", b"x" * 20_000, b"GET /diagnostics", b""])
def test_http_that_is_none_does_no_harm(served, sent):
    with socket.create_connection((PORT, HTTP)) as raw:
        raw.settimeout(2)
        raw.sendall(sent)
        raw.shutdown(socket.SHUT_WR)
        try:
            assert raw.recv(100).startswith(b"HTTP/1.1 400")
        except ConnectionResetError:
            assert len(sent) > 8192  # closed with bytes of ours unread
    assert requests.get(f"http://{PORT}/diagnostics/drone_info", timeout=2).ok


def test_port_80_where_that_is_allowed(monkeypatch):
    """What a user who is root sees: no proxy, nothing but an address."""
    try:
        socket.create_server((PORT, 80)).close()
    except OSError:
        pytest.skip("port 80 is not ours")
    monkeypatch.delenv("http_proxy")
    with serving(BlueyeServer(hosts=(PORT,))) as served:
        assert wait_for(lambda: served.messages) and "http_proxy" not in served.messages[0]
        drone = Drone(PORT)
        assert drone.in_control
        drone.disconnect()


def test_address_that_is_taken(served, server):
    other = BlueyeServer(hosts=(PORT,), http_port=HTTP + 1)
    for taken, port in ((server, HTTP), (other, 5555)):
        with pytest.raises(LinkError, match=f"{PORT}:{port}: cannot be bound .* Is another server running there"):
            asyncio.run(taken.run(ServedVehicle()))


def test_addresses():
    assert BlueyeServer().placed(("",)) == {"": "127.0.0.2"}
    assert BlueyeServer().placed(("port", "starboard")) == {"port": "127.0.0.2", "starboard": "127.0.0.3"}
    by_name = BlueyeServer(hosts={"starboard": "127.0.0.9", "port": "127.0.0.8"})
    assert by_name.placed(("port", "starboard")) == {"port": "127.0.0.8", "starboard": "127.0.0.9"}
    assert require_loopback([BlueyeServer(), by_name], exposed=False) == []
    assert require_loopback([BlueyeServer(hosts=("0.0.0.0",))], exposed=True) == ["0.0.0.0"]
    for hosts in (("127.0.0.2",), ("127.0.0.2", "127.0.0.2"), ("a", "b", "c"), {"port": "127.0.0.2"}):
        with pytest.raises(LinkError, match="expected a different one for each"):
            BlueyeServer(hosts=hosts).placed(("port", "starboard"))


def test_it_is_picklable_and_frees_its_ports(server):
    for _ in range(2):
        with serving(pickle.loads(pickle.dumps(server))) as served:
            assert wait_for(lambda: served.messages)
    assert not [t for t in threading.enumerate() if t.name.startswith("asyncio")]


def test_pilot_is_disarmed_when_the_server_ends(server):
    with serving(server) as served:
        assert wait_for(lambda: served.messages)
        drone = Drone(PORT)
        arm(drone, served)
        drone.motion.set_surge(1.0)
        assert wait_for(lambda: served.commands[-1].motion[0] == 1.0)
    assert not served.commands[-1].armed
    drone.disconnect()
