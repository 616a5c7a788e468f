"""What the figures of a run's summary are called, for a terminal and a notebook."""

from collections.abc import Iterator, Mapping
from typing import Any

# Label, key of the summary, unit; a share is shown in per cent.
FIGURES = (
    ("duration", "duration_s", "s"),
    ("cross-track rms", "cross_track_rms_m", "m"),
    ("cross-track max", "cross_track_max_m", "m"),
    ("station rms", "station_rms_m", "m"),
    ("depth rms", "depth_rms_m", "m"),
    ("altitude rms", "altitude_rms_m", "m"),
    ("largest roll", "roll_max_deg", "deg"),
    ("largest pitch", "pitch_max_deg", "deg"),
    ("position error rms, north / east", "position_error_rms_m", "m"),
    ("bound (best filter), surge / sway", "bound_position_m", "m"),
    ("NEES of position, mean (consistent: 2)", "nees_position_mean", ""),
    ("  its 95 % interval if consistent", "nees_position_interval", ""),
    ("effort", "effort_n2s", "N2 s"),
    ("energy from the batteries", "energy_wh", "Wh"),
    ("time saturated", "saturated_share", "%"),
    ("thruster activity, rms", "thruster_activity_n_per_s", "N/s"),
    ("ticks began late, 99 %", "late_ms_p99", "ms"),
    ("  the latest", "late_ms_max", "ms"),
)


def rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, Any, str]]:
    """Label, value and unit of each figure that the summary has; a share in per cent."""
    for label, key, unit in FIGURES:
        judged = key != "nees_position_interval" or summary.get("nees_position_mean") is not None
        if (value := summary.get(key)) is not None and judged:
            yield label, 100 * value if unit == "%" else value, unit
