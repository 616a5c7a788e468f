"""The result as a vehicle file: the description with an `identified:` block that twin and autopilot load."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from rovtwin.core.user_files.yamlfile import Dumper
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.identified import fingerprint
from rovtwin.vehicle.description.schema import LearnedDiscrepancy
from rovtwin.vehicle.physics.model import Model

_DIGITS = 8
_EXACT = 15  # digits of a covariance: what is known best of it is a part in 10^10 of what is known least


def identified_file(
    vehicle: Vehicle,
    parameters: Parameters,
    theta: Float[np.ndarray, " n"],
    covariance: Float[np.ndarray, "n n"],
    prior: Gaussian,
    verdicts: Sequence[str],
    evidence: Sequence[str],
    findings: Sequence[str],
    tested: Mapping[str, tuple[float, float]],
    doubts: Sequence[str] = (),
    discrepancy: LearnedDiscrepancy | None = None,
) -> dict[str, Any]:
    """A complete vehicle file as plain data, loadable by `vehicle_from_dict`."""
    model, _ = parameters.model_at(theta)
    data = vehicle.to_dict()
    data.pop("identified", None)
    std, before = np.sqrt(np.diag(covariance)), np.sqrt(np.diag(prior.covariance))
    values = parameters.values(theta)
    estimate = {
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "value": _short(values[i]),
                "base": _short(p.base),
                "positive": p.positive,
                "std": _short(std[i]),
                "prior_std": _short(before[i]),
                "verdict": verdicts[i],
            }
            for i, p in enumerate(parameters.free)
        ],
        "covariance": [[_short(x, _EXACT) for x in row] for row in covariance],
        "evidence": list(evidence),
        "findings": list(findings),
        **({"doubts": list(doubts)} if doubts else {}),
        "groups": {group: [vehicle.thruster_names[i] for i in rows] for group, rows in parameters.groups.items()},
        "tested": {name: [_short(x) for x in ends] for name, ends in tested.items()},
    }
    lever = np.asarray(model.center_of_buoyancy)
    data["identified"] = {
        "made_with": fingerprint(vehicle.file),
        "hydrodynamics": {
            "added_mass": _rows(model.added_mass),
            "linear_damping": _rows(model.linear_damping_ahead),
            "quadratic_damping": _rows(model.quadratic_damping_ahead),
            "linear_damping_astern": _rows(model.linear_damping_astern),
            "quadratic_damping_astern": _rows(model.quadratic_damping_astern),
        },
        "restoring": {
            "net_buoyancy": _short(model.buoyancy - model.weight),
            "center_of_buoyancy": [_short(x) for x in lever],
        },
        "thrusters": _thrusters(vehicle, model),
        **({} if discrepancy is None else {"discrepancy": discrepancy.model_dump(mode="json")}),
        "estimate": estimate,
    }
    return data


def _thrusters(vehicle: Vehicle, model: Model) -> dict[str, dict[str, Any]]:
    thrusters = model.thrusters
    out = {}
    for i, name in enumerate(vehicle.thruster_names):
        entry: dict[str, Any] = {"time_constant": _short(thrusters.time_constant[i])}
        if bool(thrusters.tabulated[i]):
            points = np.stack([np.asarray(thrusters.table_command), np.asarray(thrusters.table_force)[i]], axis=1)
            entry["curve"] = {"table": [[_short(u), _short(f)] for u, f in points]}
        else:
            entry["force"] = {"ahead": _short(thrusters.force_ahead[i]), "astern": _short(thrusters.force_astern[i])}
            entry["curve"] = {"power": _short(thrusters.exponent[i])}
            entry["dead_band"] = _short(thrusters.dead_band[i])
        if thrusters.inflow_loss is not None:  # an estimate below 0 is none: an inflow gives nothing
            entry["inflow_loss"] = max(0.0, _short(thrusters.inflow_loss[i]))
        out[name] = entry
    return out


def _short(x: Any, digits: int = _DIGITS) -> float:
    return float(f"{float(x):.{digits}g}")


def _rows(matrix: Any) -> list[list[float]]:
    return [[_short(x) for x in row] for row in np.asarray(matrix)]


class _Dumper(Dumper):
    """Lists of numbers on one line: a matrix reads as a matrix."""


def _represent_list(dumper: yaml.SafeDumper, data: list) -> yaml.Node:
    flat = all(isinstance(x, int | float | str) for x in data) and not any(
        isinstance(x, str) and len(x) > 40 for x in data
    )
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=flat)


def _represent_dict(dumper: yaml.SafeDumper, data: dict) -> yaml.Node:
    flat = set(data) >= {"name", "std", "verdict"}
    return dumper.represent_mapping("tag:yaml.org,2002:map", data.items(), flow_style=flat)


_Dumper.add_representer(list, _represent_list)
_Dumper.add_representer(dict, _represent_dict)


def to_yaml(data: dict[str, Any], command: str) -> str:
    """Text of the file, with a first line that says how it was made."""
    return f"# Made by: {command}\n" + yaml.dump(
        data, Dumper=_Dumper, sort_keys=False, width=10_000, allow_unicode=True
    )
