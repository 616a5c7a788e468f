"""The error of a mosaic before the dive, and the overlap that an error asks for."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from rovtwin.core.errors import ConfigError
from rovtwin.gnc.navigation.path_accuracy import Aids, path_accuracy
from rovtwin.planning.survey import Survey, lay_out
from rovtwin.planning.survey_accuracy import CELLS, SigmaMap, key_frames, sigma_map
from rovtwin.planning.survey_request import SurveyRequest
from rovtwin.report.plans.mosaic import MosaicPicture, draw_mosaic
from rovtwin.runs.compose.acoustic import as_white
from rovtwin.runs.compose.autopilot import navigation_filter
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.sensors import sensors_of, together, without_own
from rovtwin.scenario.schema import ModelBasedSection
from rovtwin.survey.library import shapely_library
from rovtwin.survey.timeline import timeline_of

TRIED = ((0.2, False), (0.3, False), (0.4, False), (0.5, False), (0.2, True), (0.3, True), (0.5, True))
"""Overlaps, and whether with crosshatch, that are tried for an error, in order of what they take."""


def predict(survey: Survey, start_std: float | None = None) -> SigmaMap:
    """Sigma over the area, from the plan, the vehicle and its sensors alone.

    Args:
        survey: Laid out with an imager.
        start_std: Of north and east where the way begins [m]; None: as good as one position, as in a real dive. A run
            of the twin begins where the scenario says, known exactly: 0.

    Raises:
        ConfigError: No imager, or no sensor gives positions.
    """
    if survey.imaging is None or survey.request.mapping is None:
        raise ConfigError("mosaic: no imager is known, so that nothing can be predicted of one; say --imager")
    scenario, plan = survey.scenario, survey.plan
    vehicle = vehicle_of(scenario)
    model = vehicle.model()
    sensors = sensors_of(without_own(scenario), vehicle)
    section = scenario.autopilot
    if not isinstance(section, ModelBasedSection):
        section = ModelBasedSection(type="model_based")
    filter = navigation_filter(section, model, sensors)
    walk = float(np.max(np.asarray(filter.tuning.walk)[21:23]))
    white = {name: as_white(one, model, walk) for name, one in sensors.items()}
    aids = [together(white, kind) for kind in ("position", "accelerometer", "dvl")]
    if aids[0] is None or aids[1] is None:
        raise ConfigError(f"{vehicle.name}: without positions and an accelerometer nothing is predicted of a mosaic")
    aids = Aids(_noisy(aids[0], 0.5), _noisy(aids[1], 0.03), None if aids[2] is None else _noisy(aids[2], 0.005))
    line = timeline_of(plan.path, plan.pace, survey.depth / plan.pace.speed)
    key = key_frames(line)
    start = aids.position[0] if start_std is None else start_std
    known = path_accuracy(model, filter.tuning, aids, line.step, line.heading, line.speed, key, start)
    inside, north, east = _cells(plan.room.area)
    return sigma_map(known, line, key, survey.imaging.footprint, survey.request.mapping.assumed, inside, north, east)


def _noisy(aid: tuple[float, float], usual: float) -> tuple[float, float]:
    """A sensor of a scenario without noise counts as good as a usual one, as for the filter."""
    return (aid[0] or usual, aid[1])


def _cells(area: object) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whether cells lie in the area, and their middles north and east [m]."""
    shapely = shapely_library()
    low_n, low_e, high_n, high_e = shapely.bounds(area)
    size = max(high_n - low_n, high_e - low_e) / CELLS
    north, east = (low + size * (np.arange(max(1, round((high - low) / size))) + 0.5)
                   for low, high in ((low_n, high_n), (low_e, high_e)))  # fmt: skip
    return shapely.contains_xy(area, *np.meshgrid(north, east, indexing="ij")), north, east


def lay_out_for_error(
    request: SurveyRequest, progress: Callable[[float], None] = lambda share: None
) -> tuple[Survey, SigmaMap]:
    """The survey that takes least of overlap and crosshatch for the error that is asked for, and its map of sigma.

    Without such an error it is the survey as requested.

    Raises:
        ConfigError: No overlap is enough; the message says what the best one gives. And as `lay_out`.
    """
    mapping = request.mapping
    if mapping is None or mapping.error is None or request.gaps is not None:
        survey = lay_out(request, progress)
        return survey, predict(survey)
    found = []
    for i, (overlap, crossed) in enumerate(TRIED):
        progress(i / len(TRIED))
        survey = lay_out(replace(request, mapping=replace(mapping, overlap=overlap, crosshatch=crossed)))
        # The heading that takes least time is hardly another one with more overlap, and takes the longest to find.
        request = replace(request, heading_deg=float(np.degrees(survey.plan.lines.heading)))
        sigma = predict(survey)
        rms = sigma.rms()["registered"] or np.inf
        if rms <= mapping.error:
            return survey, sigma
        found.append((rms, overlap, crossed))
    rms, overlap, crossed = min(found)
    hatch = " and crosshatch" if crossed else ""
    raise ConfigError(
        f"--error: found {1e3 * mapping.error:.3g} mm, but the best that overlap gives is {1e3 * rms:.3g} mm within "
        f"the mosaic (overlap {overlap:g}{hatch}). A Doppler log, less height, control points or a smaller area help"
    )


def mosaic_picture(survey: Survey, sigma: SigmaMap) -> Figure:
    """Sigma over the area, of the place and within the mosaic, as flown and registered."""
    panels = [("Place on Earth", sigma.absolute), ("Within the mosaic", sigma.within)]
    if sigma.registered is not None:
        panels.append((f"The same, {sigma.ties} ties registered", sigma.registered))
    plan = survey.plan
    return draw_mosaic(MosaicPicture(sigma.north, sigma.east, panels, plan.room.area, plan.path.points, plan.path.sees))
