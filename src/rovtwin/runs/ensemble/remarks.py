"""What a rehearsed mission gives reason to say: each remark with its grade and the way-points that it is of."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rovtwin.runs.ensemble.rehearsal import Figures
from rovtwin.runs.feasibility.point_numbers import counted, named

LITTLE_THRUST = 0.1  # share of a thruster's force that should be left
LITTLE_CHARGE = 0.2  # of the batteries


@dataclass(frozen=True)
class Remark:
    """`level` is ok, warning or error; `points` are numbers of way-points from 0."""

    level: str
    what: str
    points: list[int]


def remarks(nominal: Figures, drawn: Sequence[Figures]) -> list[Remark]:
    """All of them, the gravest first; one that nothing is wrong where there is none."""
    every = [*_ending(nominal, drawn), *_touching(nominal, drawn), *_thrust(nominal, drawn), *_charge(nominal, drawn)]
    every += [Remark("warning", line, named(line)) for line in nominal.unmet]
    if not every:
        who = f"the vehicle as it is known and all {len(drawn)} drawn vehicles complete it, and touch nothing"
        return [Remark("ok", who if drawn else "the vehicle as it is known completes it, and touches nothing", [])]
    return sorted(every, key=lambda one: one.level != "error")


def _ending(nominal: Figures, drawn: Sequence[Figures]) -> Iterator[Remark]:
    if nominal.ended:
        yield Remark("error", f"not completed: {nominal.ended}", [nominal.aimed])
    failed = [one for one in drawn if one.ended]
    if failed and not (nominal.ended and len(failed) == len(drawn)):
        points = sorted({one.aimed for one in failed})
        what = f"{len(failed)} of {len(drawn)} drawn vehicles do not complete it, at {counted(points)}"
        yield Remark("warning", f"{what}; the first of them: {failed[0].ended}", points)


def _touching(nominal: Figures, drawn: Sequence[Figures]) -> Iterator[Remark]:
    for line in nominal.touched:
        yield Remark("error", f"the hull {line}", [])
    names = Counter(name for one in drawn for name, least in one.nearest.items() if least < 0.0)
    for name, many in names.items():
        if nominal.nearest[name] >= 0.0:
            yield Remark("warning", f"{many} of {len(drawn)} drawn vehicles touch {name}", [])


def _thrust(nominal: Figures, drawn: Sequence[Figures]) -> Iterator[Remark]:
    least = np.fmin.reduce([nominal.margin, *(one.margin for one in drawn)])
    if points := [i for i, share in enumerate(least) if share < LITTLE_THRUST]:
        lowest = max(float(least[points].min()), 0.0)
        known = nominal.margin[points]
        whose = "" if np.nanmin(known, initial=1.0) < LITTLE_THRUST else " with a drawn vehicle"
        yield Remark(
            "warning",
            f"{counted(points)}: a thruster has {100.0 * lowest:.0f} % of its force left{whose}, expected "
            f"{100.0 * LITTLE_THRUST:.0f} %: fly slower there, or wait for less current",
            points,
        )


def _charge(nominal: Figures, drawn: Sequence[Figures]) -> Iterator[Remark]:
    if nominal.remains is None or nominal.left is None:
        return
    ends = [one.remains for one in (nominal, *drawn) if one.remains is not None]
    if nominal.remains <= 0.0:
        empty = np.flatnonzero(nominal.left <= 0.0)
        at = f" before {counted([int(empty[0])])}" if empty.size else ""
        yield Remark("error", f"the battery is empty{at}", [int(empty[0])] if empty.size else [])
    elif min(ends) < LITTLE_CHARGE:
        least = max(min(ends), 0.0)
        yield Remark(
            "warning", f"{100.0 * least:.0f} % of the battery may be left, expected {100.0 * LITTLE_CHARGE:.0f} %", []
        )
