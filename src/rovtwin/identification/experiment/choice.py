"""The choice of tests that tells most in a time, and what is expected of it.

Information adds up over tests, so that a plan is a choice among candidates: greedily, the best gain per second first,
then by exchanging as long as that helps (Fedorov 1972, Theory of optimal experiments).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Real

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.experiment.information import Information, inverse
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters

LEARNT = 0.5  # a parameter counts as identifiable where a test brings its standard deviation below this share


def spread(prior: Gaussian, information: Information, times: Real[np.ndarray, " tests"]) -> float:
    """What a plan makes small: mean logarithm of the variances of theta over those of the prior."""
    return _spread(prior, inverse(information.after(prior, times)))


def _spread(prior: Gaussian, covariance: Float[np.ndarray, "n n"]) -> float:
    n = len(prior.mean)
    return float(np.mean(np.log(np.diag(covariance)[:n] / np.diag(prior.covariance))))


def choose_tests(prior: Gaussian, information: Information, seconds: float, start: Sequence[int] = ()) -> list[int]:
    """Tests to fly within a time, in the order in which they tell most; one may be flown several times.

    Args:
        prior: Of theta.
        information: By the candidates.
        seconds: There are.
        start: Tests that are in the plan before others are added; they may be exchanged, too.

    Raises:
        IdentificationError: Not even the shortest candidate fits.
    """
    if seconds < information.seconds.min():
        raise IdentificationError(
            f"found {seconds / 60:.3g} minutes, expected at least {information.seconds.min() / 60:.1f}: "
            "the shortest manoeuvre"
        )
    order = list(start)
    while (best := _best(prior, information, order, seconds)) is not None:
        order.append(best)
    return _exchanged(prior, information, order, seconds)


def _times(information: Information, order: Sequence[int]) -> Float[np.ndarray, " tests"]:
    return np.bincount(np.asarray(order, dtype=int), minlength=len(information.seconds)).astype(float)


def _best(prior: Gaussian, information: Information, order: Sequence[int], seconds: float) -> int | None:
    """The candidate that fits beside others and gains most per second."""
    left = seconds - sum(information.seconds[i] for i in order)
    total = information.after(prior, _times(information, order))
    covariance = inverse(total)
    now, most = _spread(prior, covariance), _most(prior, information, covariance)
    best, gain = None, 0.0
    for i in np.argsort(-most):
        if most[i] <= gain:
            break
        if information.seconds[i] > left + 1e-9:
            continue
        gained = (now - _spread(prior, inverse(total + information.matrices[i]))) / information.seconds[i]
        if gained > gain:
            best, gain = int(i), gained
    return best


def _most(
    prior: Gaussian, information: Information, covariance: Float[np.ndarray, "n n"]
) -> Float[np.ndarray, " tests"]:
    """What each candidate gains at most per second.

    A variance is the inverse of a Schur complement, which is concave in the information, so that its logarithm is
    convex: no candidate gains more than the slope says. Few have to be looked at more closely.
    """
    n = len(prior.mean)
    columns = covariance[:, :n]
    slope = (columns / np.diag(covariance)[:n]) @ columns.T / n
    return np.tensordot(information.matrices, slope, 2) / information.seconds


def _exchanged(
    prior: Gaussian, information: Information, order: list[int], seconds: float, rounds: int = 3
) -> list[int]:
    """The plan with each test replaced by a better one, as long as there is one."""
    for _ in range(rounds):
        changed = False
        for place in range(len(order)):
            best = _best(prior, information, order[:place] + order[place + 1 :], seconds)
            if best is not None and best != order[place]:
                new = [*order[:place], best, *order[place + 1 :]]
                if (
                    spread(prior, information, _times(information, new))
                    < spread(prior, information, _times(information, order)) - 1e-9
                ):
                    order, changed = new, True
        if not changed:
            break
    return order


@dataclass(frozen=True, eq=False)
class Expected:
    """What a plan is expected to tell.

    Attributes:
        names: Of the parameters.
        values: Where theta = 0, in their units.
        relative: Whether standard deviations are shares of the value, else in its unit.
        prior, plan: Standard deviation before and after.
        minutes: After each manoeuvre [min].
        path: Standard deviations after each.
    """

    names: list[str]
    values: Float[np.ndarray, " n"]
    relative: Bool[np.ndarray, " n"]
    prior: Float[np.ndarray, " n"]
    plan: Float[np.ndarray, " n"]
    minutes: Float[np.ndarray, " k"]
    path: Float[np.ndarray, "k n"]

    @property
    def learnt(self) -> Bool[np.ndarray, " n"]:
        """Which parameters the plan identifies."""
        return self.plan < LEARNT * self.prior

    def each_minute(self) -> list[tuple[float, float]]:
        """After each whole minute: [min], and the geometric mean of sd over prior of what the plan identifies."""
        ratio = np.exp(np.mean(np.log(self.path[:, self.learnt] / self.prior[self.learnt]), axis=1))
        marks = np.arange(1.0, np.floor(self.minutes[-1] + 1e-9) + 1.0)
        full = np.concatenate([[0.0], self.minutes]), np.concatenate([[0.0], np.log(ratio)])
        return [(float(m), float(np.exp(np.interp(m, *full)))) for m in marks]


def expected(parameters: Parameters, prior: Gaussian, information: Information, order: Sequence[int]) -> Expected:
    """Of a plan, manoeuvre by manoeuvre."""
    path = [
        np.sqrt(np.diag(information.covariance(prior, _times(information, order[: k + 1])))) for k in range(len(order))
    ]
    return Expected(
        names=parameters.names,
        values=parameters.values(np.zeros(len(parameters))),
        relative=np.array([p.positive for p in parameters.free]),
        prior=np.sqrt(np.diag(prior.covariance)),
        plan=path[-1],
        minutes=np.cumsum(information.seconds[list(order)]) / 60.0,
        path=np.stack(path),
    )


def identified(
    ours: Float[np.ndarray, " n"], theirs: Float[np.ndarray, " n"], prior: Float[np.ndarray, " n"]
) -> Bool[np.ndarray, " n"]:
    """Which parameters at least one of two tests brings below half of the prior's standard deviation."""
    return np.minimum(ours, theirs) < LEARNT * prior


def variance_ratio(
    ours: Float[np.ndarray, " n"], theirs: Float[np.ndarray, " n"], prior: Float[np.ndarray, " n"]
) -> float:
    """Geometric mean of our variances over theirs, of the parameters that at least one of both identifies.

    Args:
        ours: Standard deviations.
        theirs: The same.
        prior: Before any test.
    """
    known = identified(ours, theirs, prior)
    return float(np.exp(2.0 * np.mean(np.log(ours[known] / theirs[known]))))
