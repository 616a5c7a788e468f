"""rovtwin: identify, simulate and control small underwater vehicles from one description.

These names are all that is public; what changes among them stands in CHANGELOG.md. They load on first use, so that
`rovtwin --help` answers before JAX is imported.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rovtwin._version import __version__

if TYPE_CHECKING:
    from rovtwin.api import (
        connect,
        fly,
        identify,
        load_scenario,
        load_vehicle,
        map,
        map_classify,
        plan_experiment,
        run_campaign,
        simulate,
        smooth,
        track,
        tune,
    )
    from rovtwin.campaign.session import CampaignSession
    from rovtwin.campaign.tuning.result import Tuned
    from rovtwin.core.block import Block
    from rovtwin.core.errors import (
        ConfigError,
        IdentificationError,
        LinkError,
        LinkTimeout,
        LogError,
        RovtwinError,
    )
    from rovtwin.core.flow import Command
    from rovtwin.core.link import Link
    from rovtwin.core.log import Log
    from rovtwin.identification.result import Identification
    from rovtwin.planning.plan import Plan
    from rovtwin.runs.flight import Flight
    from rovtwin.runs.smooth import SmoothedRun
    from rovtwin.scenario.schema import Scenario
    from rovtwin.simulation.roll_out import Trajectory
    from rovtwin.vehicle.description.vehicle import Vehicle
    from rovtwin.vehicle.physics.model import Model

_API = ("connect", "fly", "identify", "load_scenario", "load_vehicle")
_API += ("map", "map_classify", "plan_experiment", "run_campaign", "simulate", "smooth", "track", "tune")
_ERRORS = ("ConfigError", "IdentificationError", "LinkError", "LinkTimeout", "LogError", "RovtwinError")
_HOME = {
    **dict.fromkeys(_API, "api"),
    **dict.fromkeys(_ERRORS, "core.errors"),
    "Block": "core.block",
    "CampaignSession": "campaign.session",
    "Command": "core.flow",
    "Flight": "runs.flight",
    "Identification": "identification.result",
    "Link": "core.link",
    "Log": "core.log",
    "Model": "vehicle.physics.model",
    "Plan": "planning.plan",
    "Scenario": "scenario.schema",
    "SmoothedRun": "runs.smooth",
    "Trajectory": "simulation.roll_out",
    "Tuned": "campaign.tuning.result",
    "Vehicle": "vehicle.description.vehicle",
}
__all__ = [
    "Block",
    "CampaignSession",
    "Command",
    "ConfigError",
    "Flight",
    "Identification",
    "IdentificationError",
    "Link",
    "LinkError",
    "LinkTimeout",
    "Log",
    "LogError",
    "Model",
    "Plan",
    "RovtwinError",
    "Scenario",
    "SmoothedRun",
    "Trajectory",
    "Tuned",
    "Vehicle",
    "__version__",
    "connect",
    "fly",
    "identify",
    "load_scenario",
    "load_vehicle",
    "map",
    "map_classify",
    "plan_experiment",
    "run_campaign",
    "simulate",
    "smooth",
    "track",
    "tune",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'rovtwin' has no attribute {name!r}")
    return getattr(import_module(f"rovtwin.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return __all__
