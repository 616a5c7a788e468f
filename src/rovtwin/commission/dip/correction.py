"""A vehicle file with thrusters as they were found: reversed ones turned, swapped ones with each other's names."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.commission.dip.diagnosis import Verdict
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.vehicle import vehicle_from_dict


def corrected(vehicle: Vehicle, found: Sequence[Verdict], path: Path) -> bool:
    """Write it; whether there was something that a file can put right.

    Args:
        vehicle: As described.
        found: Of each of its thrusters, in their order.
        path: Of the new file.
    """
    data = vehicle.to_dict()
    rows = list(_thrusters(data))
    if [row["name"] for row in rows] != [name.rsplit(".", 1)[-1] for name in vehicle.thruster_names]:
        return False
    changed = False
    for row, verdict in zip(rows, found, strict=True):
        if verdict.what == "reversed":
            _turn(row)
            changed = True
    places = {name: k for k, name in enumerate(vehicle.thruster_names)}
    for name, other in {tuple(sorted((v.name, v.other))) for v in found if v.what == "swapped"}:
        first, second = rows[places[name]], rows[places[other]]
        # What lies where is known by the pushes: the wires have changed places, so each name goes to the other's place.
        for key in ("position", "direction"):
            there, here = second.pop(key, None), first.pop(key, None)
            first |= {} if there is None else {key: there}
            second |= {} if here is None else {key: here}
        changed = True
    if changed and np.allclose(_columns(vehicle_from_dict(data, str(path))), _intended(vehicle, found), atol=1e-6):
        write_text(path, "# As rovtwin commission found its thrusters; compare before you use it.\n" + dump_yaml(data))
        return True
    return False


def _columns(vehicle: Vehicle) -> Float[np.ndarray, "6 n"]:
    return np.asarray(vehicle.model().thrusters.configuration)


def _intended(vehicle: Vehicle, found: Sequence[Verdict]) -> Float[np.ndarray, "6 n"]:
    """Columns of the thrusters as they were found: names in one part may mean other places in another."""
    T = _columns(vehicle).copy()
    before, names = T.copy(), list(vehicle.thruster_names)
    for i, one in enumerate(found):
        if one.what == "reversed":
            T[:, i] = -before[:, i]
        elif one.what == "swapped":
            T[:, i] = before[:, names.index(one.other)]
    return T


def _thrusters(body: dict[str, Any]) -> Any:
    """Descriptions of thrusters, in the order of the model's."""
    yield from body.get("thrusters", [])
    for part in body.get("parts", []):
        yield from _thrusters(part)


def _turn(row: dict[str, Any]) -> None:
    """Make a positive command push the other way, with the same forces."""
    direction = row["direction"]
    if isinstance(direction, dict):
        turned = (float(direction.get("azimuth_deg", 0.0)) + 180.0 + 180.0) % 360.0 - 180.0
        row["direction"] = direction | {
            "azimuth_deg": turned,
            "elevation_deg": -float(direction.get("elevation_deg", 0.0)),
        }
    else:
        row["direction"] = (-np.asarray(direction, dtype=float)).tolist()
    force = row.get("force")
    if isinstance(force, dict):
        row["force"] = {"ahead": force["astern"], "astern": force["ahead"]}
    curve = row.get("curve")
    if isinstance(curve, dict) and curve.get("table") is not None and isinstance(curve["table"], list):
        curve["table"] = sorted([-float(u), -float(f)] for u, f in curve["table"])
