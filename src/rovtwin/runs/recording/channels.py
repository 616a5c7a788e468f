"""The channels of a run's log, and how a chunk of records becomes their samples."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import pose, pose_covariance
from rovtwin.core.log import Channel
from rovtwin.core.sensors import SensorKind
from rovtwin.runs.loop import Record

ETA, NU, TAU = ("x", "y", "z", "phi", "theta", "psi"), ("u", "v", "w", "p", "q", "r"), ("X", "Y", "Z", "K", "M", "N")
ETA_UNITS, NU_UNITS, TAU_UNITS = ("m",) * 3 + ("rad",) * 3, ("m/s",) * 3 + ("rad/s",) * 3, ("N",) * 3 + ("N m",) * 3
PROGRESS = ("state", "misses", "possible", "current_north", "current_east")
PROGRESS_UNITS = ("1", "1", "m/s", "m/s", "m/s")
STD = tuple(f"std_{name}" for name in ETA + NU)


def log_channels(
    thrusters: list[str],
    sensors: Mapping[str, SensorKind],
    rate: float,
    with_sensors: bool,
    moving_surface: bool = False,
    batteries: Sequence[str] = (),
    tethers: Mapping[str, int] | None = None,
) -> list[Channel]:
    """All channels of a run, in the order in which viewers list them.

    Args:
        thrusters: Their names.
        sensors: What each reads, by name.
        rate: Of truth and autopilot channels [1/s].
        with_sensors: Whether readings are logged.
        moving_surface: Whether the world's surface moves.
        batteries: Names of those that are simulated.
        tethers: Number of nodes of each, by name.
    """
    thr = tuple(thrusters)
    table: list[tuple[str, tuple[str, ...], Any, str, str]] = [
        ("truth/eta", ETA, ETA_UNITS, "n", "true pose of CO"),
        ("truth/nu", NU, NU_UNITS, "b", "true velocity over ground"),
        ("truth/thrust", thr, "N", "b", "true force of each thruster"),
        ("truth/water_velocity", ("north", "east", "down"), "m/s", "n", "water velocity at CO"),
        ("truth/external_wrench", TAU, TAU_UNITS, "b", "wrench of waves, drift, tethers and forces of one's own at CO"),
        *([("truth/surface", ("depth",), "m", "n", "water surface above CO")] if moving_surface else []),
        *([("truth/battery", *_battery_fields(batteries), "", "what is left, and power drawn")] if batteries else []),
        *(row for name, nodes in (tethers or {}).items() for row in _tether_rows(name, nodes)),
        ("autopilot/eta", ETA, ETA_UNITS, "n", "estimated pose of CO"),
        ("autopilot/nu", NU, NU_UNITS, "b", "estimated velocity over ground"),
        ("autopilot/bias", TAU, TAU_UNITS, "", "estimated disturbance: force in n, moment in b"),
        (
            "autopilot/std",
            STD,
            ETA_UNITS + NU_UNITS,
            "",
            "standard deviation of eta and nu, by the filter's covariance",
        ),
        ("autopilot/setpoint", ETA, ETA_UNITS, "n", "pose that guidance asks for"),
        ("autopilot/reference", ETA, ETA_UNITS, "n", "pose of the reference model"),
        ("autopilot/leg", ("x0", "y0", "z0", "x1", "y1", "z1"), "m", "n", "start and end of the current leg"),
        ("autopilot/mode", ("phase", "reason", "waypoint", "on_leg"), "1", "", "state of the mission, as numbers"),
        (
            "autopilot/progress",
            PROGRESS,
            PROGRESS_UNITS,
            "n",
            "how guidance gets on, and the current that it reckons with",
        ),
        ("autopilot/tau", TAU, TAU_UNITS, "b", "wrench that the controller wants"),
        ("autopilot/saturated", TAU, "1", "b", "whether a limit cut that wrench"),
        ("autopilot/command", thr, "1", "", "normalised command of each thruster"),
        ("autopilot/health", thr, "1", "", "estimate of what each thruster still gives, a share"),
        ("autopilot/nis", tuple(sorted(sensors)), "1", "", "normalised innovation squared, summed per sensor"),
        ("autopilot/nis_dof", tuple(sorted(sensors)), "1", "", "scalar innovations in each sum"),
        ("score/nees", ("position", "pose_velocity"), "1", "", "normalised estimation error squared, 2 and 12 dof"),
        ("score/cross_track", ("distance", "valid"), ("m", "1"), "n", "horizontal distance of CO to the leg"),
    ]
    every_tick, rest = ("autopilot/nis", "autopilot/nis_dof"), ("score/",)
    channels = [
        Channel(n, f, u, frame, description=d, rate=None if n in every_tick or n.startswith(rest) else rate)
        for n, f, u, frame, d in table
    ]
    if with_sensors:
        channels += [sensor_channel(name, kind) for name, kind in sensors.items()]
    return channels


def sensor_channel(name: str, kind: SensorKind) -> Channel:
    """The channel of a sensor's readings, which are followed by the time at which they were valid."""
    fields, units = (*kind.fields, "t_valid"), (*kind.units, "s")
    return Channel(f"sensor/{name}", fields, units, kind.frame, description=kind.description)


def _battery_fields(batteries: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Fields and their units: charge of each battery, then power of each."""
    charge, power = (tuple(f"{name}_{what}" for name in batteries) for what in ("charge", "power"))
    return charge + power, ("1",) * len(charge) + ("W",) * len(power)


def _tether_rows(name: str, nodes: int) -> list[tuple[str, tuple[str, ...], Any, str, str]]:
    places = tuple(f"{axis}{i}" for i in range(nodes) for axis in "xyz")
    pull = ("tension", "north", "east", "down", "paid_out", "misjudged")
    units = ("N",) * 4 + ("m", "N")
    return [
        (
            f"truth/tether/{name}",
            pull,
            units,
            "n",
            "tension at the vehicle, force on it, length paid out, error",
        ),
        (f"truth/tether_shape/{name}", places, "m", "n", "places of the nodes, from the anchor to the vehicle"),
    ]


def truth_samples(record: Record, moving_surface: bool = False) -> dict[str, np.ndarray]:
    """Samples of the truth channels, leading axis n."""
    state = record.state
    samples = {
        "truth/eta": pose(state.position, state.attitude),
        "truth/nu": np.asarray(state.nu),
        "truth/thrust": np.asarray(state.thrust),
        "truth/water_velocity": np.asarray(record.water_velocity),
        "truth/external_wrench": np.asarray(record.external_wrench),
    }
    if moving_surface:
        samples["truth/surface"] = np.asarray(record.surface)[:, None]
    if (battery := record.battery) is not None:
        samples["truth/battery"] = np.concatenate([battery.charge, battery.power], axis=1)
    for name, line in record.tethers.items():
        force, length, misjudged = (np.asarray(x) for x in (line.force, line.length, line.misjudged))
        columns = [np.linalg.norm(force, axis=1)[:, None], force, length[:, None], misjudged[:, None]]
        samples[f"truth/tether/{name}"] = np.concatenate(columns, axis=1)
        samples[f"truth/tether_shape/{name}"] = np.asarray(line.nodes).reshape(len(length), -1)
    return samples


def autopilot_samples(record: Record) -> dict[str, np.ndarray]:
    """Samples of the autopilot channels, leading axis n."""
    out = record.autopilot
    estimate, setpoint = out.estimate, out.setpoint
    covariance = pose_covariance(estimate.covariance, estimate.attitude)
    mode = (setpoint.phase, setpoint.reason, setpoint.waypoint, setpoint.on_leg)
    stage = setpoint.progress
    progress = (stage.state, stage.misses, stage.possible, stage.current[:, 0], stage.current[:, 1])
    return {
        "autopilot/eta": pose(estimate.position, estimate.attitude),
        "autopilot/nu": np.asarray(estimate.nu),
        "autopilot/bias": np.asarray(estimate.bias),
        "autopilot/std": np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0)),
        "autopilot/setpoint": pose(setpoint.position, setpoint.attitude),
        "autopilot/reference": pose(out.reference.position, out.reference.attitude),
        "autopilot/leg": np.concatenate([setpoint.leg_start, setpoint.leg_end], axis=1),
        "autopilot/mode": np.stack([np.asarray(column, dtype=float) for column in mode], axis=1),
        "autopilot/progress": np.stack([np.asarray(column, dtype=float) for column in progress], axis=1),
        "autopilot/tau": np.asarray(out.wrench.tau),
        "autopilot/saturated": np.asarray(out.wrench.saturated, dtype=float),
        "autopilot/command": np.asarray(out.command.u),
        "autopilot/health": np.asarray(out.health),
    }


def nis_samples(record: Record) -> dict[str, np.ndarray]:
    """NIS and its degrees of freedom of every tick, leading axis n."""
    estimate = record.autopilot.estimate
    return {"autopilot/nis": np.asarray(estimate.nis), "autopilot/nis_dof": np.asarray(estimate.nis_dof, dtype=float)}


def sensor_samples(record: Record, t: Float[np.ndarray, " n"]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Readings as they came: per channel the ticks at which the autopilot got them and value with t_valid."""
    out = {}
    for name, slot in record.measurements.items():
        ticks, rows = np.nonzero(slot.valid)
        value, t_valid = np.asarray(slot.value)[ticks, rows], np.asarray(slot.t_valid)[ticks, rows]
        out[f"sensor/{name}"] = (t[ticks], np.concatenate([value, t_valid[:, None]], axis=1))
    return out
