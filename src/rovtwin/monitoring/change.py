"""Which of the quantities have changed, and what that may mean.

    z = (now - before) / sqrt(std_now^2 + std_before^2 + scatter^2)

A change is reported where |z| is beyond what chance does once in a hundred flights of an unchanged vehicle, counting
that many quantities are looked at (Bonferroni), and where it is large enough for somebody to care.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import norm
from scipy.stats import t as student

from rovtwin.monitoring.quantities import Reading

FALSE_ALARMS = 0.01  # of flights of an unchanged vehicle
CARED_FOR = {"1": 0.03, "N": 0.2, "m": 5e-4}  # least change that is reported, by unit


@dataclass(frozen=True)
class Change:
    """A quantity that is not what it was.

    Attributes:
        reading: What it is now.
        before: What it was; 0 is the description.
        std: Of the difference.
    """

    reading: Reading
    before: float
    std: float

    @property
    def difference(self) -> Reading:
        """The change itself, with its standard deviation."""
        return self.reading.with_values(self.reading.value - self.before, self.std)

    @property
    def z(self) -> float:
        """In standard deviations."""
        return (self.reading.value - self.before) / self.std


def changes(
    readings: Sequence[Reading],
    before: Float[np.ndarray, " q"],
    std_before: Float[np.ndarray, " q"],
    freedom: Float[np.ndarray, " q"] | float = np.inf,
) -> list[Change]:
    """What has changed, the surest first.

    Args:
        readings: Now.
        before: Of each.
        std_before: Its standard deviation, scatter between flights included; NaN: nothing to compare with.
        freedom: Degrees of freedom with which that deviation is known, of each or of all.
    """
    learnt = [i for i, reading in enumerate(readings) if reading.learnt and np.isfinite(std_before[i])]
    if not learnt:
        return []
    free = np.broadcast_to(freedom, len(readings))
    found = [Change(readings[i], float(before[i]), float(np.hypot(readings[i].std, std_before[i]))) for i in learnt]
    limits = [_limit(readings[i].std, std_before[i], float(free[i]), len(learnt)) for i in learnt]
    cared = [CARED_FOR[c.reading.quantity.unit] for c in found]
    beyond = [
        c
        for c, limit, least in zip(found, limits, cared, strict=True)
        if abs(c.z) > limit and abs(c.difference.value) > least
    ]
    return sorted((c for c in beyond if not _explained(c, beyond)), key=lambda change: -abs(change.z))


def _limit(std: float, std_before: float, freedom: float, many: int) -> float:
    """|z| that chance exceeds too seldom: Student's, with Satterthwaite's degrees of freedom for the sum of both."""
    if not np.isfinite(freedom):
        return float(norm.isf(0.5 * FALSE_ALARMS / many))
    of_both = freedom * (std**2 + std_before**2) ** 2 / std_before**4
    return float(student.isf(0.5 * FALSE_ALARMS / many, of_both))


def _explained(change: Change, found: Sequence[Change]) -> bool:
    """Whether a thruster only seems stronger, or weaker, because another one of its group is the opposite, more so."""
    mine = change.reading.quantity
    size = change.difference.value
    others = [c.difference.value for c in found if mine.group and c.reading.quantity.group == mine.group]
    # Of two that are opposites of each other the weaker one is reported: what fouls is likelier than what is repaired.
    return any(other * size < 0.0 and abs(other) > abs(size) * (1.0 - 1e-6 * np.sign(size)) for other in others)


def causes(found: Sequence[Change]) -> list[str]:
    """What may have happened, for who looks at the vehicle; nothing where nothing fits."""
    sign = {change.reading.quantity.name: np.sign(change.difference.value) for change in found}
    rows = []
    thrusters = [
        name.removeprefix("thruster.") for name, way in sign.items() if name.startswith("thruster.") and way < 0
    ]
    if thrusters:
        rows.append(f"look at {', '.join(thrusters)}: a propeller that is fouled or damaged, or a weak supply")
    speeds, drags = ([way for name, way in sign.items() if name.startswith(kind)] for kind in ("top_speed.", "drag."))
    if sign.get("net_buoyancy", 0.0) > 0.0:
        rows.append("lighter in the water: a weight or a part may have come off, or the water is saltier")
    if sign.get("net_buoyancy", 0.0) < 0.0:
        rows.append("heavier in the water: water inside, a float that is lost, or fresher water")
    if "center_of_buoyancy_x" in sign or "center_of_buoyancy_y" in sign:
        rows.append("trim has changed: a part has moved or come off")
    if 1.0 in speeds or -1.0 in drags:
        rows.append("less drag: a part may have come off")
    elif not thrusters and 1.0 in drags:
        rows.append("more drag: a part that was added, growth, or something that hangs on the vehicle or its tether")
    elif not thrusters and -1.0 in speeds:
        rows.append("slower for the same commands: less force, as of a weak supply, or more drag; it cannot tell which")
    return rows
