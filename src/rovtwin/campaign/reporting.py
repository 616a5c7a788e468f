"""The report of a campaign from its rows."""

import platform
import sys
from pathlib import Path
from typing import Any

from rovtwin._version import __version__
from rovtwin.campaign.distributions import Choice
from rovtwin.campaign.rows import SCORES
from rovtwin.campaign.session import CampaignSession
from rovtwin.campaign.shares import share_interval
from rovtwin.campaign.summary import column, failures, numbers_varied, rank_correlation, wall_time
from rovtwin.core.numerics import jax
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.report.studies.campaign import CampaignResult, write_campaign_report


def write_report(session: CampaignSession) -> Path:
    """Write `report.html` and its figures into the folder of the results."""
    return write_campaign_report(result_of(session), session.folder)


def result_of(session: CampaignSession) -> CampaignResult:
    """What the report shows of a session's campaign."""
    campaign, table = session.campaign, session.table
    completed = column(table, "completed") > 0.5
    n = table.num_rows
    return CampaignResult(
        title=f"Campaign {campaign.name}",
        description=campaign.description,
        samples=campaign.samples,
        completed=completed,
        interval=share_interval(int(completed.sum()), n) if n else (0.0, 1.0),
        scores={name: column(table, name) for name in SCORES},
        varied={path: column(table, path) for path in numbers_varied(campaign)},
        scatter=campaign.scatter,
        rank=lambda path, name: rank_correlation(table, path, name),
        failures=failures(table),
        replay=lambda index: f"rovtwin fly --replay {session.folder}/{index}",
        drawn={path: _in_words(one) for path, one in campaign.vary.items()},
        cost=_cost(session),
        provenance=[
            ("Command", " ".join([Path(sys.argv[0]).name, *sys.argv[1:]])),
            ("rovtwin", __version__),
            ("Python, jax", f"{platform.python_version()}, {jax.__version__}"),
            ("Machine of the last session", platform.platform()),
            ("Master seed", str(campaign.seed)),
        ],
        campaign=dump_yaml(campaign.model_dump(mode="json")),
    )


def _in_words(distribution: Any) -> str:
    if isinstance(distribution, Choice):
        weights = distribution.weights or [1.0] * len(distribution.values)
        return ", ".join(
            f"{v} ({100 * w / sum(weights):.0f} %)" for v, w in zip(distribution.values, weights, strict=True)
        )
    given = distribution.model_dump(exclude={"distribution"}, exclude_none=True)
    return f"{distribution.distribution}: " + ", ".join(f"{name} {value:g}" for name, value in given.items())


def _cost(session: CampaignSession) -> list[tuple[str, str]]:
    n, table = session.table.num_rows, session.table
    if not n:
        return []
    wall, cpu = wall_time(table), column(table, "cpu_s")
    lines = [
        ("Wall time while missions flew, all sessions", f"{wall:.1f} s"),
        ("Wall time a mission", f"{wall / n:.2f} s"),
        ("Processor time a mission", f"{cpu.mean():.2f} s (the first of a process with compiling: {cpu.max():.1f} s)"),
        (
            "Missions side by side in a process",
            ", ".join(f"{lanes:.0f}" for lanes in sorted({*column(table, "lanes")})),
        ),
    ]
    if session.flown:
        lines.append(("This session", f"{session.flown} missions in {session.wall_s:.1f} s by {session.by}"))
    return lines
