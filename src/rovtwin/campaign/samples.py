"""Samples: what varies, drawn from the master seed, the sample's number and the path's name, and from nothing else.

So the draws do not depend on who flies a sample, or when; the first N samples of a larger campaign are those of a
smaller one, and another path to vary leaves the draws of the others as they are.
"""

from copy import deepcopy
from typing import Any
from zlib import crc32

import numpy as np

from rovtwin.campaign.distributions import Choice, Scalar
from rovtwin.campaign.schema import Campaign
from rovtwin.core.errors import ConfigError
from rovtwin.scenario.files import scenario_of
from rovtwin.scenario.paths import assign
from rovtwin.scenario.schema import Scenario


def draws(campaign: Campaign, index: int) -> dict[str, Scalar]:
    """What sample `index` (from 0) draws, by path, in the order of the campaign's file."""
    return {path: distribution.at(_share(campaign.seed, index, path)) for path, distribution in campaign.vary.items()}


def _share(seed: int, index: int, path: str) -> float:
    """A uniform number in (0, 1)."""
    share = np.random.default_rng([seed, index, crc32(path.encode())]).random()
    return max(float(share), float(np.finfo(float).tiny))  # 0 itself would be minus infinity of a normal


def scenario_at(campaign: Campaign, index: int) -> Scenario:
    """The scenario of a sample of a complete campaign.

    Raises:
        ConfigError: What was drawn makes no scenario, such as a negative noise; names the sample.
    """
    where = f"{campaign.name}: sample {index}"
    drawn = draws(campaign, index)
    data: dict[str, Any] = deepcopy(campaign.scenario)  # type: ignore[assignment]  (complete: it is no name)
    for path, value in drawn.items():
        assign(data, path, value, where)
    try:
        return scenario_of(data, where)
    except ConfigError as error:
        values = ", ".join(f"{path} = {value:.6g}" if isinstance(value, float) else f"{path} = {value}"
                         for path, value in drawn.items())  # fmt: skip
        raise ConfigError(f"{error}\n{where} drew {values}; choose distributions that stay within limits") from None


def tasks(campaign: Campaign, numbers: list[int], lanes: int) -> list[list[int]]:
    """Samples in portions of at most `lanes` that will likely fly by one compiled program, in order of number.

    What is chosen from a list (an autopilot, a switch) may change the program; what is a mere number hardly ever does.
    """
    chosen = [path for path, distribution in campaign.vary.items() if isinstance(distribution, Choice)]
    groups: dict[Any, list[int]] = {}
    for index in numbers:
        drawn = draws(campaign, index) if chosen and lanes > 1 else {}
        groups.setdefault(tuple(drawn[path] for path in chosen) if drawn else (), []).append(index)
    portions = [group[i : i + lanes] for group in groups.values() for i in range(0, len(group), lanes)]
    return sorted(portions)
