"""A commissioning written by hand: all stages with plausible figures, or with some missing."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Check, Outcome, Stage
from rovtwin.core.log import Channel, Log
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.identification.identify import identify
from rovtwin.vehicle import load_vehicle

NAMES = ("paper", "bench", "dip", "drill", "scale", "excite", "identify", "prove", "predict")
STAGES = tuple(
    Stage(name, name.capitalize(), f"what {name} finds out", "Go on.", False, lambda work: Outcome()) for name in NAMES
)

PARAMETERS = [
    {"name": "restoring.net_buoyancy", "unit": "N", "value": 2.1, "interval_95": [1.9, 2.3], "verdict": "learnt"},
    {"name": "added_mass.roll", "unit": "kg m2", "value": 0.3, "interval_95": [0.2, 0.4], "verdict": "prior only"},
    *(
        {"name": f"thrusters.{group}.{figure}", "unit": "N", "value": value,
         "interval_95": [0.97 * value, 1.03 * value], "verdict": "learnt"}
        for group in ("surge", "sway", "heave")
        for figure, value in (("force_ahead", 31.2), ("force_astern", 24.8))
    ),
]  # fmt: skip

MEASURED: dict[str, dict[str, Any]] = {
    "paper": {"vehicle": "double_blueye", "figures": [{"key": "mass", "label": "mass", "unit": "kg", "value": 24.1}]},
    "bench": {
        "sensors": [
            {"name": "gyro", "rate_hz": 50.0, "age_s": 0.012, "units": ["rad/s"] * 3, "noise": [3.1e-4, 2.9e-4, 3e-4],
             "allan_1s": [1e-4] * 3, "mean": [0.0] * 3},
            {"name": "pressure", "rate_hz": 20.0, "age_s": 0.031, "units": ["m"], "noise": [1.1e-3],
             "allan_1s": [2e-4], "mean": [0.02]},
            {"name": "position", "rate_hz": 0.9, "age_s": 0.24, "units": ["m"] * 2, "noise": [None, None],
             "allan_1s": [None, None], "mean": [0.1, 0.2]},
        ],
        "battery_v": 15.9,
    },
    "dip": {"thrusters": [{"thruster": "port.surge", "verdict": "ok", "share": 0.98}]},
    "drill": {
        "thrusters_off": [
            {"event": event, "axis": "yaw", "seconds": seconds, "interval_95": [seconds - 0.02, seconds + 0.03],
             "within_s": within, "command": 0.6}
            for event, seconds, within in (("STOP", 0.04, 0.5), ("the line is cut", 1.9, 5.0))
        ],
    },
    "scale": {"anchors": [{"bollard": {"direction": "surge", "command": 1.0, "force": 31.2, "sd": 0.6}}]},
    "excite": {"logs": ["part-1/log.mcap"], "vehicle_file": "so_far.yaml", "minutes": 7.5, "intervals": []},
    "identify": {
        "vehicle_file": "identified.yaml",
        "result_file": "identified.nc",
        "parameters": PARAMETERS,
        "damping": [
            {"axis": axis, "speed": speed, "force": force, "half_width_share": share}
            for axis, speed, force, share in (
                ("surge", 0.5, 12.4, 0.021), ("surge", 1.0, 41.0, 0.028), ("sway", 0.4, 18.2, 0.033),
                ("heave", 0.3, 15.5, 0.046), ("yaw", 0.6, 4.4, 0.071),
            )
        ],
        "repeatability": [
            {"axis": axis, "speed": speed, "unit": unit, "together": force, "alone": {"part-1": force, "part-2": force},
             "largest_difference": gap, "expanded_uncertainty": width, "en": gap / width,
             "between": ["part-1", "part-2"]}
            for axis, speed, unit, force, gap, width in (
                ("surge", 1.0, "N", 41.0, 0.6, 1.5), ("yaw", 0.6, "N m", 4.4, 0.2, 0.35),
            )
        ],
        "budget": [
            {"quantity": "damping in surge at +1 m/s", "value": 41.0, "unit": "N", "combined_std": 0.57,
             "coverage_factor": 2.0, "expanded": 1.15, "expanded_share": 0.028, "contributions": [
                 {"source": "readings of this test", "type": "A", "std": 0.5},
                 {"source": "reading of the scale", "type": "B", "std": 0.28}]},
        ],
    },
    "prove": {
        "envelope": [
            {"current_m_s": current, "sea_m": sea, "missions": 20, "succeeded": good, "share": good / 20,
             "interval_95": [0.01 * low, 1.0 if good == 20 else 0.97]}
            for current, sea, good, low in (
                (0.0, 0.0, 20, 83.2), (0.0, 0.2, 20, 83.2), (0.1, 0.0, 20, 83.2), (0.1, 0.2, 19, 75.1),
                (0.2, 0.0, 19, 75.1), (0.2, 0.2, 14, 45.7),
            )
        ],
        "largest_current_m_s": 0.1,
        "autopilot": "hand-tuned gains were kept",
        "autopilot_file": "autopilot.yaml",
    },
    "predict": {
        "inside": {"north": 0.951, "east": 0.944, "depth": 0.962, "heading": 0.938},
        "verdict": "inside",
        "axes": [{"axis": axis, "inside": 0.95, "verdict": "inside"} for axis in ("north", "east", "depth", "heading")],
        "log": "flight/log.mcap",
    },
}  # fmt: skip

FULL = {name: Outcome((Check("ok", name, "as expected"),), MEASURED[name], (), 60.0) for name in NAMES}
BARE = {name: Outcome((Check("ok", name, "as expected"),), {}) for name in NAMES} | {
    "scale": Outcome((Check("warning", "scale", "no force was measured."),), {"anchors": []}, (), 0.0,
                     "forces and masses are known up to a common scale of ±12 %"),
}  # fmt: skip


def small_log(path: Path, **metadata: str) -> None:
    """A log of three readings."""
    path.parent.mkdir(parents=True, exist_ok=True)
    channel = Channel("sensor/depth", ("depth", "t_valid"), ("m", "s"), "n", "depth", 20.0)
    values = np.array([[0.5, 0.0], [0.51, 0.05], [0.52, 0.1]])
    data = {channel.name: (np.array([0.0, 0.05, 0.1]), values)}
    Log.from_arrays([channel], data, {"created": "2026-11-20T10:00:00Z", **metadata}).write(path)


def vehicle_file(folder: Path) -> Path:
    """The Double Blueye as a file of one's own, in a folder with a person's name."""
    path = folder / "anna" / "my.yaml"
    path.parent.mkdir(parents=True)
    path.write_text(dump_yaml(load_vehicle("double_blueye").to_dict()))
    return path


def written(folder: Path, outcomes: dict[str, Outcome] | None = None, failed: bool = True) -> Dossier:
    """A dossier in `folder/commissioned` whose stages are passed; the dip once failed before and once was cut off."""
    outcomes = FULL if outcomes is None else outcomes
    vehicle = vehicle_file(folder)
    request = Request(str(vehicle), "blueye://anna:secret@192.168.1.101", tank="6x3x1.5")
    dossier = Dossier.begin(folder / "commissioned", request)
    for number, stage in enumerate(STAGES, start=1):
        if stage.name == "dip" and failed:
            wrong = Check("stop", "port.surge", "it pushes astern, expected ahead.", "Swap two of its phases.")
            dossier.end(dossier.next_attempt(number, stage), Outcome((wrong,), {}, (), 20.0))
            small_log(dossier.next_attempt(number, stage).folder / "log.mcap")
        attempt = dossier.next_attempt(number, stage)
        if stage.name == "prove" and "autopilot_file" in outcomes[stage.name].measured:
            (attempt.folder / "autopilot.yaml").write_text("kind: model_based\n")
        if stage.name in ("excite", "predict"):
            within = "part-1" if stage.name == "excite" else "flight"
            command = f"rovtwin commission {vehicle} -o {folder / 'commissioned'}"
            small_log(attempt.folder / within / "log.mcap", command=command, note=str(attempt.folder / "part-1"))
        if stage.name == "identify" and outcomes[stage.name].measured:
            result = identify(load_vehicle(str(vehicle)))
            data = result.file()
            (attempt.folder / "identified.yaml").write_text(dump_yaml(data))
            result.save(attempt.folder / "identified.nc")
        dossier.end(attempt, outcomes[stage.name])
    return Dossier.open(dossier.folder)


def dated(dossier: Dossier) -> Dossier:
    """The same with fixed times, so that two of them are alike."""
    index = dossier.folder / "commission.json"
    data = json.loads(index.read_text())
    for k, one in enumerate(data["attempts"]):
        one["began"] = f"2026-11-20T10:{k:02d}:00.000Z"
    index.write_text(json.dumps(data))
    return Dossier.open(dossier.folder)
