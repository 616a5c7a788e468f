"""What the shapes of double_blueye's parts give, without the thesis's totals."""

from functools import cache

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.totals.assembly import assemble
from rovtwin.vehicle.description.totals.drag import Damping


@cache
def _damping() -> Damping:
    file = load_vehicle("double_blueye").file.model_copy(update={"hydrodynamics": None})
    return assemble(file, "double_blueye without hydrodynamics").damping()


def quadratic_of_parts() -> Float[np.ndarray, "6"]:
    """Diagonal of quadratic damping."""
    return np.diag(_damping().quadratic_ahead)


def linear_of_parts() -> Float[np.ndarray, "6"]:
    """Diagonal of linear damping."""
    return np.diag(_damping().linear_ahead)
