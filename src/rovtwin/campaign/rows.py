"""A row of results: sample, draws, scores, verdict and cost, of the same columns and types in every file."""

from typing import Any

import pyarrow as pa

from rovtwin.campaign.distributions import kind_of
from rovtwin.campaign.schema import Campaign

PAIRS = {  # of a flight's summary; the two columns that they become
    "position_error_rms_m": ("position_error_north_rms_m", "position_error_east_rms_m"),
    "bound_position_m": ("bound_surge_m", "bound_sway_m"),
    "nees_position_interval": ("nees_interval_low", "nees_interval_high"),
}
SCORES = (
    "duration_s",
    *("cross_track_rms_m", "cross_track_max_m", "station_rms_m", "station_max_m", "depth_rms_m", "altitude_rms_m"),
    *("position_error_rms_m", *PAIRS["position_error_rms_m"], *PAIRS["bound_position_m"]),
    *("nees_position_mean", "nees_effective_samples", *PAIRS["nees_position_interval"]),
    *("effort_n2s", "energy_wh", "saturated_share", "thruster_activity_n_per_s", "speed_rms_m_s"),
)
"""Columns of scores; `position_error_rms_m` is the root mean square over both axes."""

_KINDS = {float: pa.float64(), int: pa.int64(), bool: pa.bool_(), str: pa.string()}


def table_schema(campaign: Campaign) -> pa.Schema:
    """Columns of the table: index, what was drawn (the seed among it), verdict, scores, cost."""
    return pa.schema(
        [
            ("index", pa.int64()),
            *((path, _KINDS[kind_of(distribution)]) for path, distribution in campaign.vary.items()),
            ("completed", pa.bool_()),
            ("phase", pa.string()),
            ("reason", pa.string()),
            *((name, pa.float64()) for name in SCORES),
            ("lanes", pa.int64()),
            ("began", pa.float64()),  # seconds since 1970, of its portion
            ("wall_s", pa.float64()),  # its share of the portion's time, composing and compiling included
            ("cpu_s", pa.float64()),  # the same of processor time
        ]
    )


def row_of(index: int, drawn: dict[str, Any], summary: dict[str, Any]) -> dict[str, Any]:
    """The row of a flight without its cost.

    Args:
        index: Of the sample.
        drawn: By path.
        summary: As `runs.scoring.summary.summarise` gives it.
    """
    flat = {
        name: value for name, value in summary.items() if name in SCORES or name in ("completed", "phase", "reason")
    }
    for name, columns in PAIRS.items():
        flat |= dict(zip(columns, summary[name] or (None, None), strict=True))
    axes = summary["position_error_rms_m"]
    flat["position_error_rms_m"] = (sum(value**2 for value in axes) / len(axes)) ** 0.5
    return {"index": index} | drawn | flat


def row_of_failure(index: int, drawn: dict[str, Any], reason: str) -> dict[str, Any]:
    """The row of a sample that could not be flown; it has no scores."""
    return {"index": index} | drawn | {"completed": False, "phase": "", "reason": reason}
