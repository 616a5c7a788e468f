"""Whether the tests repeat: each log, or each half of a single one, by itself; differences over their widths."""

from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.report.identification.tables import number, pretty
from rovtwin.report.identification.words import is_coupling
from rovtwin.report.parts.tables import Table

_Z = 1.96
_INFORMED = 0.9  # of the prior's width, below which one of two estimates says something
_NOTE = (
    "What each would give alone, with the same prior, one step from the common estimate; and half the width of its "
    "95 % interval. The last column is the largest difference of two over its standard deviation: 1 on average, 2 in "
    "one of twenty. Parameters of which none of them tells anything are left out, couplings are counted but not listed."
)


def repeatability_table(result: Any) -> Table | None:
    """A row for each parameter; None where there is nothing to compare."""
    solution = result.solution
    apart = None if solution is None else solution.apart or solution.halves
    if apart is None:
        return None
    before, parameters = np.sqrt(np.diag(result.prior.covariance)), result.parameters.free
    informed = [i for i in range(len(parameters)) if np.any(apart.std[:, i] < _INFORMED * before[i])]
    gaps = apart.gaps()
    pairs = np.triu_indices(len(apart.names), 1)
    rows = []
    for i in (i for i in informed if not is_coupling(parameters[i].name)):
        p = parameters[i]
        cells = [
            _alone(p, float(theta), float(std)) for theta, std in zip(apart.theta[:, i], apart.std[:, i], strict=True)
        ]
        rows.append([p.name, pretty(p.unit), *cells, f"{gaps[..., i].max():.2g}"])
    if not informed:
        return None
    every = gaps[pairs][:, informed]
    words = f"{np.sum(every < _Z)} of {every.size} differences are below 2 standard deviations, rms {_rms(every):.2f}. "
    return Table("", ["Parameter", "Unit", *apart.names, "Largest difference"], rows, words + _NOTE)


def _alone(parameter: Any, theta: float, std: float) -> str:
    low, high = (float(parameter.value(theta + s * _Z * std)) for s in (-1.0, 1.0))
    return f"{number(float(parameter.value(theta)), 3)} ± {number(0.5 * (high - low), 2)}"


def _rms(x: Float[np.ndarray, "..."]) -> float:
    return float(np.sqrt(np.mean(x**2)))
