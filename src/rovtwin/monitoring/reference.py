"""What a change is measured against: how well the vehicle's description was known when it was written."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.monitoring.factors import AXES
from rovtwin.vehicle import Vehicle

UNIT_TO_UNIT = 0.05  # by which the forces of thrusters of one make differ, as a share


def identified_std(vehicle: Vehicle, quantities: Sequence[str]) -> Float[np.ndarray, " q"] | None:
    """Standard deviation that the identification states of each quantity; None of one not identified.

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
    # A group is identified as one: how its thrusters differ it does not say, beyond what is usual of one make.
    out |= {f"thruster.{name}": float(np.hypot(value, UNIT_TO_UNIT)) for name, value in forces.items()}
    force = float(np.max(list(forces.values()))) if forces else np.nan  # NaN, if one of them is not known
    out["metacentric_height"] = std.get("restoring.metacentric_height", np.nan)
    out["net_buoyancy"] = std.get("restoring.net_buoyancy", np.nan)
    for side in "xy":
        out[f"center_of_buoyancy_{side}"] = std.get(f"restoring.center_of_buoyancy_{side}", np.nan)
    return np.array([_of(q, out, force) for q in quantities])


def _of(name: str, std: dict[str, float], force: float) -> float:
    kind, _, axis = name.partition(".")
    if kind == "force":
        return force
    if kind == "top_speed":  # where tests are at speed, errors of force and drag go together: an upper bound
        return float(0.5 * np.hypot(std[f"drag.{axis}"], force))
    return std.get(name, np.nan)
