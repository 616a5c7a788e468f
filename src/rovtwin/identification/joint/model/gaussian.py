"""What is known of the parameters, as a normal distribution of theta."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


def root_of(covariance: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "n n"]:
    """A with A A' = covariance; what rounding in a file made negative counts as zero."""
    spread, axes = np.linalg.eigh(covariance)
    return axes * np.sqrt(np.maximum(spread, 0.0))


@dataclass(frozen=True, eq=False)
class Gaussian:
    """What is known of theta."""

    mean: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]

    @property
    def information(self) -> Float[np.ndarray, "n n"]:
        return np.linalg.inv(self.covariance)
