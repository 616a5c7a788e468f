"""The last step of the demonstration, chapter 8.1 in short: the twin is filmed by its own camera and identified."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from rovtwin.core.log.pictures import read_pictures
from rovtwin.core.user_files.config import parse
from rovtwin.core.vision import opencv
from rovtwin.identification.identify import Identification, identify
from rovtwin.identification.logs.readers import read_records
from rovtwin.positioning.images.detection import Detector
from rovtwin.report.cameras.sight import Seen, draw_seen
from rovtwin.runs.fly import fly
from rovtwin.runs.track import track_run
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle, load_vehicle, vehicle_from_dict

VEHICLE = "double_blueye"
FREE = ("added_mass.surge", "linear_damping.surge", "quadratic_damping.surge")
# What the guess has of the true values: off by more than formulas usually are.
WRONG = {"added_mass": 0.6, "linear_damping": 2.0, "quadratic_damping": 0.6, "quadratic_damping_astern": 0.6}
TEST = {
    "name": "camera",
    "description": "Free running in surge before a wall with markers, filmed by the vehicle.",
    "vehicle": VEHICLE,
    "duration": 40,
    "start": {"position": [0.5, 0.0, 1.0]},
    "test": {
        "name": "free running",
        "manoeuvres": [
            {
                "manoeuvre": "steps",
                "axis": "surge",
                "levels": [0.5, 0.9],
                "duration": 7,
                "alternate": True,
                "between": 2,
            }
        ],
    },
    "cameras": [{"scene": "pool", "camera": "port.camera", "rate_hz": 5, "resolution_scale": 0.5}],
}


@dataclass(frozen=True)
class Filmed:
    """What came of it.

    Attributes:
        folder: Log, pictures, track.
        rows: Parameter, guess, found with its 95 % interval, truth; text.
        figure: A picture with its markers, the track, the speed.
        summary: For `--json`.
    """

    folder: Path
    rows: list[list[str]]
    figure: Any
    summary: dict[str, Any]


def film_and_identify(folder: Path, progress: Callable[[str], None] = lambda what: None) -> Filmed:
    """Fly, film, track, identify.

    Raises:
        ConfigError: A library that this needs is not there: `vision` or `slam`.
    """
    opencv()
    progress("camera and markers: flying and rendering")
    flight = fly(parse(Scenario, TEST, "demo"), folder, camera=True)
    true, guess = load_vehicle(VEHICLE), guessed(load_vehicle(VEHICLE))
    progress("camera and markers: looking for markers")
    found, log = track_run(folder / "log.mcap", true, "smoother")
    log.write(folder / "track.mcap")
    progress("camera and markers: identifying")
    result = identify(guess, read_records(folder / "track.mcap", guess), free=FREE)
    rows = [_row(name, result, guess, true) for name in FREE]
    truth = flight.log["truth/eta"]
    errors = found.position[:, :2] - np.stack([np.interp(found.t, truth.t, truth[axis]) for axis in "xy"], axis=1)
    rms = float(np.sqrt(np.mean(errors**2)))
    seen = Seen(_picture(folder), found.t, found.position[:, 0], found.velocity[:, 0], truth.t, truth["x"], rms)
    return Filmed(folder, rows, draw_seen(seen), {"track_rms_m": rms, "parameters": result.values})


def guessed(vehicle: Vehicle) -> Vehicle:
    """The vehicle as described before any test: wrong in surge."""
    data = vehicle.to_dict()
    water = dict(data["hydrodynamics"])
    for name, factor in WRONG.items():
        water[name] = [factor * water[name][0], *water[name][1:]]
    data["hydrodynamics"] = water
    return vehicle_from_dict(data, "guess.yaml")


def _row(name: str, result: Identification, guess: Vehicle, true: Vehicle) -> list[str]:
    family, axis = name.split(".")
    low, high = result.interval(name)
    value = result.values[name]
    of = [vehicle.to_dict()["hydrodynamics"][family][0] for vehicle in (guess, true)]
    unit = next(p.unit for p in result.parameters.free if p.name == name)
    text = f"{value:.3g} ({low:.3g} to {high:.3g})"
    return [f"{family.replace('_', ' ')}, {axis} [{unit}]", f"{of[0]:.3g}", text, f"{of[1]:.3g}"]


def _picture(folder: Path) -> UInt8[np.ndarray, "H W 3"]:
    """One of the recorded pictures with its markers drawn in, RGB."""
    cv2 = opencv()
    pictures = [data for _, data in read_pictures(folder / "port_camera.mcap")]
    image = cv2.imdecode(np.frombuffer(pictures[len(pictures) // 3], np.uint8), cv2.IMREAD_COLOR)
    found = Detector("DICT_4X4_50")(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
    for corners in found.corners:
        cv2.polylines(image, [np.round(16 * corners).astype(np.int32)], True, (60, 20, 230), 2, cv2.LINE_AA, 4)
    return image[..., ::-1]
