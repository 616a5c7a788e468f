"""rovtwin: identify, simulate and control small underwater vehicles from one description.

The names below load on first use, so that `rovtwin --help` answers before JAX is imported.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from rovtwin._version import __version__

if TYPE_CHECKING:
    from rovtwin.core.log import Log
    from rovtwin.identification.identify import identify
    from rovtwin.identification.result import Identification
    from rovtwin.runs.fly import fly
    from rovtwin.scenario.files import load_scenario
    from rovtwin.vehicle.description.vehicle import Vehicle, load_vehicle
    from rovtwin.vehicle.physics.model import Model

_WHERE = {
    "load_vehicle": "rovtwin.vehicle",
    "Vehicle": "rovtwin.vehicle",
    "Model": "rovtwin.vehicle",
    "load_scenario": "rovtwin.scenario.files",
    "fly": "rovtwin.runs.fly",
    "Log": "rovtwin.core.log",
    "identify": "rovtwin.identification.identify",
    "Identification": "rovtwin.identification.result",
}
__all__ = [
    "Identification",
    "Log",
    "Model",
    "Vehicle",
    "__version__",
    "fly",
    "identify",
    "load_scenario",
    "load_vehicle",
]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'rovtwin' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
