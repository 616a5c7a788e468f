"""CAMPAIGN.yaml: a scenario, what varies in it, how often it is flown; and the same, complete."""

from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from rovtwin.campaign.distributions import Distribution, Integers
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import Strict, parse, read_yaml
from rovtwin.scenario.files import find_scenario, put, scenario_of
from rovtwin.scenario.paths import assign
from rovtwin.scenario.schema import Scenario

ANY_SEED = Integers(distribution="integers", low=0, high=2**31 - 1)
SCATTER = ["cross_track_rms_m", "position_error_rms_m", "duration_s"]


class Campaign(Strict):
    """Many flights of one scenario; each sample draws what varies from the master seed and its own number."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", description="default that of the file")] = (
        "campaign"
    )
    description: str = ""
    scenario: str | dict[str, Any] = Field(description="shipped name, file, or the scenario itself")
    samples: Annotated[int, Field(strict=True, ge=1, le=1_000_000)] = Field(default=100, description="how many flights")
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**31)] = Field(default=1, description="master seed")
    set: dict[str, Any] = Field(default_factory=dict, description="what is the same in all samples, by dotted path")
    vary: dict[str, Distribution] = Field(
        default_factory=dict,
        description="what is drawn, by dotted path; a sample's own `seed` is drawn too, unless set or given here",
    )
    scatter: list[str] = Field(default=SCATTER, description="scores that the report plots against what varies")


def load_campaign(path: str | Path, samples: int | None = None) -> Campaign:
    """A campaign from its file, complete: the scenario and its vehicle stand in it, so that no other file is needed.

    Args:
        path: A YAML file, or a folder of results, whose campaign it is.
        samples: In place of the file's.

    Raises:
        ConfigError: It cannot be used; the message says where and why.
    """
    path = Path(path)
    path = path / "campaign.yaml" if path.is_dir() else path
    data = read_yaml(path)
    data.pop("made_with", None)  # a note of the results' folder, no part of the campaign
    data.setdefault("name", path.stem)
    if samples is not None:
        data["samples"] = samples
    return complete(parse(Campaign, data, path.name), path.name, path.parent)


def complete(campaign: Campaign, where: str = "campaign", folder: Path | None = None) -> Campaign:
    """The campaign with its scenario written out, `set` put into it, and the samples' seed among what varies.

    Args:
        campaign: As in its file.
        where: Name of the file, for messages.
        folder: Where files named in it are looked for first.

    Raises:
        ConfigError: The scenario cannot be used, or a path leads nowhere.
    """
    data, scenario_where, base = _found(campaign.scenario, where, folder)
    # Elements of lists, and parts of the vehicle, are there only when all is written out.
    late = [key for key in campaign.set if "[" in key or key.startswith("vehicle.")]
    for key, value in campaign.set.items():
        if key not in late:
            put(data, key, value, f"{where}: set")
    scenario = scenario_of(data, scenario_where, base)
    if scenario.test is not None:
        raise ConfigError(f"{where}: scenario {scenario.name} is a test, not a mission: it has no scores")
    whole = _written_out(scenario, "vehicle" in campaign.vary)
    for key in late:
        assign(whole, key, campaign.set[key], f"{where}: set")
    seeds = {} if "seed" in campaign.vary or "seed" in campaign.set else {"seed": ANY_SEED}
    made = campaign.model_copy(update={"scenario": whole, "vary": seeds | campaign.vary})
    tried = deepcopy(whole)
    for key, distribution in made.vary.items():
        assign(tried, key, distribution.at(0.5), f"{where}: vary")
    return made


def _found(scenario: str | dict[str, Any], where: str, folder: Path | None) -> tuple[dict[str, Any], str, Path | None]:
    """A scenario's data, the name of where it stands, and the folder that its own files lie in."""
    if isinstance(scenario, dict):
        return dict(scenario), f"{where}: scenario", folder
    beside = folder / scenario if folder else None
    return find_scenario(str(beside) if beside and beside.is_file() else scenario)


def _written_out(scenario: Scenario, vehicle_varies: bool) -> dict[str, Any]:
    """All of a scenario as plain data, its vehicle included, unless that is what varies."""
    from rovtwin.runs.compose.composition import vehicle_of  # loads JAX, which the schema alone does not need
    from rovtwin.runs.compose.fitting import fitted

    if vehicle_varies:
        return _left_open(scenario)
    vehicle = vehicle_of(scenario)
    return fitted(scenario, vehicle.model()).model_dump(mode="json") | {"vehicle": vehicle.to_dict()}


def _left_open(scenario: Scenario) -> dict[str, Any]:
    """All of a scenario but what its mission leaves out, which each vehicle that is drawn fills in (`fitting`)."""
    whole = scenario.model_dump(mode="json")
    if scenario.mission is not None:
        given = scenario.mission.model_dump(mode="json", exclude_unset=True)
        whole["mission"]["waypoints"] = given["waypoints"]
    if "duration" not in scenario.model_fields_set:
        del whole["duration"]
    return whole
