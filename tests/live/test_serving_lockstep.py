"""External physics for ArduSub's simulation, asked as the firmware asks: packets by the documented format, over UDP."""

import json
import socket
import struct
import threading
import time
from contextlib import suppress

import numpy as np
import pytest
from tests.links.mavlink.vehicle import free_port

from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log
from rovtwin.links.ardusub_json.endpoint import ARDUSUB_JSON
from rovtwin.links.ardusub_json.lockstep import Lockstep
from rovtwin.links.endpoint import Where
from rovtwin.live.serving.lockstep import FirmwarePhysics, serve_firmware
from rovtwin.live.serving.protocols import world_for

NEUTRAL, RATE, FRAMES = 1500, 1200, 1200


@pytest.fixture(scope="module")
def physics() -> FirmwarePhysics:
    return FirmwarePhysics(world_for("bluerov2_heavy", [], None), ARDUSUB_JSON.firmware(), "ardusub-json")


class Firmware:
    """What ArduSub does: send outputs, wait for the answer, count on."""

    def __init__(self, port: int):
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.connect(("127.0.0.1", port))
        self.line.settimeout(5.0)
        self.count = 0

    def frame(self, pwm: list[int]) -> dict:
        self.line.send(struct.pack("<HHI16H", 18458, RATE, self.count, *pwm, *[0] * (16 - len(pwm))))
        self.count += 1
        answer = self.line.recv(4096)
        assert answer[:1] == b"\n" and answer[-1:] == b"\n" and b": " not in answer
        return json.loads(answer)


@pytest.fixture
def firmware(physics):
    lockstep = Lockstep(physics.advance, physics.reset, port=0)
    physics.reset()
    thread = threading.Thread(target=lockstep.run, daemon=True)
    thread.start()
    firmware = Firmware(lockstep.port)
    yield firmware
    lockstep.stop()
    thread.join(5.0)
    lockstep.close()
    firmware.line.close()


@pytest.mark.system
def test_at_rest_the_accelerometer_reads_gravity(firmware):
    for _ in range(50):
        reported = firmware.frame([NEUTRAL] * 8)
    assert reported["timestamp"] == pytest.approx(50 / RATE)
    np.testing.assert_allclose(reported["imu"]["accel_body"], [0.0, 0.0, -9.81], atol=0.1)
    np.testing.assert_allclose(reported["imu"]["gyro"], 0.0, atol=0.01)


@pytest.mark.system
def test_the_firmwares_dive_turn_and_surge(firmware):
    """Forward and yaw as ArduSub's 6DOF frame adds them up, seen in the truth it gets back."""
    forward, yaw = [-1, -1, 1, 1, 0, 0, 0, 0], [1, -1, -1, 1, 0, 0, 0, 0]
    for _ in range(FRAMES):
        reported = firmware.frame([NEUTRAL + 120 * f for f in forward])
    assert reported["velocity"][0] > 0.1 and abs(reported["velocity"][1]) < 0.01
    for _ in range(FRAMES):
        reported = firmware.frame([NEUTRAL + 60 * y for y in yaw])
    assert reported["imu"]["gyro"][2] > 0.05
    assert reported["position"][2] == pytest.approx(0.5, abs=0.3)


@pytest.mark.system
def test_the_truth_is_logged(tmp_path):
    """What came back to the firmware is in the log, 50 times a simulated second."""
    path, reported = tmp_path / "truth.mcap", []
    where = Where(["127.0.0.1"], free_port())

    def fly(text: str) -> None:
        if "waits at udp" in text:
            threading.Thread(target=frames, daemon=True).start()

    def frames() -> None:
        firmware = Firmware(where.port)
        with suppress(TimeoutError, ConnectionError):  # once it has been served for long enough
            for _ in range(600):
                reported.append(firmware.frame([NEUTRAL + 100] * 2 + [NEUTRAL - 100] * 2 + [NEUTRAL] * 4))

    served = serve_firmware(world_for("bluerov2_heavy", [], None), ARDUSUB_JSON, where, 0.49, fly, log=path)
    log = Log.read(path)
    truth = log["truth/eta"]
    assert served == pytest.approx(0.49, abs=0.01) and len(truth) == 24 and set(log["truth/command"].values[0]) != {0.0}
    assert np.diff(truth.t) == pytest.approx(0.02, abs=1e-3)
    seen = {round(one["timestamp"], 6): one for one in reported}
    for t, eta in zip(truth.t, truth.values, strict=True):
        np.testing.assert_allclose(eta[:3], seen[round(float(t), 6)]["position"], atol=1e-6)


def test_the_logs_time_goes_on_where_a_firmware_begins_anew(physics):
    physics.reset()
    before = physics.now
    for _ in range(12):
        physics.advance((NEUTRAL,) * 8, 1.0 / RATE)
    physics.reset()
    assert physics.time == 0.0 and physics.now == pytest.approx(before + 0.01)


def test_as_fast_as_real_time(physics):
    """1200 steps a second are what ArduSub's simulation asks for; with less it runs slower than real time."""
    physics.reset()
    began = time.perf_counter()
    for _ in range(FRAMES):
        physics.advance((NEUTRAL,) * 8, 1.0 / RATE)
    assert time.perf_counter() - began < 5.0  # a fifth of real time at the least, on a busy machine


@pytest.mark.slow
def test_packets_of_many_rates_compile_a_few(physics):
    for rate in range(1000, 1040):
        physics.advance((NEUTRAL,) * 8, 1.0 / rate)
    assert len(physics._rates) <= 4


def test_a_vehicle_that_ardusubs_frame_does_not_drive_is_refused():
    with pytest.raises(ConfigError, match=r"port.surge.*bluerov2_heavy"):
        FirmwarePhysics(world_for("double_blueye", [], None), ARDUSUB_JSON.firmware(), "ardusub-json")
