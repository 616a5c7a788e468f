"""What is wrong with a record, in words: what every check of logs returns."""

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]
RANK: dict[str, int] = {"error": 0, "warning": 1, "note": 2}


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
        severity: error: the record must not be used so; warning: look at it; note: good to know.
        what: Its kind: no_excitation, unexcited, beyond, clipped, degrees, millimetres, units, sign, swapped, clock,
            z_up, gap, wrap, disagree, release, rare.
        where: Signal, axis or thruster.
        message: What was found and what was expected.
        fix: What to write or do.
    """

    severity: Severity
    what: str
    where: str
    message: str
    fix: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.where}: {self.message} {self.fix}"
