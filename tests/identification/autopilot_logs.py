"""Small logs of autopilots, written byte by byte: one motion as ArduPilot dataflash, MAVLink telemetry and ULog."""

import struct

import numpy as np

T = np.arange(0.0, 12.0, 0.1)
EULER = np.stack([0.3 * np.sin(T), 0.2 * np.cos(T), 0.5 * T], axis=1)
RATE = np.stack([0.1 * np.cos(T), 0.2 * np.sin(T), 0.5 + 0 * T], axis=1)
DEPTH = 2.0 + 0.1 * T
START = 100.0  # of the autopilot's clock [s]
# What makes up for the sense of the propellers, for the eight motors of a BlueROV2 Heavy.
DIRECTIONS = (-1, -1, 1, 1, -1, 1, 1, -1)
PARAMETERS = {
    "FRAME_CONFIG": 2.0,
    "BARO_PRIMARY": 1.0,
    "BARO2_GND_PRESS": 101300.0,
    "BARO_SPEC_GRAV": 1.024,
    **{f"SERVO{n}_FUNCTION": 32.0 + n for n in range(1, 9)},
    **{f"MOT_{n}_DIRECTION": float(d) for n, d in enumerate(DIRECTIONS, 1)},
}


def pulses():
    """Of the eight outputs [us], at rest until 3 s and after 6 s, shape (len(T), 8): surge, then heave down."""
    ahead = np.array([-1, -1, 1, 1, 0, 0, 0, 0]) * np.array(DIRECTIONS)
    down = np.array([0, 0, 0, 0, 1, 1, 1, 1]) * np.array(DIRECTIONS)
    u = np.where(((T >= 3) & (T < 4.5))[:, None], 0.5 * ahead, 0.0) + np.where(
        ((T >= 4.5) & (T < 6))[:, None], 0.25 * down, 0.0
    )
    return np.round(1500 + 400 * u).astype(int)


class Dataflash:
    """Writes FMT messages as names come."""

    CODES = {"Q": "Q", "B": "B", "f": "f", "H": "H", "c": "h", "C": "H", "N": "16s", "L": "i", "I": "I"}

    def __init__(self):
        self.types, self.data = {}, bytearray()

    def add(self, name, letters, columns, *values):
        body = "<" + "".join(self.CODES[letter] for letter in letters)
        if name not in self.types:
            self.types[name] = 130 + len(self.types)
            reported = (self.types[name], 3 + struct.calcsize(body), name.encode(), letters.encode(), columns.encode())
            self.data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", *reported)
        self.data += b"\xa3\x95" + bytes([self.types[name]]) + struct.pack(body, *values)


def write_dataflash(path, parameters=PARAMETERS, without=(), armed=((2.0, 1), (9.0, 0))):
    """A log of ArduSub whose first barometer is in the hull and whose second is in the water."""
    log, out = Dataflash(), pulses()

    def add(name, *rest):
        if name not in without:
            log.add(name, *rest)

    log.add("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", 0, 131, b"s#m", b"F-0")
    log.add("BARO", "QBf", "TimeUS,I,Alt", int(1e6 * START), 0, 5.0)
    for name, value in parameters.items():
        add("PARM", "QNf", "TimeUS,Name,Value", int(1e6 * START), name.encode(), value)
    reports = list(armed)
    for i, t in enumerate(T):
        us = int(round(1e6 * (START + t)))
        while reports and reports[0][0] <= t:
            add("ARM", "QB", "TimeUS,ArmState", us, reports.pop(0)[1])
        hundredths = np.round(np.degrees(EULER[i]) % [1e9, 1e9, 360.0] * 100).astype(int)
        roll, pitch = np.round(np.degrees(EULER[i, :2]) * 100).astype(int)
        add("ATT", "QccC", "TimeUS,Roll,Pitch,Yaw", us, roll, pitch, hundredths[2])
        add("IMU", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", us, *RATE[i], 0.0, 0.0, -9.81)
        add("BARO", "QBf", "TimeUS,I,Alt", us, 0, 5.0)
        add("BARO", "QBf", "TimeUS,I,Alt", us, 1, -DEPTH[i])
        add("RCOU", "QHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8", us, *out[i])
        add("VISO", "Qfffff", "TimeUS,dt,PosDX,PosDY,PosDZ,conf", us, 0.1, 0.05, 0.01, -0.02, 100.0)
    path.write_bytes(log.data)
    return path


def write_tlog(path, parameters=PARAMETERS, armed=((2.0, 9.0),), every=1, without=()):
    """Telemetry as a ground station keeps it: the vehicle's own messages among those of others."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    vehicle, station, doppler = (mavlink.MAVLink(None, *who) for who in ((1, 1), (255, 190), (1, 197)))
    data, out = bytearray(), pulses()

    def add(t, message, by=vehicle):
        if message.get_type() not in without:
            data.extend(struct.pack(">Q", int(1e6 * (1.7e9 + t + 0.02))) + message.pack(by))

    for i, (name, value) in enumerate(parameters.items()):
        add(0, mavlink.MAVLink_param_value_message(name.encode(), value, 9, len(parameters), i))
    for i, t in enumerate(T):
        ms, us = int(round(1e3 * (START + t))), int(round(1e6 * (START + t)))
        if i % 5 == 0:
            on = any(a <= t < b for a, b in armed)
            add(t, mavlink.MAVLink_heartbeat_message(12, 3, 1 + 128 * on, 19, 4, 3))
            add(t, mavlink.MAVLink_heartbeat_message(6, 8, 192, 0, 4, 3), station)
        add(t, mavlink.MAVLink_attitude_message(ms, *EULER[i], *RATE[i]))
        add(t, mavlink.MAVLink_raw_imu_message(us, 0, 0, -1000, *np.round(1e3 * RATE[i]).astype(int), 0, 0, 0))
        pressure = (101300.0 + 1024 * 9.81 * DEPTH[i]) / 100
        add(t, mavlink.MAVLink_scaled_pressure2_message(ms, pressure, 0, 1500))
        if i % every == 0:
            add(t, mavlink.MAVLink_servo_output_raw_message(us, 0, *(int(p) for p in out[i])))
        moved = mavlink.MAVLink_vision_position_delta_message(
            us + 5_000_000, 100000, [0, 0, 0], [0.05, 0.01, -0.02], 100
        )
        add(t, moved, doppler)  # by a clock of its own
    path.write_bytes(data)
    return path


def write_ulog(path, parameters, topics):
    """A ULog.

    Args:
        path: To write.
        parameters: By name; whole numbers as int32.
        topics: By name: (columns with their types `float x`, times [s], values).
    """
    data = bytearray(b"\x55\x4c\x6f\x67\x01\x12\x35\x01" + struct.pack("<Q", 0))

    def add(kind, body):
        data.extend(struct.pack("<HB", len(body), ord(kind)) + body)

    add("B", bytes(40))
    for name, (columns, _, _) in topics.items():
        add("F", f"{name}:uint64_t timestamp;{';'.join(columns)};".encode())
    for name, value in parameters.items():
        key = f"{'int32_t' if isinstance(value, int) else 'float'} {name}".encode()
        add("P", bytes([len(key)]) + key + struct.pack("<i" if isinstance(value, int) else "<f", value))
    rows = []
    for number, (name, (columns, times, values)) in enumerate(topics.items()):
        add("A", struct.pack("<BH", 0, number) + name.encode())
        code = "".join("B" if c.startswith("uint8") else "f" for c in columns for _ in range(_size(c)))
        rows += [
            (t, number, struct.pack(f"<HQ{code}", number, int(1e6 * t), *row))
            for t, row in zip(times, values, strict=True)
        ]
    for _, _, body in sorted(rows):
        add("D", body)
    path.write_bytes(data)
    return path


def _size(column):
    kind = column.split()[0]
    return int(kind[kind.index("[") + 1 : -1]) if "[" in kind else 1
