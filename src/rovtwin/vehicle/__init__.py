"""The vehicle: its description in a file of parts, the Model built from it, and the plant's equations of motion.

`load_vehicle("double_blueye").model()` is the whole path. Depends on `core` only. The names here are loaded on first
use, so that reading a file does not start JAX.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rovtwin.vehicle.analysis.lint import check
    from rovtwin.vehicle.analysis.summary import render, summary
    from rovtwin.vehicle.description.files import list_devices, list_library
    from rovtwin.vehicle.description.vehicle import Vehicle, load_vehicle, vehicle_from_dict, vehicle_schema
    from rovtwin.vehicle.physics.model import Model

_HOME = {
    "Model": "physics.model",
    "Vehicle": "description.vehicle",
    "check": "analysis.lint",
    "list_devices": "description.files",
    "list_library": "description.files",
    "load_vehicle": "description.vehicle",
    "render": "analysis.summary",
    "summary": "analysis.summary",
    "vehicle_from_dict": "description.vehicle",
    "vehicle_schema": "description.vehicle",
}

__all__ = [
    "Model",
    "Vehicle",
    "check",
    "list_devices",
    "list_library",
    "load_vehicle",
    "render",
    "summary",
    "vehicle_from_dict",
    "vehicle_schema",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
