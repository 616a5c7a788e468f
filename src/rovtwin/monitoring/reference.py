"""What a change is measured against: how well the vehicle's description was known when it was written."""

from collections.abc import Sequence

import numpy as np

from rovtwin.monitoring.factors import AXES
from rovtwin.vehicle import Vehicle


def identified_std(vehicle: Vehicle, quantities: Sequence[str]) -> np.ndarray | None:
    """Standard deviation that the identification states of each quantity, shape (q,); None of one not identified.

    NaN where it states none. That of a drag is the larger one of its linear and quadratic coefficients, that of a
    force the larger one ahead and astern: upper bounds, for errors of the two go against each other.
    """
    found = vehicle.file.identified
    if found is None:
        return None
    std = {p.name: p.std for p in found.estimate.parameters}
    groups = found.estimate.groups
    names = list(vehicle.thruster_names)
    out = {}
    for axis in AXES:
        parts = [std[key] for kind in ("linear", "quadratic") if (key := f"{kind}_damping.{axis}") in std]
        out[f"drag.{axis}"] = max(parts, default=np.nan)
        out[f"added_mass.{axis}"] = std.get(f"added_mass.{axis}", np.nan)
    forces = {name: np.nan for name in names}
    for group, members in groups.items():
        ends = [std[key] for end in ("ahead", "astern") if (key := f"thrusters.{group}.force_{end}") in std]
        forces |= {member: max(ends, default=np.nan) for member in members}
    out |= {f"thruster.{name}": value for name, value in forces.items()}
    out["metacentric_height"] = std.get("restoring.metacentric_height", np.nan)
    out["net_buoyancy"] = std.get("restoring.net_buoyancy", np.nan)
    for side in "xy":
        out[f"center_of_buoyancy_{side}"] = std.get(f"restoring.center_of_buoyancy_{side}", np.nan)
    return np.array([_of(q, out, forces) for q in quantities])


def _of(name: str, std: dict[str, float], forces: dict[str, float]) -> float:
    kind, _, axis = name.partition(".")
    if kind == "force":
        return max(forces.values(), default=np.nan)
    if kind == "top_speed":  # errors of force and drag go together: this is an upper bound, too
        return float(0.5 * np.hypot(std[f"drag.{axis}"], max(forces.values(), default=np.nan)))
    return std.get(name, np.nan)
