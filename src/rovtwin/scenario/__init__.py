"""What a run is: schema and files of scenarios and missions. How it runs is in `runs`.

The names here are loaded on first use.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rovtwin.scenario.files import dump_scenario, list_missions, list_scenarios, load_mission, load_scenario
    from rovtwin.scenario.schema import Scenario

_HOME = {
    "Scenario": "schema",
    "load_scenario": "files",
    "load_mission": "files",
    "list_scenarios": "files",
    "list_missions": "files",
    "dump_scenario": "files",
}
__all__ = [
    "Scenario",
    "dump_scenario",
    "list_missions",
    "list_scenarios",
    "load_mission",
    "load_scenario",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
