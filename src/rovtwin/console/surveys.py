"""Surveys laid out over an area of the chart, as rows of a plan. For a worker: it takes seconds."""

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovtwin.core.errors import RovtwinError
from rovtwin.core.user_files.yamlfile import dump_yaml


@dataclass(frozen=True)
class SurveyArea:
    """An area that is surveyed, and how.

    Attributes:
        corners: North and east [m].
        depth: Of the lines [m].
        speed: On the lines [m/s].
        inside: Whether the vehicle never leaves the area.
    """

    corners: tuple[tuple[float, float], ...]
    depth: float
    speed: float
    inside: bool


def rows_over(area: SurveyArea, vehicle: str | dict[str, Any], swath: Any = None, **asked: Any) -> list[dict[str, Any]]:
    """Way-points over an area, by the survey planner.

    Args:
        area: Which one.
        vehicle: Name, file or description.
        swath: What is seen at once, or None.
        asked: What else a `SurveyRequest` has.

    Raises:
        ConfigError: It cannot be laid out.
    """
    from rovtwin.planning.survey import SurveyRequest, lay_out

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "area.yaml"
        file.write_text(dump_yaml({"outline": [list(corner) for corner in area.corners]}), encoding="utf-8")
        if isinstance(vehicle, dict):
            described, vehicle = vehicle, str(Path(folder) / "vehicle.yaml")
            Path(vehicle).write_text(dump_yaml(described), encoding="utf-8")
        how = {"depth": area.depth, "speed": area.speed, "inside": area.inside}
        survey = lay_out(SurveyRequest(file, swath, vehicle=vehicle, **how, **asked))
    if survey.scenario.mission is None:
        raise RovtwinError("no line fits into the area; make it larger")
    places = [waypoint.position or [0.0, 0.0, area.depth] for waypoint in survey.scenario.mission.waypoints]
    return [{"x": x, "y": y, "depth": z, "speed": area.speed} for x, y, z in places]
