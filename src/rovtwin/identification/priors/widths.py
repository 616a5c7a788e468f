"""What is known of a coefficient before any test: a log-normal, and how wide it must be.

Stored values are positive (X_udot = -added_mass), so that a factor is the natural error.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.constants import AXES, COEFFICIENT_UNITS
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.totals.assembly import bodies
from rovtwin.vehicle.description.vehicle import Vehicle

# Log standard deviation in translation and in rotation, by where the number comes from; of closed hulls. 0.7 is a
# factor of 2, and 95 % lie within twice that on either side. The comparisons behind: docs/identification/priors.md.
WIDTHS: dict[str, dict[str, tuple[float, float]]] = {
    "empirical": {"added_mass": (0.8, 0.6), "linear_damping": (1.2, 1.6), "quadratic_damping": (0.9, 1.4)},
    "parts": {"added_mass": (0.3, 0.4), "linear_damping": (1.2, 1.5), "quadratic_damping": (0.5, 0.8)},
    "panel": {"added_mass": (0.15, 0.3)},
    # Rms 0.25 and 0.37 against the panel method over eighteen bodies (docs/vehicles.md), and what panels leave out.
    "mesh": {"added_mass": (0.3, 0.5), "linear_damping": (1.2, 1.5), "quadratic_damping": (0.5, 0.8)},
}
# What an open hull adds, per logarithm of shape volume over displaced volume: the water inside may go along or not.
OPEN_HULL = {"added_mass": 0.5, "linear_damping": 0.0, "quadratic_damping": 0.3}
USUAL_OPENNESS = 0.7  # where nobody said what the hull displaces: half of it floods


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


def widths_of(kind: str, openness: float = 0.0) -> dict[str, float]:
    """Log standard deviation by name, `added_mass.surge`.

    Args:
        kind: Key of WIDTHS.
        openness: ln(volume of the shapes / displaced volume), from 0; see `openness_of`.
    """
    return {
        f"{quantity}.{axis}": float(np.hypot(pair[i // 3], OPEN_HULL[quantity] * openness))
        for quantity, pair in WIDTHS[kind].items()
        for i, axis in enumerate(AXES)
    }


def log_normals(
    values: Mapping[str, Float[np.ndarray, "6"]], widths: Mapping[str, float], source: str
) -> dict[str, LogNormal]:
    """Priors by name, of arrays of 6 by quantity; what is not a positive number is left out.

    Args:
        values: Quantities of COEFFICIENT_UNITS, surge to yaw.
        widths: By name, as `widths_of` gives them.
        source: Method and reference.
    """
    found = {}
    for quantity, numbers in values.items():
        for i, (axis, number) in enumerate(zip(AXES, numbers, strict=True)):
            if np.isfinite(number) and number > 0:
                name, unit = f"{quantity}.{axis}", COEFFICIENT_UNITS[quantity][i // 3]
                found[name] = LogNormal(name, float(number), widths[name], unit, source)
    return found


def openness_of(vehicle: Vehicle) -> float | None:
    """ln(volume of the shapes / displaced volume), at least 0; None for a vehicle without shapes or buoyancy."""
    shapes = [body.shape for _, body in bodies(vehicle.file, vehicle.name) if body.shape is not None]
    volume = sum(Solid.of(shape).volume() for shape in shapes)
    displaced = vehicle.assembly.volume
    return max(0.0, float(np.log(volume / displaced))) if volume > 0 and displaced > 0 else None


def prior_widths(vehicle: Vehicle, panel: bool = False) -> dict[str, float]:
    """Log standard deviation of what a vehicle's parts say before any test, by name, `added_mass.surge`.

    Args:
        vehicle: With shapes its numbers are as good as formulas for shapes; without, as good as the empirical method,
            which is all that can be said of numbers from elsewhere.
        panel: Its added mass is that of the panel method on its shapes.
    """
    openness = openness_of(vehicle)
    if openness is None:
        return widths_of("empirical")
    meshes = any(body.shape and body.shape.mesh for _, body in bodies(vehicle.file, vehicle.name))
    return widths_of("mesh" if meshes else "parts", openness) | (widths_of("panel", openness) if panel else {})
