"""The flight of a plan that was rehearsed, beside its forecast: in its folder, and for the pages."""

import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import LogError
from rovtwin.core.log import Log, repair
from rovtwin.core.user_files.files import cannot, read_text, write_text
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.ensemble.comparison import compared, sortie_of
from rovtwin.scenario.schema import Scenario

FILE = "rehearsal.json"  # in the folder of a flight
LOG = "log.mcap"
FORMAT = 1
MOST = 20_000_000  # of the file [bytes]
SHOWN = {"track", "profile", "points", "remarks", "time_s", "energy_wh", "nearest_m"}  # what a page cannot do without


def write_rehearsals(folder: Path, rehearsals: Sequence[dict[str, Any]]) -> None:
    """Write the forecasts of the missions of a flight, with what was flown of them, into its folder.

    Raises:
        LogError: It cannot be written.
    """
    try:
        write_text(folder / FILE, to_json({"format": FORMAT, "rehearsals": list(rehearsals)}) + "\n")
    except OSError as error:
        raise LogError(f"{folder / FILE}: cannot be written ({cannot(error)})") from None


def rehearsals_of(folder: Path) -> list[dict[str, Any]]:
    """What a flight's folder has of forecasts; none where its mission was not rehearsed.

    Raises:
        LogError: There is a file, and it is none of ours.
    """
    if not (folder / FILE).is_file():
        return []
    try:
        data = json.loads(read_text(folder / FILE, MOST))
        if data["format"] != FORMAT:
            raise LogError(
                f"{folder / FILE}: found format {data['format']!r:.40}, expected {FORMAT}: a newer rovtwin's"
            )
        every = data["rehearsals"]
        if not all(one.keys() >= SHOWN for one in every):
            raise KeyError
    except (OSError, KeyError, TypeError, AttributeError, ValueError, RecursionError):
        raise LogError(f"{folder / FILE}: found something else than what a rehearsal leaves; delete it") from None
    return every


def flown_beside(folder: Path, forecast: dict[str, Any], scenario: Scenario, over: bool) -> dict[str, Any]:
    """How the flight in a folder compares with the forecast of its mission; for a worker.

    Args:
        folder: Of the flight.
        forecast: Of the mission, see `runs.ensemble.forecast`.
        scenario: What the console flies, for its vehicle.
        over: Whether the log is closed; else a copy of what there is of it is read.

    Raises:
        LogError: The log cannot be read, or has no such mission.
    """
    log = Log.read(folder / LOG) if over else _so_far(folder)
    sortie = sortie_of(log, forecast["places"][1:])
    return compared(forecast, sortie, vehicle_of(scenario), float(np.radians(forecast["heading_deg"])))


def _so_far(folder: Path) -> Log:
    with tempfile.TemporaryDirectory(prefix="rovtwin-") as place:
        return Log.read(repair(folder / LOG, Path(place) / LOG).path)
