"""A quick estimate while a test is flown: forces balanced along the smoothed path, with the uncertainty that leaves.

It is where the joint estimate starts from (`joint.solver.equation_error`), made over and over on a log that
grows. Smoothing takes away part of what it looks at, and noise in the states biases it, so that its widths are made
wider by a factor that was found on simulated flights of one test with eight truths (see `SCATTER`). What is worth
relying on is `identify`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.identification.identify import parameters_and_prior
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.equation_error import FEWEST, Balance, Fit, lowest
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.segments import Grid, cut
from rovtwin.identification.logs.record import Record
from rovtwin.vehicle import Vehicle

PIECE = 5.0  # [s] of a test that are balanced at once
# Widening of the scatter that the residuals show: 2.5 makes 95 % intervals hold nine truths in ten, see
# docs/console_identify.md.
SCATTER = 2.5
# What the smoothing makes wrong by more than that: it looks like a lag, and like damping of what swings.
BIASED = ("*.time_constant", "linear_damping*.roll", "linear_damping*.pitch")


@dataclass(frozen=True, eq=False)
class QuickEstimate:
    """What the balance of forces says so far.

    Attributes:
        parameters: The free ones.
        prior: What was known before.
        theta, covariance: The estimate; the prior's where too little was seen.
        changes: Changes of velocity that it rests on, all components counted.
    """

    parameters: Parameters
    prior: Gaussian
    theta: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]
    changes: int

    def rows(self) -> list[dict[str, Any]]:
        """Name, unit, value and its 95 % interval, the prior's, and the ratio of standard deviations, by parameter.

        Those that this estimate gets wrong are left out, see BIASED.
        """
        now, before = (np.sqrt(np.diag(C)) for C in (self.covariance, self.prior.covariance))
        found = []
        for i, p in enumerate(self.parameters.free):
            if any(fnmatchcase(p.name, pattern) for pattern in BIASED):
                continue
            ends = [float(p.value(self.theta[i] + z * now[i])) for z in (0.0, -1.96, 1.96)]
            old = [float(p.value(self.prior.mean[i] + z * before[i])) for z in (0.0, -1.96, 1.96)]
            names = {"name": p.name, "unit": p.unit, "ratio": float(now[i] / before[i])}
            found.append(names | {"value": ends[0], "low": ends[1], "high": ends[2]})
            found[-1] |= {"prior": old[0], "prior_low": old[1], "prior_high": old[2]}
        return found


class Quick:
    """The estimator of one vehicle and test; compiles once, whatever has been logged of it."""

    def __init__(self, vehicle: Vehicle, duration: float, pieces: int = 1):
        """`duration` of the whole test [s], and Records that it may be cut into: room for them is made now."""
        self._settings = Options.read({})
        self._vehicle = vehicle
        settings = self._settings
        self._grid = Grid(settings.step, round(PIECE / settings.step), settings.rate)
        self._room = int(duration / PIECE) + 2 * pieces + 1
        self.parameters, self.prior = parameters_and_prior(vehicle, (), (), None, None, settings)
        self._balance = Balance(self.parameters, self._grid)

    def estimate(self, records: Sequence[Record]) -> QuickEstimate:
        """Of what is logged.

        Raises:
            IdentificationError: A record is too short, or longer than there is room for.
        """
        segments = cut(records, self._grid)
        arrays = self._balance.padded(self._balance.arrays_of(segments), self._room)
        fit = Fit(self._balance, arrays, self.prior, None)
        seen = int(fit.used.sum())
        if seen < FEWEST:
            return QuickEstimate(self.parameters, self.prior, self.prior.mean.copy(), self.prior.covariance, seen)
        theta, sigma = lowest(fit, self.parameters, self.prior)
        measured, known = fit.information(theta, sigma), self.prior.information
        # As many residuals as parameters scatter little, whatever the model is worth.
        fitted = float(np.trace(np.linalg.solve(measured + known, measured)))
        wider = SCATTER**2 * seen / max(seen - fitted, 1.0)
        covariance = np.linalg.inv(measured / wider + known)
        return QuickEstimate(self.parameters, self.prior, theta, covariance, seen)
