"""What a campaign says: share completed with its interval, quantiles of the scores, what goes with what, cost."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from jaxtyping import Float
from scipy.stats import spearmanr

from rovtwin.campaign.distributions import kind_of
from rovtwin.campaign.rows import SCORES
from rovtwin.campaign.schema import Campaign
from rovtwin.campaign.shares import share_interval

QUANTILES = (0.05, 0.5, 0.95)
FEW = 8  # samples under which no correlation is worth a number


def summarise(campaign: Campaign, table: pa.Table) -> dict[str, Any]:
    """The figures of `rovtwin campaign --json`.

    Args:
        campaign: Complete.
        table: Its rows.
    """
    flown, completed = table.num_rows, int(np.sum(column(table, "completed")))
    return {
        "name": campaign.name,
        "samples": campaign.samples,
        "flown": flown,
        "refused": refused(table),
        "completed": completed,
        "completed_share": completed / flown if flown else None,
        "completed_interval": list(share_interval(completed, flown)) if flown else None,
        "reasons": dict(Counter(_kind(str(row["reason"])) for row in failures(table)).most_common()),
        "scores": {name: quantiles(values) for name in SCORES if np.isfinite(values := column(table, name)).any()},
        "correlations": correlations(campaign, table),
        "wall_s": float(wall_time(table)),
        "cpu_per_mission_s": float(np.mean(column(table, "cpu_s"))) if flown else None,
    }


def _kind(reason: str) -> str:
    """What several missions may share of a reason: where a mission stalled is its own."""
    return reason.split(":")[0] if reason.startswith("not finished") else reason


def column(table: pa.Table, name: str) -> Float[np.ndarray, " n"]:
    """A column; numbers as float with NaN for none, text as objects."""
    kind = table.schema.field(name).type
    values = table[name].to_pylist()
    if pa.types.is_string(kind):
        return np.array(values, dtype=object)
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def quantiles(values: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Median, 5 and 95 % of the finite values, and how many they are."""
    finite = values[np.isfinite(values)]
    low, middle, high = np.quantile(finite, QUANTILES)
    return {"p5": float(low), "median": float(middle), "p95": float(high), "n": int(finite.size)}


def failures(table: pa.Table) -> list[dict[str, Any]]:
    """Rows that did not complete, in order of the samples."""
    return [row for row in table.to_pylist() if not row["completed"]]


def refused(table: pa.Table) -> int:
    """How many never left: their scenario cannot be composed or flown, and they have no score."""
    rows = failures(table)
    return sum(all(row[name] is None or not np.isfinite(row[name]) for name in SCORES) for row in rows)


def numbers_varied(campaign: Campaign) -> list[str]:
    """Paths that draw numbers that mean something; a seed does not."""
    return [path for path, one in campaign.vary.items() if path != "seed" and kind_of(one) in (float, int)]


def correlations(campaign: Campaign, table: pa.Table) -> dict[str, dict[str, float]]:
    """Spearman's rank correlation of each scattered score with each number that varies, over what has both."""
    found = {name: [(path, rank_correlation(table, path, name)) for path in numbers_varied(campaign)]
             for name in campaign.scatter}  # fmt: skip
    return {name: {path: rho for path, rho in row if rho is not None} for name, row in found.items()}


def rank_correlation(table: pa.Table, path: str, score: str) -> float | None:
    """Spearman's rho; None where there are too few samples, or nothing varies."""
    x, y = column(table, path), column(table, score)
    both = np.isfinite(x) & np.isfinite(y)
    if both.sum() < FEW or np.ptp(x[both]) == 0 or np.ptp(y[both]) == 0:
        return None
    found: Any = spearmanr(x[both], y[both])
    return float(found.statistic)


def wall_time(table: pa.Table) -> float:
    """Time during which at least one sample flew, all sessions together [s].

    A row says when its portion began, and its own share of that portion's time.
    """
    began, share = column(table, "began"), column(table, "wall_s")
    spans: dict[float, float] = {}
    for start, length in zip(began, share, strict=True):
        spans[start] = spans.get(start, 0.0) + length
    return _union(sorted((start, start + length) for start, length in spans.items()))


def _union(spans: Sequence[tuple[float, float]]) -> float:
    """Length of what spans in order of their beginnings cover together."""
    total, reached = 0.0, -np.inf
    for start, end in spans:
        total += max(0.0, end - max(start, reached))
        reached = max(reached, end)
    return total
