"""What a log must say of its run, to be replayed and judged."""

import platform
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin._version import __version__
from rovtwin.core.datum import METADATA_KEY
from rovtwin.core.numerics import jax
from rovtwin.core.plugins import BLOCKS, OWN_SENSORS, origin
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.runs.compose.composition import Simulation
from rovtwin.runs.compose.experiment import spans_of
from rovtwin.runs.vehicle_defaults import with_vehicle_defaults
from rovtwin.scenario.assets import kept_beside, scenes_kept_beside
from rovtwin.scenario.files import dump_scenario
from rovtwin.scenario.schema import ModelBasedSection, Scenario
from rovtwin.simulation.sensors.sensor import Sensor


def provenance(scenario: Scenario, simulation: Simulation) -> dict[str, str]:
    """What a log must say to be replayed and judged; wall-clock time is added by the log itself."""
    datum = scenario.origin
    return {
        "version": __version__,
        "scenario": dump_scenario(scenario_to_replay(scenario, simulation)),
        "autopilot": with_vehicle_defaults(scenario.autopilot, simulation.model).model_dump_json(),
        "name": scenario.name,
        "seed": str(scenario.seed),
        "platform": platform.platform(),
        "python": platform.python_version(),
        "jax": jax.__version__,
        "command": " ".join(Path(word).name if i == 0 else word for i, word in enumerate(sys.argv)),
        "vehicle_table": to_json(simulation.vehicle_table),
        "sensors": to_json(
            {n: _datasheet(s, simulation.on_board.part_of(n)) for n, s in simulation.white_sensors.items()}
        ),
        "water_density": str(
            water.kg_per_m3 if (water := scenario.world.water) else simulation.vehicle.assembly.density
        ),
        "waves": scenario.world.waves.model_dump_json() if scenario.world.waves else "",
        "faults": to_json(simulation.faults),
        "datum": datum.metadata(),
        "mission": to_json(flown_points(scenario)),
        "test": to_json(spans_of(scenario)) if scenario.test else "",
        "thrusters": to_json(simulation.thruster_names),
        "tether_length": str(simulation.paid_out),
    } | own_code(scenario)


def own_code(scenario: Scenario) -> dict[str, str]:
    """Which code flew as blocks, forces and sensors of one's own, by what the scenario calls it; nothing of none."""
    blocks = scenario.autopilot.own_blocks if isinstance(scenario.autopilot, ModelBasedSection) else {}
    named = {one.label: BLOCKS for one in (*blocks.values(), *scenario.world.forces)}
    named |= {one.kind: OWN_SENSORS for one in scenario.sensors.own.values()}
    return {"own_code": to_json({name: origin(name, named[name]) for name in sorted(named)})} if named else {}


def flown_points(scenario: Scenario) -> list[dict[str, Any]]:
    """A scenario's way-points as a log tells them: with their place in n, also where they were given on the map."""
    return [w.model_dump() | {"position": w.placed(scenario.origin)} for w in scenario.waypoints]


def beginning(scenario: Scenario, utc_start: str) -> dict[str, str]:
    """What the log of a vehicle over a link says of its time zero, which no scenario knows: the time of day."""
    return {METADATA_KEY: replace(scenario.origin, utc_start=utc_start).metadata()}


def _datasheet(sensor: Sensor, part: str) -> dict[str, Any]:
    """What a user of the log may know of a sensor: part, declared noise, place and mounting in b, not its errors.

    Of one whose errors last the noise is white noise that tells as little: estimators take residuals as independent.
    """
    figures = {"noise": sensor.noise, "lever": sensor.lever, "rotation": sensor.rotation}
    return {"part": part} | {name: np.asarray(value).tolist() for name, value in figures.items()}


def scenario_to_replay(scenario: Scenario, simulation: Simulation, folder: Path | None = None) -> Scenario:
    """The scenario with its vehicle written out, so that it does not depend on files that may change or move.

    Mesh and scene files are copied into `folder`, relative to which they are named; without one they stay where they
    are.
    """
    vehicle = simulation.vehicle.to_dict()
    if folder is None:
        return scenario.model_copy(update={"vehicle": vehicle})
    cameras = scenes_kept_beside(scenario.cameras, folder)
    return scenario.model_copy(update={"vehicle": kept_beside(vehicle, folder), "cameras": cameras})
