"""What is known of the parameters, as a normal distribution of theta."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class Gaussian:
    """What is known of theta."""

    mean: Float[np.ndarray, " n"]
    covariance: Float[np.ndarray, "n n"]

    @property
    def information(self) -> Float[np.ndarray, "n n"]:
        return np.linalg.inv(self.covariance)
