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
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.scenario.schema import Scenario

FILE = "autopilot.yaml"
BUDGET = 240.0  # wall time of a tuning [s]
SCALED = "scaled from the identified model"


def autopilot_of(work: Work) -> dict[str, Any]:
    """The section `autopilot` of a scenario as it was proven in this commissioning; empty: it was not."""
    path = work.file("prove", "autopilot_file")
    return {} if path is None else {"autopilot": read_yaml(path)}


def tuned(work: Work, scenario: Scenario) -> tuple[Scenario, Check, dict[str, Any]]:
    """Offers to tune, and does so if the answer is yes; the autopilot that is then proven is written into the folder.

    Args:
        work: Where it is written.
        scenario: Whose autopilot is tuned, on its own mission.

    Returns:
        The scenario with the autopilot to prove, what the page says of it, and figures.
    """
    made, line, figures = _offered(work, scenario)
    if not figures["tuned"]:
        write_text(work.folder / FILE, dump_yaml(made.autopilot.model_dump(mode="json", exclude_none=True)))
    return made, line, figures | {"autopilot_file": FILE}


def _offered(work: Work, scenario: Scenario) -> tuple[Scenario, Check, dict[str, Any]]:
    untuned: dict[str, Any] = {"tuned": False}
    if find_spec("cmaes") is None:
        fix = "Install the extra: pip install 'rovtwin[campaign]'"
        return scenario, Check("note", "autopilot", f"{SCALED}; not tuned: the package cmaes is missing.", fix), untuned
    question = (
        f"Tune the autopilot on drawn vehicles? At most {BUDGET / 60.0:.0f} min of computing, nothing moves; "
        "without it it is scaled from the model."
    )
    if not work.person.confirm(question):
        return scenario, Check("note", "autopilot", f"{SCALED}; not tuned: it was not asked for."), untuned
    request = TuningRequest(scenario, chosen(()), ("calm",), weights_of(()), seed=work.request.seed, budget=BUDGET)
    try:
        found = tune(request, lambda what, share: work.person.progress(f"tuning: {what}", share))
    except RovtwinError as error:
        return scenario, Check("note", "autopilot", f"{SCALED}; not tuned: {error}"), untuned
    head, _ = sentences(found)
    cost = {"tuning_wall_s": found.seconds["all"], "tuning_evaluations": len(found.search.costs)}
    if not found.held_out.better:
        return scenario, Check("note", "autopilot", f"{SCALED}. {head}"), untuned | cost
    write_tuned(found, work.folder, report=False)
    made = scenario.model_copy(update={"autopilot": found.section})
    return made, Check("ok", "autopilot", head), {"tuned": True} | cost
