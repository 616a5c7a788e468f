"""The faults of a scenario as blocks and arguments of sensors, and in words for the log."""

from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.topside import KINDS
from rovtwin.scenario.schema import FaultSection, Scenario
from rovtwin.simulation.events.faults import Faults, ThrusterFault

Fixed = dict[str, dict[str, Any]]


def faults_of(scenario: Scenario, thrusters: list[str], tethers: list[str]) -> Faults | None:
    """Faults of thrusters, leaks and snags; None where there are none.

    Args:
        scenario: What to fly.
        thrusters: Names, in the order of the commands.
        tethers: Names of those that are connected, in logs' spelling.

    Raises:
        ConfigError: A thruster, unit or tether that the vehicle has not.
    """
    found, leaks = [], []
    snags: dict[str, list[tuple[float, float]]] = {}
    for i, fault in enumerate(scenario.faults):
        end = np.inf if fault.until is None else fault.until
        if fault.fault in KINDS:
            continue  # above the water
        if fault.fault == "leak":
            leaks.append((fault.at, end))
        elif fault.tether is not None:
            for name in _tethers_of(fault.tether, i, tethers):
                snags.setdefault(name, []).append((fault.at, end))
        elif fault.sensor is None:
            numbers = [thrusters.index(name) for name in _thrusters_of(fault, i, thrusters)]
            share = 1.0 if fault.share is None else fault.share
            kind: Any = "dead" if fault.fault == "lost" else fault.fault
            found.append(ThrusterFault(kind, numbers, fault.at, end, share, fault.command))
    return Faults(len(thrusters), found, leaks, snags) if found or leaks or snags else None


def _tethers_of(name: str, i: int, tethers: list[str]) -> list[str]:
    """Tethers of a name, or of a part."""
    spelt = name.replace(".", "_")
    found = [tether for tether in tethers if tether == spelt or tether.startswith(f"{spelt}_")]
    if not found:
        there = f"there are {', '.join(tethers)}" if tethers else "none is; set world.tethers"
        raise ConfigError(f"faults[{i}].tether: no tether {name!r} is connected; {there}")
    return found


def _thrusters_of(fault: FaultSection, i: int, thrusters: list[str]) -> list[str]:
    """Names of the thrusters that a fault is of."""
    if fault.unit is None:
        pair = [f"{fault.thruster}_{side}" for side in ("port", "starboard")]  # where a pair is driven as two
        if fault.thruster not in thrusters and set(pair) <= set(thrusters):
            return pair
        if fault.thruster not in thrusters:
            raise ConfigError(f"faults[{i}].thruster: no thruster {fault.thruster!r}; there are {', '.join(thrusters)}")
        return [fault.thruster]
    lost = [name for name in thrusters if name.startswith(f"{fault.unit}.")]
    if not lost:
        there = ", ".join(units_of(thrusters)) or "none: its thrusters are not in parts"
        raise ConfigError(f"faults[{i}].unit: no unit {fault.unit!r} with thrusters; there are {there}")
    return lost


def units_of(thrusters: list[str]) -> list[str]:
    """Names of the parts that thrusters sit in."""
    return list(dict.fromkeys(name.rpartition(".")[0] for name in thrusters if "." in name))


def sensor_faults(scenario: Scenario, sensors: dict[str, int]) -> Fixed:
    """Arguments of each `Sensor` that fails: blackouts, offsets, frozen.

    Args:
        scenario: What to fly.
        sensors: Number of values of each sensor on board, by name.

    Raises:
        ConfigError: A sensor that is not on board, or a bias with another number of axes.
    """
    given: Fixed = {}
    for i, fault in enumerate(scenario.faults):
        span = (fault.at, np.inf if fault.until is None else fault.until)
        for name in fault.sensors if fault.sensor is None else [fault.sensor]:
            where = f"faults[{i}].{'sensors' if fault.sensor is None else 'sensor'}"
            if name not in sensors:
                raise ConfigError(f"{where}: no sensor {name!r} on board; there are {', '.join(sensors)}")
            faults = given.setdefault(name, {"blackouts": [], "offsets": [], "frozen": []})
            if fault.fault in ("silent", "lost"):
                faults["blackouts"].append(span)
            elif fault.fault == "frozen":
                faults["frozen"].append(span)
            else:
                faults["offsets"].append((*span, _bias(fault, i, name, sensors[name])))
    return given


def _bias(fault: FaultSection, i: int, name: str, size: int) -> list[float]:
    value = fault.value if isinstance(fault.value, list) else [fault.value] * size
    if len(value) != size:
        raise ConfigError(f"faults[{i}].value: found {len(value)} numbers, expected 1 or {size}: {name} has {size}")
    return value  # type: ignore[return-value]  (the schema requires it)


def listed(scenario: Scenario, thrusters: list[str]) -> list[dict[str, Any]]:
    """The faults for log and report: what in words, from when to when (None: for good), which thrusters."""
    return [
        {
            "what": described(fault),
            "start": fault.at,
            "end": fault.until,
            "thrusters": _thrusters_of(fault, i, thrusters) if fault.thruster or fault.unit else [],
        }
        for i, fault in enumerate(scenario.faults)
    ]


def described(fault: FaultSection) -> str:
    """A fault in words: `port.heave weak (30 % of its force)`."""
    of = fault.thruster or fault.sensor or ""
    of = f"unit {fault.unit}" if fault.unit else f"tether {fault.tether}" if fault.tether else of
    text = f"{of} {fault.fault}".strip()
    match fault.fault:
        case "weak":
            text += f" ({100 * (fault.share or 0.0):g} % of its force)"
        case "stuck":
            text += " (at its last command)" if fault.command is None else f" (at command {fault.command:g})"
        case "biased":
            value = fault.value if isinstance(fault.value, list) else [fault.value]
            text += f" (by {', '.join(f'{v:g}' for v in value)})"
        case "lost" if fault.sensors:
            text += f" (and {', '.join(fault.sensors)} silent)"
    return text
