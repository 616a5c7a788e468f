"""What a flight asks of thrusters and batteries: how much force is left, and how much energy is used."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import as_array
from rovtwin.simulation.battery import thruster_power
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.description.power import PowerSource
from rovtwin.vehicle.physics.thrusters import force_limits

WINDOW = 1.0  # over which a thruster's share is averaged: one peak of a noisy command is no lack of thrust [s]
LEAST = 1e-6  # [N]


def margins(
    thrust: Float[np.ndarray, "m n"], dt: float, model: Model, times: Float[np.ndarray, "count 4"]
) -> Float[np.ndarray, " count"]:
    """Least share of force that the most loaded thruster has left on the way to each way-point; NaN if not reached.

    Args:
        thrust: Force of each thruster [N], every `dt` [s] from 0.
        dt: Between them.
        model: With the thrusters that gave it.
        times: Of the way-points, see `course.times_of`.
    """
    used = _used(thrust, dt, model)
    least = np.full(len(times), np.nan)
    for k, (begins, _, _, left) in enumerate(times):
        if np.isfinite(left):
            rows = slice(round(begins / dt), max(round(left / dt), round(begins / dt) + 1))
            least[k] = 1.0 - used[rows].max(initial=0.0)
    return least


def _used(thrust: Float[np.ndarray, "m n"], dt: float, model: Model) -> Float[np.ndarray, " m"]:
    """Share of its force that the most loaded thruster gives, over the WINDOW before."""
    low, high = (np.asarray(limit) for limit in force_limits(model.thrusters))
    limit = np.where(thrust >= 0.0, high, -low)
    share = np.where(limit > LEAST, np.abs(thrust) / np.maximum(limit, LEAST), 0.0)
    wide = max(round(WINDOW / dt), 1)
    total = np.concatenate([np.zeros((1, share.shape[1])), np.cumsum(share, axis=0)])
    ends = np.arange(1, len(share) + 1)
    begins = np.maximum(ends - wide, 0)
    return ((total[ends] - total[begins]) / (ends - begins)[:, None]).max(axis=1, initial=0.0)


@dataclass(frozen=True)
class Supply:
    """What a vehicle's file says of thrusters' power and batteries.

    Attributes:
        specific: c of P = c |F|^1.5 of each thruster, ahead and astern [W/N^1.5].
        sources: Its batteries; none where the file has none.
    """

    specific: Float[np.ndarray, "n 2"]
    sources: tuple[PowerSource, ...]

    @classmethod
    def of(cls, vehicle: Vehicle) -> "Supply":
        return cls(np.asarray(vehicle.specific_power()), tuple(vehicle.power_sources))

    def used(self, thrust: Float[np.ndarray, "m n"], dt: float) -> Float[np.ndarray, "m b"]:
        """Energy taken from each battery by each sample, loads beside the thrusters with it [J]; without a battery, by
        the thrusters alone, as if from one.

        Args:
            thrust: Force of each thruster [N], every `dt` [s].
            dt: Between them.
        """
        ahead, astern = as_array(self.specific[:, 0]), as_array(self.specific[:, 1])
        power = np.asarray(thruster_power(ahead, astern, as_array(thrust)))
        if not self.sources:
            return _summed(power.sum(axis=1, keepdims=True), dt)
        each = [power[:, list(one.feeds)].sum(axis=1) + one.hotel_load for one in self.sources]
        return _summed(np.column_stack(each), dt)

    def left(self, used: Float[np.ndarray, "... b"], charge: float) -> Float[np.ndarray, "..."] | None:
        """Share left in the emptiest battery after these energies [J] from a charge; None without one."""
        if not self.sources:
            return None
        capacity = 3600.0 * np.array([one.capacity_wh for one in self.sources])
        return (charge - used / capacity).min(axis=-1)


def _summed(power: Float[np.ndarray, "m b"], dt: float) -> Float[np.ndarray, "m b"]:
    """Energy until each sample [J], by the trapezoidal rule."""
    steps = 0.5 * dt * (power[1:] + power[:-1])
    return np.concatenate([np.zeros((1, power.shape[1])), np.cumsum(steps, axis=0)])
