"""The few ArduSub parameters that mean something here. Names, types and defaults are ArduSub's unless it says so."""

from dataclasses import dataclass, replace

INT8, INT16, INT32, REAL32 = 2, 4, 6, 9  # MAV_PARAM_TYPE


@dataclass(frozen=True)
class Parameter:
    """One parameter; `low` and `high` limit what a client may set, equal ones let nobody set it."""

    name: str
    value: float
    kind: int
    low: float
    high: float


class Parameters:
    """The set, in the order of ArduSub's index.

    Args:
        system: SYSID_THISMAV, read only.
        gain: JS_GAIN_DEFAULT, the share of full thrust that full stick asks for; ArduSub ships with 0.5.
        density: Of the water [kg/m3], from which BARO_SPEC_GRAV is made.
    """

    def __init__(self, system: int, gain: float, density: float):
        listed = (
            Parameter("SYSID_THISMAV", system, INT16, system, system),
            # Whose MANUAL_CONTROL and RC_CHANNELS_OVERRIDE are obeyed.
            Parameter("SYSID_MYGCS", 255, INT16, 1, 255),
            Parameter("FRAME_CONFIG", 2, INT8, 2, 2),  # vectored, six degrees of freedom
            Parameter("JS_GAIN_DEFAULT", gain, REAL32, 0.1, 1.0),
            Parameter("JS_THR_GAIN", 1.0, REAL32, 0.5, 4.0),  # more of it for the throttle
            # 0 nothing, 1 neutral, 2 disarm. BlueROV2s are shipped with 2; 0 is not offered here.
            Parameter("FS_PILOT_INPUT", 2, INT8, 1, 2),
            Parameter("FS_PILOT_TIMEOUT", 3.0, REAL32, 0.1, 10.0),
            Parameter("FS_GCS_ENABLE", 2, INT8, 2, 2),  # disarm
            # Not in ArduSub 4.5, which has 2.5 s for good; 4.7 has it, with 5 s at first.
            Parameter("FS_GCS_TIMEOUT", 2.5, REAL32, 2.0, 120.0),
            Parameter("BARO_SPEC_GRAV", density / 1000.0, REAL32, density / 1000.0, density / 1000.0),
        )
        self._all = {parameter.name: parameter for parameter in listed}

    def __len__(self) -> int:
        return len(self._all)

    def __getitem__(self, name: str) -> float:
        return self._all[name].value

    def listed(self) -> list[Parameter]:
        return list(self._all.values())

    def find(self, name: str, index: int) -> tuple[int, Parameter] | None:
        """By index, or by name where the index is negative; None where there is no such parameter."""
        if index < 0:
            index = list(self._all).index(name) if name in self._all else -1
        found = self.listed()
        return (index, found[index]) if 0 <= index < len(found) else None

    def set(self, name: str, value: float) -> bool:
        """Set a parameter where the value is allowed; whether it was. NaN never is."""
        parameter = self._all.get(name)
        allowed = parameter is not None and parameter.low <= value <= parameter.high
        if parameter is not None and allowed:
            rounded = value if parameter.kind == REAL32 else float(int(value))
            self._all[name] = replace(parameter, value=rounded)
        return allowed
