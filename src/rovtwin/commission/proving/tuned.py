"""The autopilot that is proven and then flown: tuned on drawn vehicles if somebody likes, else scaled by the model."""

from importlib.util import find_spec
from typing import Any

from rovtwin.campaign.tuning.cost import weights_of
from rovtwin.campaign.tuning.parameters import chosen
from rovtwin.campaign.tuning.result import TuningRequest
from rovtwin.campaign.tuning.tune import tune
from rovtwin.campaign.tuning.writing import sentences, write_tuned
from rovtwin.commission.stage import Check
from rovtwin.commission.work import Work
from rovtwin.core.errors import RovtwinError
from rovtwin.core.user_files.config import read_yaml
from rovtwin.scenario.schema import Scenario

BUDGET = 240.0  # wall time of a tuning [s]
SCALED = "scaled from the identified model"


def autopilot_of(work: Work) -> dict[str, Any]:
    """The section `autopilot` of a scenario that was proven in this commissioning; empty: the model's own scaling."""
    path = work.file("prove", "autopilot_file")
    return {} if path is None else {"autopilot": read_yaml(path)}


def tuned(work: Work, scenario: Scenario) -> tuple[Scenario, Check, dict[str, Any]]:
    """Offers to tune, and does so if the answer is yes.

    Args:
        work: Where the tuned autopilot is written.
        scenario: Whose autopilot is tuned, on its own mission.

    Returns:
        The scenario with the autopilot to prove, what the page says of it, and figures.
    """
    if find_spec("cmaes") is None:
        fix = "Install the extra: pip install 'rovtwin[campaign]'"
        return scenario, Check("note", "autopilot", f"{SCALED}; not tuned: the package cmaes is missing.", fix), {}
    question = (
        f"Tune the autopilot on drawn vehicles? At most {BUDGET / 60.0:.0f} min of computing, nothing moves; "
        "without it it is scaled from the model."
    )
    if not work.person.confirm(question):
        return scenario, Check("note", "autopilot", f"{SCALED}; not tuned: it was not asked for."), {}
    request = TuningRequest(scenario, chosen(()), ("calm",), weights_of(()), seed=work.request.seed, budget=BUDGET)
    try:
        found = tune(request, lambda what, share: work.person.progress(f"tuning: {what}", share))
    except RovtwinError as error:
        return scenario, Check("note", "autopilot", f"{SCALED}; not tuned: {error}"), {}
    head, _ = sentences(found)
    seconds = {"tuning_wall_s": found.seconds["all"], "tuning_evaluations": len(found.search.costs)}
    if not found.held_out.better:
        return scenario, Check("note", "autopilot", f"{SCALED}. {head}"), seconds
    files = write_tuned(found, work.folder, report=False)
    made = scenario.model_copy(update={"autopilot": found.section})
    return made, Check("ok", "autopilot", head), seconds | {"autopilot_file": files["autopilot"].name}
