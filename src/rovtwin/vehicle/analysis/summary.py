"""What a vehicle amounts to: `summary` as plain data (JSON), `render` as tables for a terminal."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from rovtwin.core.arrays.rotations import euler_from_rotation
from rovtwin.core.numerics import jax
from rovtwin.core.sensors import SENSORS
from rovtwin.vehicle.analysis.lint import findings, uncontrollable
from rovtwin.vehicle.analysis.performance import AxisPerformance, performance
from rovtwin.vehicle.analysis.stability import hang, reach, stability, steady_speed
from rovtwin.vehicle.constants import AXES, GRAVITY
from rovtwin.vehicle.description.instruments import Instrument, instruments
from rovtwin.vehicle.description.power import PowerSource
from rovtwin.vehicle.description.schema import Curve, Thruster
from rovtwin.vehicle.description.thruster_arrays import direction_vector
from rovtwin.vehicle.description.totals.assembly import bodies
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.actuation import rank
from rovtwin.vehicle.physics.model import Model

FORCES, VELOCITIES = "XYZKMN", "uvwpqr"

# Matrices of the model: how the element in row i, column j is called and in which unit.
_INERTIA = (("kg", "kg m"), ("kg m", "kg m2"))
_LINEAR = (("N s/m", "N s/rad"), ("N s", "N m s/rad"))
_QUADRATIC = (("N s2/m2", "N s2/rad2"), ("N s2/m", "N m s2/rad2"))
MATRICES = {
    "rigid_body_mass": ("M_RB", None, _INERTIA),
    "added_mass": ("M_A", "{F}_{v}dot", _INERTIA),
    "linear_damping_ahead": ("D_L", "{F}_{v}", _LINEAR),
    "linear_damping_astern": ("D_L astern", "{F}_{v} astern", _LINEAR),
    "quadratic_damping_ahead": ("D_Q", "{F}_{v}|{v}|", _QUADRATIC),
    "quadratic_damping_astern": ("D_Q astern", "{F}_{v}|{v}| astern", _QUADRATIC),
}


def summary(vehicle: Vehicle) -> dict[str, Any]:
    """All that `rovtwin vehicle show` prints, JSON-serialisable; names carry their units, angles are degrees."""
    model = vehicle.model()
    solid = vehicle.assembly.solid
    floating, steady, limits = hang(model), stability(model), reach(model)
    T = np.asarray(model.thrusters.configuration)
    return {
        "name": vehicle.name,
        "description": vehicle.description,
        "file": vehicle.where,
        "water_density_kgm3": vehicle.assembly.density,
        "gravity_ms2": GRAVITY,
        "mass_kg": solid.mass,
        "weight_N": float(model.weight),
        "buoyancy_N": float(model.buoyancy),
        "net_buoyancy_N": floating.net_buoyancy,
        "volume_m3": vehicle.assembly.volume,
        "center_of_gravity_m": _plain(solid.center_of_gravity),
        "center_of_buoyancy_m": _plain(model.center_of_buoyancy),
        "inertia_about_cg_kgm2": _plain(solid.inertia),
        "inertia_about_co_kgm2": _plain(solid.inertia_about(np.zeros(3))),
        "metacentric_height_m": floating.metacentric_height,
        "righting_stiffness_Nm_per_rad": {"roll": float(floating.stiffness[0]), "pitch": float(floating.stiffness[1])},
        "matrices": {
            name: {"symbol": symbol, "values": _plain(getattr(model, name)), "units": units}
            for name, (symbol, _, units) in MATRICES.items()
        },
        "derivatives": derivatives(model),
        "thrusters": [_thruster(vehicle, model, i) for i in range(model.thrusters.count)],
        "allocation": {
            "matrix": _plain(T),
            "rows": list(FORCES),
            "rank": rank(T),
            "uncontrollable": uncontrollable(T),
        },
        "largest_wrench": {axis: _plain(limits[i]) for i, axis in enumerate(AXES)},
        "performance": _performance(model),
        "trim": _trim(model, floating),
        "natural_periods_s": {
            "roll": _number(floating.periods[0]),
            "pitch": _number(floating.periods[1]),
            "heave": None,
        },
        "stability": {
            "munk_pitch_kg": steady.munk_pitch,
            "munk_yaw_kg": steady.munk_yaw,
            "munk_roll_kg": steady.munk_roll,
            "roll_static_speed_ms": _number(steady.roll_static),
            "pitch_static_speed_ms": _number(steady.pitch_static),
            "pitch_depth_held_speed_ms": _number(steady.pitch_depth_held),
            "pitch_free_speed_ms": _number(steady.pitch_free),
            "yaw_free_speed_ms": _number(steady.yaw_free),
        },
        "cameras": [_mounted(c) for c in vehicle.cameras],
        "sensors": [_mounted(s) | {"kind": getattr(s.item, "kind", "")} for s in vehicle.sensors],
        "instruments": [_instrument(one) for one in instruments(vehicle)],
        "tethers": [_tether(t) for t in vehicle.tethers],
        "batteries": [_battery(source, vehicle.thruster_names) for source in vehicle.power_sources],
        "learned": _learned(vehicle),
        "sources": sources(vehicle),
        "findings": findings(vehicle, model),
    }


def _plain(array: Any) -> Any:
    # Rounding removes what a rotation by 90 degrees leaves, 1e-17; adding zero removes the sign of -0.0.
    return (np.round(np.asarray(array, dtype=float), 12) + 0.0).tolist()


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def derivatives(model: Model) -> list[dict[str, Any]]:
    """Hydrodynamic derivatives that are not zero, with SNAME's signs: X_udot = -M_A[0, 0]; astern where they differ."""
    found = []
    for name, (_, pattern, units) in MATRICES.items():
        if pattern is None:
            continue
        values = np.asarray(getattr(model, name))
        shown = np.abs(values) > 1e-9
        if name.endswith("astern"):
            shown = np.abs(values - np.asarray(getattr(model, name.replace("astern", "ahead")))) > 1e-9
        for i, j in zip(*np.nonzero(shown), strict=True):
            symbol = pattern.format(F=FORCES[i], v=VELOCITIES[j])
            found.append({"symbol": symbol, "value": -float(values[i, j]), "unit": units[i // 3][j // 3]})
    return found


def _thruster(vehicle: Vehicle, model: Model, i: int) -> dict[str, Any]:
    mounted, arrays = vehicle.assembly.thrusters[i], jax.device_get(model.thrusters)
    item = mounted.item
    assert isinstance(item, Thruster)
    curve = "linear"
    if isinstance(item.curve, Curve):
        curve = "table" if item.curve.power is None else f"power {item.curve.power:g}"
    return {
        "name": mounted.name,
        "position_m": _plain(mounted.placement.point(np.array(item.position))),
        "direction": _plain(mounted.rotation @ direction_vector(item.direction)),
        "force_ahead": float(arrays.force_ahead[i]),
        "force_astern": float(arrays.force_astern[i]),
        "curve": curve,
        "dead_band": float(arrays.dead_band[i]),
        "time_constant_s": float(arrays.time_constant[i]),
        "rate_limit_N_per_s": _number(float(arrays.rate_limit[i])),
        "quantisation": float(arrays.quantisation[i]),
        "health": float(arrays.health[i]),
        "inflow_loss_s_per_m": 0.0 if arrays.inflow_loss is None else float(arrays.inflow_loss[i]),
    }


def _performance(model: Model) -> dict[str, Any]:
    """What it can do in each direction; null where it never comes to that."""

    def entry(axis: str, able: AxisPerformance) -> dict[str, Any]:
        turns = axis == "yaw"
        force, speed, way = ("moment_Nm", "deg_per_s", "angle_deg") if turns else ("force_N", "ms", "distance_m")
        scale = 180.0 / np.pi if turns else 1.0
        # In a steady current only the velocity through the water counts: the largest that is held is the top speed.
        current = {} if turns else {"largest_current_ms": _number(able.top_speed)}
        return {
            force: able.force,
            f"top_speed_{speed}": _number(scale * able.top_speed),
            **current,
            f"stopping_{way}": _number(scale * able.stopping_distance),
            "stopping_time_s": _number(able.stopping_time),
            f"coasting_{way}": _number(scale * able.coasting_distance),
            "coasting_time_s": _number(able.coasting_time),
        }

    return {
        axis: {direction: entry(axis, able) for direction, able in directions.items()}
        for axis, directions in performance(model).items()
    }


def _trim(model: Model, floating: Any) -> dict[str, Any]:
    drift = steady_speed(model, 2, -floating.net_buoyancy, thrust=False)
    return {
        "roll_deg": _number(float(np.degrees(floating.trim[0]))),
        "pitch_deg": _number(float(np.degrees(floating.trim[1]))),
        # z is down: a vehicle that floats needs a positive heave force to stay.
        "heave_force_N": floating.net_buoyancy,
        "drift_speed_ms": _number(-np.sign(floating.net_buoyancy) * drift + 0.0),
    }


def _mounted(mounted: Any) -> dict[str, Any]:
    return {
        "name": mounted.name,
        "position_m": _plain(mounted.position),
        "attitude_deg": np.round(np.degrees(euler_from_rotation(mounted.rotation)), 9).tolist(),
    }


def _instrument(one: Instrument) -> dict[str, Any]:
    """Figures of one that measures, in the unit of its kind."""
    units = sorted(set(SENSORS[one.kind].units))
    return {"name": one.part, "kind": one.kind, "unit": ", ".join(units), "spare": one.spare} | one.figures


def _tether(mounted: Any) -> dict[str, Any]:
    item = mounted.item
    return {
        "name": mounted.name,
        "position_m": _plain(mounted.placement.point(item.position)),
        "length_m": item.length,
        "diameter_m": item.diameter,
        "wet_weight_N_per_m": item.wet_weight,
        "normal_drag": item.normal_drag,
        "tangential_drag": item.tangential_drag,
        "stiffness_N": item.stiffness,
    }


def _learned(vehicle: Vehicle) -> dict[str, Any] | None:
    """The discrepancy that tests have found, None without one: parts with the size of the wrench they hold."""
    found = None if vehicle.file.identified is None else vehicle.file.identified.discrepancy
    if found is None:
        return None
    parts = [{"axis": part.axis, "of": part.of, "prior_std": part.std, "functions": len(part.weights)}
             for part in found.parts]  # fmt: skip
    return {"parts": parts, "reason": found.reason}


def _battery(source: PowerSource, thrusters: Sequence[str]) -> dict[str, Any]:
    return {
        "name": source.name,
        "capacity_Wh": source.capacity_wh,
        "hotel_load_W": source.hotel_load,
        "thrusters": [thrusters[i] for i in source.feeds],
    }


def sources(vehicle: Vehicle) -> list[dict[str, str]]:
    """Where values come from, as the files say: place and text, each text once."""
    found: dict[str, str] = {}
    for place, body in bodies(vehicle.file, vehicle.name):
        blocks = [("", body), ("rigid_body", body.rigid_body), ("restoring", body.restoring)]
        blocks += [("hydrodynamics", body.hydrodynamics)]
        blocks += [(f"thrusters.{t.name}", t) for t in body.thrusters]
        blocks += [(f"cameras.{c.name}", c) for c in body.cameras] + [(f"sensors.{s.name}", s) for s in body.sensors]
        blocks += [(f"tethers.{t.name}", t) for t in body.tethers]
        for block_name, block in blocks:
            where = ".".join(p for p in (place, block_name) if p)
            if block is not None and block.source:
                found.setdefault(block.source, where)
            for key, text in getattr(block, "sources", {}).items():
                found.setdefault(text, f"{where}.{key}")
    return [{"where": where, "source": " ".join(text.split())} for text, where in found.items()]


def render(found: dict[str, Any]) -> list[Any]:
    """A summary as rich renderables, in reading order."""
    from rovtwin.vehicle.analysis.tables import tables

    return tables(found)
