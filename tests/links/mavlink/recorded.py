"""What a real BlueROV2's telemetry is made of: messages, rates and a few fields, counted in a .tlog.

`python -m tests.links.mavlink.recorded TELEMETRY.tlog > tests/links/mavlink/ardusub_telemetry.json`
writes our count. The recording itself has no licence to be handed on and
stays beside the repository; where the vehicle was is left out.
"""

import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

COUNT = Path(__file__).with_name("ardusub_telemetry.json")
LEAST = 10  # messages of a kind that make a rate
# Fields whose values are the firmware's own ways, not this vehicle's place, state or water.
FIELDS = {
    "HEARTBEAT": ("type", "autopilot", "base_mode", "system_status"),
    "EKF_STATUS_REPORT": ("flags", "airspeed_variance"),
    "GPS_RAW_INT": ("fix_type", "vel", "alt_ellipsoid"),
    "HWSTATUS": ("Vcc", "I2Cerr"),
    "MEMINFO": ("brkval", "freemem", "freemem32"),
    "MISSION_CURRENT": ("seq", "total"),
    "POWER_STATUS": ("Vcc", "Vservo", "flags"),
    "RC_CHANNELS": (
        "chancount",
        "rssi",
        "chan1_raw",
        "chan2_raw",
        "chan7_raw",
        "chan8_raw",
        "chan11_raw",
        "chan12_raw",
    ),
    "SCALED_PRESSURE": ("press_diff", "temperature_press_diff"),
    "VIBRATION": ("clipping_0", "clipping_1", "clipping_2"),
}


def counted(path: Path) -> dict[str, Any]:
    """Rates [Hz] of the autopilot's messages, rates that the ground station asked for, names and ranges of fields."""
    from pymavlink import mavutil

    times: dict[str, list[float]] = defaultdict(list)
    ranges: dict[str, dict[str, list[float]]] = {}
    asked: dict[str, int] = {}
    named: dict[str, None] = {}
    recording = mavutil.mavlink_connection(str(path))
    while (message := recording.recv_match()) is not None:
        kind = message.get_type()
        if kind == "REQUEST_DATA_STREAM":
            asked[str(message.req_stream_id)] = message.req_message_rate
        if (message.get_srcSystem(), message.get_srcComponent()) != (1, 1):
            continue
        times[kind].append(message._timestamp)
        if kind == "NAMED_VALUE_FLOAT":
            named[message.name] = None
        for field in FIELDS.get(kind, ()):
            value = getattr(message, field)
            low, high = ranges.setdefault(kind, {}).setdefault(field, [value, value])
            ranges[kind][field] = [min(low, value), max(high, value)]
    rates = {kind: round((len(at) - 1) / (at[-1] - at[0]), 1) for kind, at in sorted(times.items()) if len(at) >= LEAST}
    return {"rates": rates, "asked": asked, "named_values": list(named), "fields": ranges}


if __name__ == "__main__":
    print(json.dumps(counted(Path(sys.argv[1])), indent=1))
