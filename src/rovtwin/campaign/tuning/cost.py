"""What a flight costs: what a user cares for, against what the hand-tuned autopilot does in the same sea."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import FAIL_SAFE_PHASES
from rovtwin.core.user_files.config import near
from rovtwin.gnc.safety.rules import RULES
from rovtwin.scenario.schema import ModelBasedSection

FAILED = 10.0
"""Cost of a flight that is aborted, does not arrive, or leaves no number."""


@dataclass(frozen=True)
class Term:
    """A part of the cost: its unit, its usual weight, and below what an error is nobody's concern (see `floors_of`)."""

    description: str
    unit: str
    weight: float
    floor: float
    fixed: bool = False  # whether the floor counts as 1 whatever the hand-tuned autopilot does


TERMS = {
    "path": Term("distance to the path (to the station while holding), rms", "m", 0.5, 0.05),
    "depth": Term("depth error, rms", "m", 0.15, 0.01),
    "heading": Term("heading error, rms", "deg", 0.1, 1.0),
    "attitude": Term("roll and pitch about their means, rms", "deg", 0.1, 3.0, fixed=True),
    "effort": Term("sum of squared thruster forces, mean over time", "N2", 0.05, 1.0),
    "activity": Term("rate of the thruster forces, rms", "N/s", 0.2, 0.5),
}


SWINGING = 0.05  # of the attitude limit, 3 of the usual 60 degrees: what counts as 1 of the term `attitude`


def floors_of(section: ModelBasedSection) -> dict[str, float]:
    """Floors by term, that of the attitude a share of the limit at which the supervisor ends a flight."""
    limit = section.supervisor.attitude_limit_deg.limit or np.degrees(RULES["attitude limit"].limit)
    return {name: term.floor for name, term in TERMS.items()} | {"attitude": SWINGING * float(limit)}


def weights_of(given: Sequence[str]) -> dict[str, float]:
    """Weights by term: the usual ones with `name=value` texts put in, as shares of their sum.

    Raises:
        ConfigError: A text is no weight of a term, or no weight is left above 0.
    """
    weights = {name: term.weight for name, term in TERMS.items()}
    for text in given:
        name, _, value = text.partition("=")
        if name not in TERMS:
            raise ConfigError(
                f"--weight {text}: found {name!r}, expected one of {', '.join(TERMS)}, such as path=0.5."
                + near(name, list(TERMS))
            )
        try:
            weights[name] = float(value)
        except ValueError:
            raise ConfigError(f"--weight {text}: found {value!r}, expected a number, such as {name}=0.2") from None
        if not (np.isfinite(weights[name]) and weights[name] >= 0):
            raise ConfigError(f"--weight {text}: found {value}, expected a number of at least 0")
    total = sum(weights.values())
    if not total > 0:
        raise ConfigError("--weight: found no weight above 0, expected one at least")
    return {name: value / total for name, value in weights.items()}


def terms_of(figures: Mapping[str, Any]) -> dict[str, float] | None:
    """The terms of a flight's scores, those that it has; None where it failed.

    Args:
        figures: Of `runs.scoring.scores.score`.
    """
    if figures["phase"] in FAIL_SAFE_PHASES or (not figures["completed"] and not figures.get("cut")):
        return None
    off = [figures[name] for name in ("cross_track_rms_m", "station_rms_m") if figures[name] is not None]
    terms = {
        "path": float(np.sqrt(np.mean(np.square(off)))) if off else None,
        "depth": figures["depth_rms_m"],
        "heading": figures["heading_rms_deg"],
        "attitude": figures["attitude_rms_deg"],
        "effort": figures["effort_n2s"] / max(figures["duration_s"], 1.0),
        "activity": figures["thruster_activity_n_per_s"],
    }
    found = {name: float(value) for name, value in terms.items() if value is not None}
    return found if all(np.isfinite(value) for value in found.values()) else None


@dataclass(frozen=True)
class Cost:
    """Cost of flights, in units of the hand-tuned autopilot's.

    Attributes:
        weights: By term, their sum 1.
        scales: What counts as 1 of each term, by sea: the hand-tuned mean, or the term's floor if that is more.
    """

    weights: Mapping[str, float]
    scales: Mapping[str, Mapping[str, float]]

    @classmethod
    def against(
        cls,
        weights: Mapping[str, float],
        seas: Sequence[str],
        flights: Sequence[Mapping[str, Any]],
        floors: Mapping[str, float],
    ) -> "Cost":
        """From the hand-tuned autopilot's flights, each with the name of its sea, and floors as `floors_of` gives."""
        scales = {}
        for sea in dict.fromkeys(seas):
            found = [terms_of(one) for one, where in zip(flights, seas, strict=True) if where == sea]
            scales[sea] = {name: _scale(name, [one for one in found if one], floors[name]) for name in TERMS}
        return cls(weights, scales)

    def of(self, sea: str, figures: Mapping[str, Any]) -> float:
        """Cost of one flight; FAILED if it failed, and never more."""
        found = terms_of(figures)
        if found is None:
            return FAILED
        shares = {name: self.weights[name] for name in found}
        total = sum(shares.values())
        if not total > 0:
            return 0.0
        return min(sum(w * found[name] / self.scales[sea][name] for name, w in shares.items()) / total, FAILED)

    def all_of(self, seas: Sequence[str], flights: Sequence[Mapping[str, Any]]) -> Float[np.ndarray, " n"]:
        """Costs of flights, shape (n,)."""
        return np.array([self.of(sea, one) for sea, one in zip(seas, flights, strict=True)])


def _scale(name: str, found: Sequence[Mapping[str, float]], floor: float) -> float:
    values = [one[name] for one in found if name in one and not TERMS[name].fixed]
    return max(float(np.mean(values)) if values else 0.0, floor)
