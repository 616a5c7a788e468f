"""What is wrong with a record, in words: what every check of logs returns."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
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

    def named(self, thrusters: Sequence[str]) -> "Finding":
        """With names in place of the numbers of thrusters."""

        def name(found: re.Match[str]) -> str:
            return re.sub(r"\d+", lambda number: thrusters[int(number[0]) - 1], found[2])

        def put(text: str) -> str:
            return re.sub(r"\b(thrusters?) (\d+(?:(?:, | and )\d+)?)\b", lambda m: f"{m[1]} {name(m)}", text)

        return replace(self, where=put(self.where), message=put(self.message)) if thrusters else self

    def __str__(self) -> str:
        return f"{self.severity}: {self.where}: {self.message} {self.fix}"
