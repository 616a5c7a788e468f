"""Whether tests repeat: what each part alone says of the damping forces, against the uncertainty that is stated."""

from itertools import combinations
from typing import Any

from rovtwin.commission.evidence.forces import COVERAGE, Quantity
from rovtwin.commission.stage import Check

MOST = 1.5  # largest difference over its expanded uncertainty; beyond it the tests do not repeat
FEW = 2  # quantities beyond 1 that chance alone may give


def repeats(result: Any, forces: list[Quantity]) -> list[dict[str, Any]]:
    """A row for each force: what each part (or half of a single one) gives alone, and the largest difference of two.

    To first order, with the prior and the scale that all parts share (`identification.joint.uncertainty.apart`); what
    they share cancels in a difference, which is held against the expanded uncertainty (k = 2) of that difference:
    E_n of ISO/IEC 17043, with the correlation.
    """
    solution = result.solution
    apart = None if solution is None else solution.apart or solution.halves
    if apart is None or apart.difference_covariance is None:
        return []
    pairs, rows = list(combinations(range(len(apart.names)), 2)), []
    for one in forces:
        alone = one.value + (apart.theta - result.theta) @ one.slope
        gaps = {
            (a, b): (abs(alone[a] - alone[b]), COVERAGE * one.std(apart.difference_covariance[a, b])) for a, b in pairs
        }
        worst = max(gaps, key=lambda pair: gaps[pair][0] / max(gaps[pair][1], 1e-12))
        gap, width = gaps[worst]
        rows.append(
            {
                "axis": one.axis,
                "speed": one.at,
                "unit": one.unit,
                "together": one.value,
                "alone": {name: float(value) for name, value in zip(apart.names, alone, strict=True)},
                "largest_difference": float(gap),
                "expanded_uncertainty": width,
                "en": float(gap / max(width, 1e-12)),
                "between": [apart.names[k] for k in worst],
            }
        )
    return rows


def about(rows: list[dict[str, Any]]) -> list[Check]:
    """The rows in words: ok where nothing differs by more than its uncertainty."""
    if not rows:
        text = "not looked at: there is a single short test, or the estimate has not settled"
        return [Check("note", "repeatability", text)]
    beyond = [row for row in rows if row["en"] > 1.0]
    worst = max(rows, key=lambda row: row["en"])
    text = (
        f"{len(rows) - len(beyond)} of {len(rows)} damping forces repeat within their expanded uncertainty (k = 2); "
        f"largest: {worst['axis']} at {worst['speed']:+.2g}, {' against '.join(worst['between'])} differ by "
        f"{worst['largest_difference']:.2g} {worst['unit']}, {worst['en']:.2g} times what is stated"
    )
    if worst["en"] <= MOST and len(beyond) <= FEW:
        return [Check("ok", "repeatability", text)]
    fix = "What changed between them: battery, tether, payload, current? Fly one more part: --minutes."
    return [Check("warning", "repeatability", text, fix)]
