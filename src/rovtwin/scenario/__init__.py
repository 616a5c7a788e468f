"""What a run is (vehicle, world, sensors, autopilot, mission, seed) and how it runs; composition only.

The only package that brings vehicle, simulation, gnc, links and report together:
schema and files (what people write) -> compose (blocks) -> loop (compiled) -> run (chunks, log, scores) -> fly.
"""

from importlib import import_module
from typing import Any

_WHERE = {
    "Scenario": "schema",
    "load_scenario": "files",
    "load_mission": "files",
    "list_scenarios": "files",
    "list_missions": "files",
    "dump_scenario": "files",
    "compose": "compose",
    "fly": "fly",
    "Flight": "fly",
    "score_seeds": "batch",
}
__all__ = sorted(_WHERE)


def __getattr__(name: str) -> Any:
    # Reading a scenario file does not need JAX: what computes is loaded on first use.
    if name in _WHERE:
        return getattr(import_module(f"rovtwin.scenario.{_WHERE[name]}"), name)
    raise AttributeError(f"module 'rovtwin.scenario' has no attribute {name!r}")
