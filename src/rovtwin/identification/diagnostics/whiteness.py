"""What is left of the readings after the fit: size, whiteness, and how far the widths can be trusted."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.arrays.correlation import inflation
from rovtwin.core.numerics import as_array
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.logs.record import SIGNALS

_LAGS = 25


@dataclass(frozen=True, eq=False)
class Residuals:
    """Of one signal component, all records together.

    Attributes:
        t: Times since each record's start [s].
        record: Index of the record of each.
        normalised: Residual over its standard deviation.
        rms: In the signal's unit.
        autocorrelation: At lags 1 .. 25 readings.
        outside: Share of these lags beyond the 95 % band of white noise; 0.05 is what white noise has.
        inflation: How many correlated readings count as one, 1 for white noise.
    """

    t: Float[np.ndarray, " n"]
    record: Int[np.ndarray, " n"]
    normalised: Float[np.ndarray, " n"]
    rms: float
    autocorrelation: Float[np.ndarray, "25"]
    outside: float
    inflation: float


def residual_analysis(problem: Problem, solution: Solution) -> dict[str, Residuals]:
    """By component, `gyro.p`. They are white where model and noise are right (Ljung 1999, ch. 16)."""
    segments, unknowns = problem.segments, solution.unknowns
    found, _ = problem.shooting.residuals(
        as_array(unknowns.theta), as_array(unknowns.offsets), unknowns.nodes, segments.arrays
    )
    starts = segments.starts()
    owner = np.searchsorted(np.array(segments.first), np.arange(segments.count), side="right") - 1
    begins = np.array([r.start for r in segments.records])[owner]
    sigma = dict(zip(segments.groups, solution.noise.sigma, strict=True))
    out = {}
    for name, gap in found.items():
        rows = segments.arrays[name]
        used = rows["used"] > 0
        t = ((starts - begins)[:, None] + segments.grid.step * (rows["row"] + rows["share"]))[used]
        whose = np.broadcast_to(owner[:, None], used.shape)[used]
        for i, component in enumerate(SIGNALS[name][0]):
            r = np.asarray(gap)[..., i][used]
            out[f"{name}.{component}"] = _analysed(t, whose, r, float(sigma[name, i]))
    return out


def _analysed(
    t: Float[np.ndarray, " n"], record: Int[np.ndarray, " n"], r: Float[np.ndarray, " n"], sigma: float
) -> Residuals:
    z = r / sigma
    correlation = autocorrelation(z, record)
    band = 1.96 / np.sqrt(max(len(z), 1))
    return Residuals(
        t=t,
        record=record,
        normalised=z,
        rms=float(np.sqrt(np.mean(r**2))) if len(r) else float("nan"),
        autocorrelation=correlation,
        outside=float(np.mean(np.abs(correlation) > band)),
        inflation=inflation(np.concatenate([[1.0], correlation])),
    )


def autocorrelation(z: Float[np.ndarray, " n"], record: Int[np.ndarray, " n"]) -> Float[np.ndarray, "25"]:
    """At lags 1 .. 25, pairs across records left out."""
    total = float(np.sum(z**2))
    out = np.zeros(_LAGS)
    for lag in range(1, _LAGS + 1):
        if len(z) > lag and total > 0:
            same = record[lag:] == record[:-lag]
            out[lag - 1] = float(np.sum((z[lag:] * z[:-lag])[same])) / total
    return out
