"""What people ask of the factors: drag, added mass and force along each axis, top speed, and what restores.

Each is a linear function of theta, so its standard deviation follows from the covariance. Force along an axis is the
mean of its thrusters' factors, weighted by what each can give; a thruster is compared with the others of its axis.
Where drag is mostly quadratic, the top speed goes with the square root of force over drag, and a flight tells that
ratio far better than either of the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.monitoring.evidence import Estimated
from rovtwin.monitoring.factors import AXES, Factors
from rovtwin.vehicle.physics.actuation import BY_PRODUCT, reachable_share
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import force_limits

LEARNT = 0.5  # of what was known before, below which a standard deviation counts as learnt
FAR = 3.0  # standard deviations from what was known before, from which a value is news however wide
TURNING = 3  # first of the axes of rotation


@dataclass(frozen=True)
class Quantity:
    """What is asked.

    Attributes:
        name: As in `drag.surge`.
        words: For people.
        unit: Of its value, `1` for a logarithm.
        group: Numbers of the thrusters among which one is compared, empty for all else.
    """

    name: str
    words: str
    unit: str
    group: tuple[int, ...] = ()


@dataclass(frozen=True)
class Reading:
    """A quantity as a flight gives it.

    Attributes:
        quantity: What it is.
        value: Logarithm of the factor, or in the quantity's unit.
        std: Its standard deviation.
        prior_std: The same before the flight.
    """

    quantity: Quantity
    value: float
    std: float
    prior_std: float

    @property
    def learnt(self) -> bool:
        """Whether the flight says something of it: it is narrower than before, or far from what was thought."""
        return bool(self.std < LEARNT * self.prior_std or abs(self.value) > FAR * max(self.prior_std, self.std))

    @property
    def scale(self) -> tuple[float, str]:
        """What `value` and `std` are multiplied by to be read, and the unit then."""
        return {"1": (100.0, "%"), "m": (1e3, "mm")}.get(self.quantity.unit, (1.0, self.quantity.unit))

    @property
    def interval(self) -> tuple[float, float, float]:
        """Two standard deviations below, the value, and two above, as they are read."""
        ends = np.array([self.value - 2.0 * self.std, self.value, self.value + 2.0 * self.std])
        low, middle, high = self.scale[0] * (np.expm1(ends) if self.quantity.unit == "1" else ends)
        return float(low), float(middle), float(high)

    def with_values(self, value: float, std: float) -> "Reading":
        """The same quantity, another value and deviation."""
        return replace(self, value=value, std=std)

    def __str__(self) -> str:
        """As in `surge drag +14 ± 3 %`."""
        return f"{self.quantity.words} {self.figures}"

    @property
    def figures(self) -> str:
        """As in `+14 ± 3 %`; a dash where nothing is known."""
        if not np.isfinite(self.std):
            return "–"
        factor, unit = self.scale
        value, std = self.value, self.std
        if unit == "%":
            value, std = np.expm1(value), np.exp(value) * std
        digits = int(np.clip(1 - np.floor(np.log10(max(factor * std, 1e-9))), 0, 3)) if factor * std < 1 else 0
        return f"{factor * value:+z.{digits}f} ± {factor * std:.{digits}f} {unit}"


class Quantities:
    """All quantities of a vehicle, as rows of a matrix on theta.

    Attributes:
        each: What they are.
        matrix: Derivatives by the factors.
    """

    def __init__(self, model: Model, thrusters: Sequence[str], factors: Factors):
        """Of a vehicle with the names of its thrusters; axes without thrusters have no force and no top speed."""
        self._factors = factors
        n, p = len(thrusters), len(factors.each)
        row = np.eye(p)
        shares = _shares(model)
        rows = [(Quantity(f"drag.{axis}", f"{axis} drag", "1"), row[i]) for i, axis in enumerate(AXES)]
        rows += [(Quantity(f"added_mass.{axis}", f"{axis} added mass", "1"), row[6 + i]) for i, axis in enumerate(AXES)]
        for i, axis in enumerate(AXES):
            if shares[i].any():
                force = np.zeros(p)
                force[12 : 12 + n] = shares[i]
                rows.append((Quantity(f"force.{axis}", f"{axis} force", "1"), force))
                words = f"{axis} top speed" if i < TURNING else f"{axis} top rate"
                rows.append((Quantity(f"top_speed.{axis}", words, "1"), 0.5 * (force - row[i])))
        for k, name in enumerate(thrusters):
            contrast, words = np.zeros(p), f"force of {name}"
            beside = _against_others(shares, k)
            contrast[12 : 12 + n] = beside
            words += " against others" if np.any(beside < 0.0) else ""
            rows.append((Quantity(f"thruster.{name}", words, "1", tuple(map(int, np.flatnonzero(beside)))), contrast))
        rows += [
            (Quantity("metacentric_height", "metacentric height", "1"), row[12 + n]),
            (Quantity("net_buoyancy", "net buoyancy", "N"), row[13 + n]),
            (Quantity("center_of_buoyancy_x", "centre of buoyancy, ahead,", "m"), row[14 + n]),
            (Quantity("center_of_buoyancy_y", "centre of buoyancy, to starboard,", "m"), row[15 + n]),
        ]
        self.each = [quantity for quantity, _ in rows]
        self.matrix = np.stack([values for _, values in rows])

    def read(self, found: Estimated) -> list[Reading]:
        """Each quantity with its standard deviation."""
        value, std, before = self.matrix @ found.theta, self._std(found.covariance), self._std(self._factors.covariance)
        return [
            Reading(quantity, float(value[i]), float(std[i]), float(before[i])) for i, quantity in enumerate(self.each)
        ]

    def _std(self, covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, " q"]:
        return np.sqrt(np.einsum("qp,pr,qr->q", self.matrix, covariance, self.matrix))


def _against_others(shares: Float[np.ndarray, "_ n"], k: int) -> Float[np.ndarray, " n"]:
    """A thruster's factor less the mean of the others along the axis in which it counts most, on those of all, (n,).

    One that has no others there is compared with nothing: a common change is hard to tell, a difference is not.
    """
    several = np.count_nonzero(shares, axis=1) > 1
    axis = int(np.argmax(np.where(several, shares[:, k], 0.0)))
    out = np.zeros(shares.shape[1])
    if shares[axis, k] > 0.0 and several[axis]:
        out = -shares[axis] / (1.0 - shares[axis, k])
    out[k] = 1.0
    return out


def _shares(model: Model) -> Float[np.ndarray, "6 n"]:
    """Share of each thruster in the force along each axis; zeros where thrusters do not push."""
    T = np.asarray(model.thrusters.configuration)
    low, high = (np.asarray(limit) for limit in force_limits(model.thrusters))
    most = np.abs(T) * np.maximum(-low, high)
    most = np.where((reachable_share(T) > BY_PRODUCT)[:, None], most, 0.0)
    total = most.sum(axis=1, keepdims=True)
    return np.where(total > 0.0, most / np.where(total > 0.0, total, 1.0), 0.0)
