"""A campaign from beginning to end: what is left is flown, kept as it comes, and judged."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow.csv

from rovtwin.campaign.rows import SCORES
from rovtwin.campaign.samples import scenario_at, tasks
from rovtwin.campaign.schema import Campaign
from rovtwin.campaign.session import CampaignSession
from rovtwin.campaign.store import Store, left_in
from rovtwin.campaign.workers import Workers
from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax
from rovtwin.core.user_files.config import near
from rovtwin.core.user_files.files import whole
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.interrupt import Interrupt

SIDE_BY_SIDE = 256  # missions under vmap where there is a graphics processor


@dataclass(frozen=True)
class Progress:
    """How far a session is: samples done in all, of how many, done by this session, in so many seconds; cores."""

    done: int
    samples: int
    flown: int
    seconds: float
    cores: int

    @property
    def per_minute(self) -> float:
        """Samples a minute, of this session."""
        return 60.0 * self.flown / max(self.seconds, 1e-9)

    @property
    def left_s(self) -> float | None:
        """Time left [s]; None before the first sample."""
        return (self.samples - self.done) * self.seconds / self.flown if self.flown else None


def usual_lanes() -> int:
    """One after the other on a processor, where side by side is no faster (docs/campaigns.md); else many."""
    return 1 if jax.default_backend() == "cpu" else SIDE_BY_SIDE


def check(campaign: Campaign) -> None:
    """Look at all samples before any is flown: each must be a scenario, and the first must compose.

    Raises:
        ConfigError: One is not; names the sample and what it drew.
    """
    for name in campaign.scatter:
        if name not in SCORES:
            raise ConfigError(f"{campaign.name}: scatter: no score {name!r}.{near(name, SCORES)}")
    for index in range(campaign.samples):
        scenario_at(campaign, index)
    compose(scenario_at(campaign, 0))


def run_campaign(
    campaign: Campaign,
    folder: Path,
    workers: AbstractContextManager[Workers],
    lanes: int | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
) -> CampaignSession:
    """Fly what is not flown yet.

    Args:
        campaign: Complete, from `load_campaign`.
        folder: Of the results; an earlier session of the same campaign is gone on with.
        workers: Who flies; entered only if there is something to fly.
        lanes: How many missions fly side by side in each worker; None: as suits this machine.
        progress: Called at the start and after each portion.

    Returns:
        The session. Ctrl-C ends it, and what is flown is kept.

    Raises:
        ConfigError: A sample is no scenario, or the folder is another campaign's.
    """
    lanes = lanes or usual_lanes()
    check(campaign)
    began = time.monotonic()
    with ExitStack() as stack:
        # What can go wrong goes wrong before the folder is made.
        crew = stack.enter_context(workers) if left_in(folder, campaign) else None
        store = stack.enter_context(Store(folder, campaign))
        interrupt = stack.enter_context(Interrupt())
        left = [index for index in range(campaign.samples) if index not in store.done]
        flown = 0
        if crew is not None and left:
            now = Progress(campaign.samples - len(left), campaign.samples, 0, 0.0, crew.cores)
            progress(now)
            text, portions = campaign.model_dump_json(), tasks(campaign, left, lanes)
            for rows in crew.fly(text, portions, lanes, lambda: interrupt.asked):
                store.add(rows)
                flown += len(rows)
                seconds = time.monotonic() - began
                progress(replace(now, done=now.done + flown, flown=flown, seconds=seconds, cores=crew.cores))
        table = store.gather()
    # An earlier session may have flown more samples than this one asks for.
    table = table.slice(0, int(np.searchsorted(table["index"].to_numpy(), campaign.samples)))
    return CampaignSession(
        folder, campaign, table, flown, time.monotonic() - began, "" if crew is None else crew.description
    )


def write_csv(session: CampaignSession) -> Path:
    """The table as `samples.csv` beside the Parquet file."""
    path = session.folder / "samples.csv"
    with whole(path) as beside:
        pyarrow.csv.write_csv(session.table, beside)
    return path
