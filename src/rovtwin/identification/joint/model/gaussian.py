"""What is known of the parameters, as a normal distribution of theta."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Gaussian:
    """What is known of theta: mean (n,) and covariance (n, n)."""

    mean: np.ndarray
    covariance: np.ndarray

    @property
    def information(self) -> np.ndarray:
        return np.linalg.inv(self.covariance)
