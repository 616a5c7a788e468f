"""A verdict: scores and plain sentences, as every report has them on top."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Score:
    """A row of the score table."""

    name: str
    value: str
    unit: str
    beside: str
    meaning: str


@dataclass(frozen=True)
class Verdict:
    """What the box on top of the report says: good is None when the log does not say whether the run was completed."""

    good: bool | None
    headline: str
    sentences: list[str]
    scores: list[Score]
