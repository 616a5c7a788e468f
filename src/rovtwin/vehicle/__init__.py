"""The vehicle: its description in a file of parts, the Model built from it, and the plant's equations of motion.

`load_vehicle("double_blueye").model()` is the whole path. Depends on `core` only. The names here are loaded on first
use, so that reading a file does not start JAX.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rovtwin.vehicle.files import list_devices, list_library
    from rovtwin.vehicle.findings import check
    from rovtwin.vehicle.model import Model
    from rovtwin.vehicle.show import render, summary
    from rovtwin.vehicle.vehicle import Vehicle, load_vehicle, vehicle_from_dict, vehicle_schema

_HOME = {
    "Model": "model",
    "Vehicle": "vehicle",
    "check": "findings",
    "list_devices": "files",
    "list_library": "files",
    "load_vehicle": "vehicle",
    "render": "show",
    "summary": "show",
    "vehicle_from_dict": "vehicle",
    "vehicle_schema": "vehicle",
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
