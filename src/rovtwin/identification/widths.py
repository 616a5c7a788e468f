"""What is known of a coefficient before any test: a log-normal, and how wide it must be.

Stored values are positive (X_udot = -added_mass), so that a factor is the natural error.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rovtwin.vehicle.assembly import bodies
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.vehicle import Vehicle

UNITS = {
    "added_mass": ("kg", "kg m2"),
    "linear_damping": ("N s/m", "N m s/rad"),
    "quadratic_damping": ("N s2/m2", "N m s2/rad2"),
}

# Log standard deviation in translation and in rotation, by where the number comes from. 0.7 is a factor of 2, and 95 %
# lie within twice that on either side. docs/identification/priors.md has the comparisons behind every number.
WIDTHS: dict[str, dict[str, tuple[float, float]]] = {
    "empirical": {"added_mass": (1.0, 0.9), "linear_damping": (1.4, 1.8), "quadratic_damping": (0.9, 1.0)},
    "parts": {"added_mass": (0.5, 0.5), "linear_damping": (1.2, 1.2), "quadratic_damping": (0.5, 0.8)},
    "panel": {"added_mass": (0.3, 0.5)},
}


@dataclass(frozen=True)
class LogNormal:
    """One coefficient before tests: log(value) is normal about log(median).

    Attributes:
        name: Its place in the model, `added_mass.surge`.
        median: In `unit`.
        log_sd: Standard deviation of the logarithm.
        unit: SI.
        source: Method and reference.
    """

    name: str
    median: float
    log_sd: float
    unit: str
    source: str

    @property
    def interval(self) -> tuple[float, float]:
        """Holds the truth with 95 %."""
        factor = float(np.exp(1.96 * self.log_sd))
        return self.median / factor, self.median * factor

    def deviation(self, value: float) -> float:
        """How many standard deviations of the logarithm a value is away; infinite for 0."""
        return float(np.log(value / self.median) / self.log_sd) if value > 0 else -np.inf


def log_normals(values: Mapping[str, np.ndarray], kind: str, source: str) -> dict[str, LogNormal]:
    """Priors by name, of arrays of 6 by quantity; what is not a positive number is left out.

    Args:
        values: Quantities of UNITS, each shape (6,), surge to yaw.
        kind: Key of WIDTHS.
        source: Method and reference.
    """
    found = {}
    for quantity, numbers in values.items():
        for i, (axis, number) in enumerate(zip(AXES, numbers, strict=True)):
            if np.isfinite(number) and number > 0:
                width, unit = WIDTHS[kind][quantity][i // 3], UNITS[quantity][i // 3]
                found[f"{quantity}.{axis}"] = LogNormal(f"{quantity}.{axis}", float(number), width, unit, source)
    return found


def prior_widths(vehicle: Vehicle, panel: bool = False) -> dict[str, float]:
    """Log standard deviation of what a vehicle's file says before any test, by name, `added_mass.surge`.

    Args:
        vehicle: With shapes its numbers are as good as formulas for shapes; without, as good as the empirical method,
            which is all that can be said of numbers from elsewhere.
        panel: Its added mass is that of the panel method on its shapes.
    """
    kind = "parts" if any(body.shape is not None for _, body in bodies(vehicle.file, vehicle.name)) else "empirical"
    widths = dict(WIDTHS[kind])
    if panel:
        widths |= WIDTHS["panel"]
    return {f"{quantity}.{axis}": width[i // 3] for quantity, width in widths.items() for i, axis in enumerate(AXES)}
