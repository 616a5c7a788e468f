"""Sensors of a run: those that the vehicle carries, at their places, and what the scenario adds and changes."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rovtwin.core.block import Block
from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import rotation_from_euler
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.sensors import ESSENTIAL, IMU, SENSORS, SensorKind, kind_named, kind_of, names_of
from rovtwin.core.types import Matrix3
from rovtwin.gnc.mounting import Mount
from rovtwin.runs.compose.faults import sensor_faults
from rovtwin.runs.compose.own_blocks import own_sensor
from rovtwin.scenario.schema import OwnSensorSection, Scenario, SensorSection, WorldSection
from rovtwin.simulation.sensors.own import kind_of_block
from rovtwin.simulation.sensors.sensor import Sensor, table_5_7, usual_sensor
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.instruments import Instrument, instruments

MOVED = (*ESSENTIAL, "dvl")  # kinds whose readings depend on where they sit or how they point


@dataclass(frozen=True)
class OnBoard:
    """Which sensors a run has.

    Attributes:
        carried: Of the vehicle's parts, by name; none where a preset is flown in their place.
        assumed: Kinds that every mission needs and the vehicle does not carry, at CO with usual figures.
        added: Kinds that the scenario switches on, likewise.
        own: Sensors of one's own, by name.
        preset: Of the scenario.
    """

    carried: dict[str, Instrument]
    assumed: tuple[str, ...]
    added: tuple[str, ...]
    own: dict[str, OwnSensorSection]
    preset: str

    @cached_property
    def names(self) -> list[str]:
        """All of them, kinds in order of `core.sensors.SENSORS`, one's own last."""
        found = [*self.carried, *self.assumed, *self.added]
        ours = sorted(found, key=lambda name: (list(SENSORS).index(kind_of(name)), len(name), name))
        return ours + list(self.own)

    def part_of(self, name: str) -> str:
        """The part that carries a sensor, such as `port.imu`; empty where none does."""
        return self.carried[name].part if name in self.carried else ""


def assumed_sensors(scenario: Scenario, vehicle: Vehicle) -> str | None:
    """What flies though no part measures it: readings from outside of a horizontal position, and others; None: nothing.

    And what a part carries in vain: an altimeter over no floor. Nothing is assumed where the scenario names a preset.
    """
    found = on_board(scenario, vehicle)
    if found.preset != "vehicle":
        return None
    lines = []
    if missing := [kind for kind in found.assumed if kind != "position"]:
        lines.append(
            f"{vehicle.name} carries no sensor that measures {', '.join(missing)}: those of thesis table 5.7 fly at "
            "CO. Give its parts 'sensors:' of their own"
        )
    if "position" in found.assumed:
        sensor = sensors_of(scenario, vehicle)["position"]
        period, off = 1000.0 / sensor.rate, float(np.max(np.asarray(sensor.noise)))
        lines.append(
            f"no part of {vehicle.name} measures a horizontal position: it is assumed to come from outside, every "
            f"{period:.3g} s with noise of {off:.2g} m ('sensors.position' changes that)"
        )
    silent = [name for name in found.carried if kind_of(name) == "altimeter"]
    if silent and scenario.world.floor is None:
        lines.append(f"{' and '.join(silent)} of {vehicle.name} will give no readings: the world has no floor "
                     "('world.floor' sets its depth)")  # fmt: skip
    return ". ".join(lines) or None


def on_board(scenario: Scenario, vehicle: Vehicle) -> OnBoard:
    """Which sensors fly: the parts' that are neither spare nor silenced, and those that the scenario adds.

    Raises:
        ConfigError: The scenario changes a sensor that is not there.
    """
    section = scenario.sensors
    silenced = [name for name, one in section.by_name.items() if one.on_board is False]
    carried: dict[str, Instrument] = {}
    if section.preset == "vehicle":
        fitted = [one for one in instruments(vehicle) if not one.spare]
        for kind, count in Counter(one.kind for one in fitted).items():
            of_kind = [one for one in fitted if one.kind == kind]
            carried |= dict(zip(names_of(kind, count), of_kind, strict=True))
    there = {kind_of(name) for name in carried}
    carried = {name: one for name, one in carried.items() if name not in silenced}
    assumed = tuple(kind for kind in ESSENTIAL if kind not in there)
    asked = [name for name, one in section.by_name.items() if one.on_board and name not in carried]
    leaks = any(fault.fault == "leak" for fault in scenario.faults)
    asked += ["leak"] if leaks and "leak" not in (*carried, *asked) else []
    added = tuple(name for name in asked if name in SENSORS and name not in assumed)
    found = OnBoard(carried, assumed, added, section.own, section.preset)
    for name, one in section.by_name.items():
        if name not in found.names and not isinstance(one, OwnSensorSection) and (one.on_board or changes_of(one)):
            fix = f"set sensors.{name}.on_board to true to have one" if name in SENSORS else "expected one of "
            there_are = "" if name in SENSORS else ", ".join(found.names)
            raise ConfigError(f"sensors.{name}: there is none on board; {fix}{there_are}")
    return found


def sensors_of(scenario: Scenario, vehicle: Vehicle) -> dict[str, Sensor]:
    """The sensors by name, with what the scenario changes about them.

    Raises:
        ConfigError: The scenario changes a sensor that is not there, or asks for what none of them tells.
    """
    section, found = scenario.sensors, on_board(scenario, vehicle)
    if "altimeter" in found.added and scenario.world.floor is None:
        raise ConfigError("sensors.altimeter: the world has no floor to look at; set world.floor to its depth [m]")
    if not any(kind_of(name) == "altimeter" for name in found.names) and any(w.altitude for w in scenario.waypoints):
        raise ConfigError(
            "mission: a way-point has an altitude, but there is no altimeter on board; set sensors.altimeter to true"
        )
    own = _own_of(scenario)
    rows = _rows_of(found, own)
    changes = {
        name: _of_the_place(scenario.world, rows[name])
        | (changes_of(section.by_name[name]) if name in section.by_name else {})
        for name in found.names
    }
    for name, given in sensor_faults(scenario, {name: row.size for name, row in rows.items()}).items():
        changes[name] |= given | {"blackouts": [*changes[name].get("blackouts", []), *given["blackouts"]]}
    physics = scenario.rates.physics
    beside = {
        name: usual_sensor(name, **({"physics_rate_hz": physics} | changes.pop(name)), own=block)
        for name, block in own.items()
    }
    if section.preset != "vehicle":
        return table_5_7(section.preset == "as_printed", physics, changes, found.added) | beside
    ours = {
        name: usual_sensor(
            kind_of(name), **({"physics_rate_hz": physics} | _figures(found.carried.get(name), physics) | given)
        )
        for name, given in changes.items()
    }
    return ours | beside


def kinds_on_board(scenario: Scenario, vehicle: Vehicle) -> dict[str, SensorKind]:
    """What each sensor reads, by name.

    Raises:
        ConfigError: The scenario changes a sensor that is not there, or one of one's own cannot be made.
    """
    return _rows_of(on_board(scenario, vehicle), _own_of(scenario))


def _own_of(scenario: Scenario) -> dict[str, Block]:
    """Blocks of the sensors of one's own that fly, by name."""
    return {name: own_sensor(one, f"{scenario.name}: sensors.{name}") for name, one in scenario.sensors.own.items()}


def _rows_of(found: OnBoard, own: Mapping[str, Block]) -> dict[str, SensorKind]:
    return {name: kind_of_block(own[name]) if name in own else kind_named(name) for name in found.names}


def _figures(carried: Instrument | None, physics_rate: float) -> dict[str, Any]:
    """Arguments of `Sensor` of a part's sensor; one that is faster than the physics gives the mean of its readings."""
    if carried is None:
        return {}
    figures = dict(carried.figures)
    if (many := figures["rate_hz"] / physics_rate) > 1.0:
        figures |= {"rate_hz": physics_rate, "noise": np.asarray(figures["noise"]) / np.sqrt(many)}
    return figures | {"lever": carried.position, "rotation": carried.rotation}


def _of_the_place(world: WorldSection, row: SensorKind) -> dict[str, Any]:
    """Argument of a `Sensor` that reads something of the place it is at."""
    return {"site": getattr(world, row.world).vector} if row.world else {}


_NO_FIGURES = {"on_board", "position", "attitude_deg", "kind", "settings"}


def changes_of(section: SensorSection) -> dict[str, Any]:
    """Arguments of `Sensor` that a scenario gives."""
    given = section.model_dump(exclude_none=True, exclude=_NO_FIGURES)
    if section.errors == "none":
        given["errors"] = None  # which replaces the part's
    if section.position is not None:
        given["lever"] = section.position
    if section.attitude_deg is not None:
        given["rotation"] = rotation_from_euler(jnp.radians(as_array(section.attitude_deg)))
    return given


def mount_of(sensor: Sensor) -> Mount:
    """A sensor as observers know it; one without noise counts as good as one of its kind."""
    noise = np.asarray(sensor.noise)
    std = np.where(noise > 0.0, noise, sensor.row.std)
    return Mount(float(std[0]) if np.all(std == std[0]) else std, sensor.lever, sensor.rotation)


def displaced(sensors: dict[str, Sensor]) -> dict[str, Mount]:
    """Those of the sensors that do not sit at CO along the axes of b; what looks at the floor has its own place."""
    mounts = {name: mount_of(sensor) for name, sensor in sensors.items() if sensor.kind in MOVED}
    return {
        name: mount
        for name, mount in mounts.items()
        if np.any(np.asarray(mount.lever) != 0.0) or np.any(np.asarray(mount.rotation) != np.eye(3))
    }


def rotated(sensors: dict[str, Sensor]) -> dict[str, Matrix3]:
    """R_bs of the accelerometers, gyros and compasses that do not point along b, by name."""
    turned = {name: sensor.rotation for name, sensor in sensors.items() if sensor.kind in IMU}
    return {name: R for name, R in turned.items() if np.any(np.asarray(R) != np.eye(3))}


def together(sensors: dict[str, Sensor], kind: str) -> tuple[float, float] | None:
    """Noise and rate [Hz] of one sensor that tells as much as all of a kind; None without any."""
    of_kind = [sensor for name, sensor in sensors.items() if kind_of(name) == kind]
    if not of_kind:
        return None
    rate = of_kind[0].rate / 1000
    if len(of_kind) == 1:
        return float(np.asarray(of_kind[0].noise)[0]), rate
    information = sum(sensor.rate / 1000 / max(float(np.asarray(sensor.noise)[0]), 1e-12) ** 2 for sensor in of_kind)
    return float(np.sqrt(rate / information)), rate


def without_own(scenario: Scenario) -> Scenario:
    """The scenario without sensors of one's own and their faults, for what has no use for them; it needs no consent."""
    section = scenario.sensors
    if not section.own:
        return scenario
    off = {name: one.model_copy(update={"on_board": False}) for name, one in section.own.items()}
    faults = [fault for fault in scenario.faults if fault.sensor not in off and not off.keys() & {*fault.sensors}]
    return scenario.model_copy(update={"sensors": section.model_copy(update=off), "faults": faults})


def measures(scenario: Scenario, vehicle: Vehicle, kind: str) -> bool:
    """Whether a sensor of a kind is on board."""
    return any(kind_of(name) == kind for name in on_board(scenario, vehicle).names)


def listed(scenario: Scenario, vehicle: Vehicle) -> list[str]:
    """A line for each sensor that flies: its name, where it comes from, its place, rate and noise.

    Of one's own it is what names its code, which is not run.
    """
    found, lines = on_board(scenario, vehicle), ["sensors that fly:"]
    for name, sensor in sensors_of(without_own(scenario), vehicle).items():
        origin = found.part_of(name) or ("switched on here" if name in found.added else "assumed, thesis table 5.7")
        place = ", ".join(f"{x:.4g}" for x in np.asarray(sensor.lever))
        noise = ", ".join(f"{x:.3g}" for x in sorted(set(np.asarray(sensor.noise).tolist())))
        unit = sensor.row.units[0]
        silent = sensor.kind == "battery" and scenario.battery is None
        figures = "silent: no battery is simulated, set battery to true" if silent else f"noise {noise} {unit}"
        lines.append(f"  {name} ({origin}): at [{place}] m, {sensor.rate / 1000:g} Hz, {figures}")
    return lines + [f"  {name} (your own): {one.kind}" for name, one in found.own.items()]
