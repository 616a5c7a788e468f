"""The pictures of docs/survey.md: a planned survey, the error of its mosaic, and one survey as the twin flew it.

python docs/scripts/survey.py [--out docs/figures] [--fly]
"""

import argparse
from pathlib import Path

import numpy as np
import shapely

from rovtwin.planning.survey import SurveyRequest, lay_out, survey_picture
from rovtwin.planning.survey_prediction import mosaic_picture, predict
from rovtwin.planning.survey_request import MapRequest
from rovtwin.runs.fly import fly
from rovtwin.survey.room import Swath

EXAMPLES = Path(__file__).parents[2] / "examples" / "survey"


def main():
    """Draw the plan; with --fly compare a survey of the pool with its flight."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "figures")
    parser.add_argument("--fly", action="store_true")
    asked = parser.parse_args()
    survey_picture(lay_out(SurveyRequest(EXAMPLES / "area.geojson", Swath(1.2)))).savefig(
        asked.out / "survey_plan.png", dpi=100
    )
    for_map = MapRequest("uhi", 0.3)
    survey = lay_out(SurveyRequest(EXAMPLES / "pool.yaml", None, altitude=1.5, floor=5.0, inside=True,
                                   overrides=("sensors.dvl=true",), mapping=for_map))  # fmt: skip
    mosaic_picture(survey, predict(survey)).savefig(asked.out / "survey_sigma.png", dpi=100)
    if asked.fly:
        compare(lay_out(SurveyRequest(EXAMPLES / "pool.yaml", Swath(1.6), inside=True)))


def compare(survey):
    """Time, energy and coverage of a plan and of its flight."""
    flight, figures = fly(survey.scenario), survey.figures()
    track = flight.log["truth/eta"].values
    under = np.abs(track[:, 2] - survey.depth) < 0.2
    swept = shapely.LineString(track[under, :2]).buffer(0.5 * survey.request.swath.width)
    area = survey.plan.room.area
    print(f"time {figures['duration_s']:.0f} s planned, {flight.figures['duration_s']:.0f} s flown")
    print(f"energy {figures['energy_wh']:.1f} Wh planned, {flight.figures['energy_wh']} Wh flown")
    print(f"coverage {figures['coverage']:.4f} planned, {swept.intersection(area).area / area.area:.4f} flown")


if __name__ == "__main__":
    main()
