"""Registration: one linear update of all errors of a mosaic from its overlaps and known points, false ones dropped.

    x = C H' S^-1 d,   C_after = C - C H' S^-1 H C,   S = H C H' + R

Each measurement is tried against all others (Baarda's data snooping), as pair of north and east:

    T_i = w_i' (E_i' S^-1 E_i)^-1 w_i,   w = S^-1 d,   chi-square of 2

The largest beyond the gate is dropped, and all is tried again. The mean of d' S^-1 d says whether the stated covariance
agrees with the overlaps, where there is no truth.

Reference: Baarda (1968), A testing procedure for use in geodetic networks; Teunissen (2018), Distributional theory for
the DIA method, Journal of Geodesy 92.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve
from scipy.stats import chi2

from rovtwin.core.errors import LogError
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.alignment.ties import Observations

FALSE_ALARM = 1e-4  # of a good measurement, at each trial
_MOST_FALSE = 0.5  # share beyond which nothing can be said


@dataclass(frozen=True)
class Registration:
    """What overlaps and known points made of a mosaic's errors.

    Attributes:
        joint: Errors and covariance after.
        used: Which observations counted.
        nis: Normalised innovation squared of those, by component; 1 where the stated covariance is right.
        interval: 95 % of what it would then be, if components were independent.
        before: Of the used ones, rms of what they measured [m].
        after: And of what is left of it.
        statistics: T of each observation: when it was dropped, else in the end.
        gate: T beyond which one is dropped.
        left: What is left of each observation, of those dropped too, north and east [m].
    """

    joint: JointErrors
    used: Bool[np.ndarray, " m"]
    nis: float
    interval: tuple[float, float]
    before: float
    after: float
    statistics: Float[np.ndarray, " m"]
    gate: float
    left: Float[np.ndarray, "m 2"]

    @property
    def dropped(self) -> int:
        """How many were false."""
        return int((~self.used).sum())


def register(joint: JointErrors, observed: Observations, false_alarm: float = FALSE_ALARM) -> Registration:
    """Update a mosaic's errors.

    Args:
        joint: As they are known before, of mean zero.
        observed: Ties and control points.
        false_alarm: Probability that a good measurement is dropped at a trial.

    Raises:
        LogError: There is nothing to go by, or half of it contradicts the rest.
    """
    m = len(observed.d)
    if m == 0:
        raise LogError("registration: found no ties and no control points, expected at least one")
    HC = observed.H @ joint.covariance
    S = HC @ observed.H.T
    S = 0.5 * (S + S.T)
    for k in range(m):
        S[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += observed.R[k]
    gate = float(chi2.isf(false_alarm, 2))
    used, statistics = _snooped(S, observed.d, gate)
    if used.sum() < (1.0 - _MOST_FALSE) * m:
        raise LogError(
            f"registration: {int((~used).sum())} of {m} ties and control points contradict the others and the stated "
            "navigation. Is the floor right, or the mount? Are lines and track of one run?"
        )
    rows = np.repeat(used, 2)
    d, HC = observed.d[used].ravel(), HC[rows]
    factor = cho_factor(S[np.ix_(rows, rows)])
    weighted = cho_solve(factor, d)
    mean, n = HC.T @ weighted, len(d)
    covariance = joint.covariance - HC.T @ cho_solve(factor, HC)
    left = observed.d - (observed.H @ mean).reshape(-1, 2)
    low, high = chi2.ppf([0.025, 0.975], n) / n
    return Registration(
        replace(joint, mean=mean, covariance=0.5 * (covariance + covariance.T)),
        used,
        float(d @ weighted) / n,
        (float(low), float(high)),
        float(np.sqrt(np.mean(d**2))),
        float(np.sqrt(np.mean(left[used] ** 2))),
        statistics,
        gate,
        left,
    )


def _snooped(
    S: Float[np.ndarray, "2m 2m"], d: Float[np.ndarray, "m 2"], gate: float
) -> tuple[Bool[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Which measurements agree with the others, and T of each."""
    m = len(d)
    used, statistics = np.ones(m, bool), np.zeros(m)
    inverse = np.linalg.inv(S)
    while used.any():
        at = np.flatnonzero(used)
        rows = np.repeat(used, 2)
        part = inverse[np.ix_(rows, rows)]
        w = (part @ d[at].ravel()).reshape(-1, 2)
        blocks = part.reshape(len(at), 2, len(at), 2)[np.arange(len(at)), :, np.arange(len(at))]
        T = np.einsum("mi,mi->m", w, np.linalg.solve(blocks, w[..., None])[..., 0])
        statistics[at] = T
        worst = int(np.argmax(T))
        if T[worst] <= gate:
            break
        used[at[worst]] = False
        gone = slice(2 * at[worst], 2 * at[worst] + 2)
        column = inverse[:, gone]  # the inverse without these rows, by Schur's complement
        inverse = inverse - column @ np.linalg.solve(inverse[gone, gone], column.T)
    return used, statistics
