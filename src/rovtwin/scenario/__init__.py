"""What a run is (vehicle, world, sensors, autopilot, mission, seed) and how it runs; composition only.

The only package that brings vehicle, simulation, gnc, links and report together:
schema, files (what people write) -> composition (blocks) -> loop (compiled) -> run (records) -> flight (log, scores).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rovtwin.scenario.batch import score_seeds
    from rovtwin.scenario.composition import compose
    from rovtwin.scenario.files import dump_scenario, list_missions, list_scenarios, load_mission, load_scenario
    from rovtwin.scenario.flight import Flight, fly
    from rovtwin.scenario.records import trial_logs, trial_records
    from rovtwin.scenario.schema import Scenario

_WHERE = {
    "Scenario": "schema",
    "load_scenario": "files",
    "load_mission": "files",
    "list_scenarios": "files",
    "list_missions": "files",
    "dump_scenario": "files",
    "compose": "composition",
    "fly": "flight",
    "Flight": "flight",
    "score_seeds": "batch",
    "trial_logs": "records",
    "trial_records": "records",
}
__all__ = [
    "Flight",
    "Scenario",
    "compose",
    "dump_scenario",
    "fly",
    "list_missions",
    "list_scenarios",
    "load_mission",
    "load_scenario",
    "score_seeds",
    "trial_logs",
    "trial_records",
]


def __getattr__(name: str) -> Any:
    # Reading a scenario file does not need JAX: what computes is loaded on first use.
    if name in _WHERE:
        return getattr(import_module(f"rovtwin.scenario.{_WHERE[name]}"), name)
    raise AttributeError(f"module 'rovtwin.scenario' has no attribute {name!r}")
