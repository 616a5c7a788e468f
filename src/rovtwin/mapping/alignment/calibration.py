"""What a registration says of the imager's calibration, and what it must not be asked: parameters that look alike.

At constant speed and height an imager that is pitched, one whose clock is off and one that sits farther ahead see the
same: at 0.2 m/s and 1.5 m one degree is 26 mm is 130 ms. What overlaps then know is their sum. Such a parameter is
refused with its numbers; it needs a prior, lines at two speeds, or lines at two heights.
"""

from dataclasses import dataclass

import numpy as np

from rovtwin.mapping.alignment.ground_points import CALIBRATION
from rovtwin.mapping.alignment.joint import JointErrors

LEAST_GAIN = 0.7  # a parameter is found where its standard deviation fell below that share of the one before
ALIKE = 0.9  # multiple correlation with all others from which on a parameter is not told apart from them,
LEAST_ALIKE = 0.3  # unless its standard deviation fell below that share even so


@dataclass(frozen=True)
class CalibrationFinding:
    """Of one parameter.

    Attributes:
        name: Of CALIBRATION.
        value: Estimate of its error, true less stated [rad, m, s].
        std: Of the estimate.
        prior: Standard deviation before.
        alike: The parameter whose estimate correlates most with it.
        correlation: With all others together (multiple correlation, 0 to 1).
        refused: Why it is not to be taken over into the vehicle's file; "" where it may be.
    """

    name: str
    value: float
    std: float
    prior: float
    alike: str
    correlation: float
    refused: str


def calibration_findings(before: JointErrors, after: JointErrors) -> list[CalibrationFinding]:
    """What a registration found of each parameter that had a standard deviation before."""
    prior = np.sqrt(np.diag(before.calibration[1]))
    value, covariance = after.calibration
    free = np.flatnonzero(prior > 0.0)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    part = covariance[np.ix_(free, free)]
    # 1 - R^2: the variance that is left of each once all others are known, as a share of its own.
    left = 1.0 / (np.diag(part) * np.diag(np.linalg.inv(part)))
    together = np.sqrt(np.clip(1.0 - left, 0.0, 1.0))
    found = []
    for k, multiple in zip(free.tolist(), together.tolist(), strict=True):
        among = np.abs(covariance[k] / np.where(std > 0.0, std, np.inf))
        among[k] = 0.0
        like = CALIBRATION[int(np.argmax(among))]
        found.append(_finding(CALIBRATION[k], float(value[k]), float(std[k]), float(prior[k]), like, multiple))
    return found


def _finding(name: str, value: float, std: float, prior: float, like: str, multiple: float) -> CalibrationFinding:
    refused = ""
    if std > LEAST_GAIN * prior:
        refused = f"overlaps leave {std / prior:.0%} of its standard deviation before: they hardly see it"
    elif multiple > ALIKE and std > LEAST_ALIKE * prior:
        share = np.sqrt(1.0 - multiple**2)
        refused = (
            f"{share:.0%} of its standard deviation would be left if the others were known: it looks like them, "
            f"most of all like {like}. Fly at two speeds or heights, or measure {like}"
        )
    return CalibrationFinding(name, value, std, prior, like, multiple, refused)
