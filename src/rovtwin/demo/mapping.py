"""The second demonstration: a survey planned, flown and scanned, and a mosaic of it beside the truth."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from rovtwin.core.user_files.files import write_text
from rovtwin.imaging.files import load_imager_file
from rovtwin.imaging.imager import Imager
from rovtwin.planning.survey import SurveyRequest, lay_out, write_survey
from rovtwin.runs.flight import Flight
from rovtwin.runs.mapping.make import map_run
from rovtwin.runs.mapping.request import MapRequest
from rovtwin.runs.recording.scan import ScanRequest, scan_run
from rovtwin.runs.smooth import smooth_run
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.survey.room import Swath

AREA = "outline: [[0, 0], [5, 0], [5, 3], [0, 3]]  # north, east [m]\n"
SET = (
    "world.floor=5",
    "world.relief={hills: {height: 0.30, length: 6.0, seed: 7}}",
    "sensors={altimeter: true, dvl: true}",
    "name=map_of_the_shoal",
)
SWATH, OVERLAP, ALTITUDE, SPEED = 1.1, 0.35, 1.5, 0.2
EXPOSURE = 0.016  # shorter than the library's: pale sand under the lamps fills no pixel [s]


def run_map_demo(
    folder: Path, fly: Callable[[Scenario, Path], Flight], say: Callable[[str], None] = lambda what: None
) -> dict[str, Any]:
    """Plan, fly, smooth, scan and map five by three metres of the scene `shoal`.

    Args:
        folder: Where all of it goes.
        fly: Flies a scenario into a folder.
        say: Called with what is going on besides the flight.

    Returns:
        Path of the page, and figures of the mosaic.

    Raises:
        RovtwinError: A step failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    area, survey = folder / "area.yaml", folder / "survey.yaml"
    write_text(area, AREA)
    say("laying out the survey")
    swath = Swath(SWATH, OVERLAP)
    request = SurveyRequest(area, swath, 0.0, altitude=ALTITUDE, speed=SPEED, overrides=SET)
    write_survey(lay_out(request), survey)
    flight = fly(load_scenario(survey), folder / "run")
    say("smoothing the track")
    smoothed = smooth_run(folder / "run")
    smoothed.log.write(folder / "run" / "smoothed.mcap", overwrite=True)
    smoothed.track.keys.save(folder / "run" / "smoothed_keys.nc", overwrite=True)
    say("scanning: what the imager would have recorded")
    file = load_imager_file("uhi")
    imager = Imager(file.model_copy(update={"exposure": EXPOSURE}))
    lines = folder / "lines.h5"
    scan_run(folder / "run", ScanRequest(imager, "shoal"), lines, overwrite=True)
    say("making the mosaic")
    asked = MapRequest(lines, area=area, calibrated=True)  # the imager sits where its file says
    mosaic = map_run(folder / "run", replace(asked, formats=("envi", "cog")), folder / "mosaic", overwrite=True)
    return {
        "completed": flight.completed,
        "report": str(mosaic.folder / "report.html"),
        "run_dir": str(folder),
        "figures": mosaic.about["figures"],
        "remarks": mosaic.remarks(),
    }
