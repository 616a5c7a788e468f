"""Added mass and thrust of one direction with NSGA-II, as the thesis used it (2.7, 2.20, 3.8.2, 3.12.2, 8.1).

Damping is fixed beforehand, and the mean absolute error of one record is minimised (Deb et al. 2002, IEEE Transactions
on Evolutionary Computation 6(2); through pymoo). Kept for comparison: whatever is wrong in damping and thrust goes into
the added mass, and there is no covariance. The mean is of absolute errors, as in (2.20); a signed mean as printed in
(8.1) is 0 for a wrong value too.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Real

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require

STEP = 0.02  # longest step of RK4 [s]
AT_BOUND = 0.005  # share of the range from a bound within which a value is on it


@dataclass(frozen=True, eq=False)
class OneDirection:
    """A record of one direction under constant thrust.

    Attributes:
        t: Times from the start of the thrust [s], increasing.
        y: Position [m or rad] or velocity [m/s or rad/s], from rest at t[0].
        quantity: "position" or "velocity".
        mass: Rigid-body mass or inertia [kg or kg m2].
        linear: D_L, held [N s/m or N m s/rad].
        quadratic: D_Q, held [N s2/m2 or N m s2/rad2].
        source: For messages.
    """

    t: Float[np.ndarray, " n"]
    y: Float[np.ndarray, " n"]
    quantity: str
    mass: float
    linear: float
    quadratic: float
    source: str = "record"


@dataclass(frozen=True, eq=False)
class NsgaFit:
    """What the search found.

    Attributes:
        added_mass: [kg or kg m2].
        thrust: [N or N m].
        objective: Mean absolute error, in units of the record.
        fitted: The model's record.
        generations: How many were run.
        on_bound: Names of parameters that lie on a bound of their range: there the data asked for more.
        notes: What a reader must know.
    """

    added_mass: float
    thrust: float
    objective: float
    fitted: Float[np.ndarray, " n"]
    generations: int
    on_bound: tuple[str, ...]
    notes: tuple[str, ...]


def fit_nsga(
    record: OneDirection,
    added_mass: tuple[float, float],
    thrust: tuple[float, float],
    *,
    population: int = 40,
    generations: int = 60,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> NsgaFit:
    """Search added mass and thrust within bounds.

    Args:
        record: What was measured.
        added_mass: Lowest and highest [kg or kg m2].
        thrust: Lowest and highest [N or N m]; equal: held.
        population: Members of a generation.
        generations: How many.
        seed: The same seed gives the same result.
        progress: Called with (generation, generations).

    Raises:
        IdentificationError: pymoo is missing, bounds or record make no sense.
    """
    require("pymoo", "nsga", "NSGA-II", IdentificationError)
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.callback import Callback
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    _check(record, added_mass, thrust)
    held = thrust[0] == thrust[1]
    low = np.array([added_mass[0]] if held else [added_mass[0], thrust[0]])
    high = np.array([added_mass[1]] if held else [added_mass[1], thrust[1]])

    class SingleDirection(Problem):
        def __init__(self) -> None:
            super().__init__(n_var=len(low), n_obj=1, xl=low, xu=high)

        def _evaluate(self, x, out, *_args, **_kwargs) -> None:
            force = np.full(len(x), thrust[0]) if held else x[:, 1]
            out["F"] = np.abs(simulate(record, x[:, 0], force) - record.y).mean(axis=1)

    class Tell(Callback):
        def notify(self, algorithm) -> None:
            if progress is not None:
                progress(int(algorithm.n_gen or 0), generations)

    found = minimize(
        SingleDirection(), NSGA2(pop_size=population), ("n_gen", generations), seed=seed, callback=Tell(), verbose=False
    )
    best = np.atleast_2d(np.asarray(found.X, float))[0]
    force = thrust[0] if held else float(best[1])
    values = {"added mass": (float(best[0]), *added_mass)} | ({} if held else {"thrust": (force, *thrust)})
    on_bound = tuple(name for name, value in values.items() if is_on_bound(*value))
    notes = [f"{n}: {values[n][0]:.4g} is on the bound of {values[n][1]:g} to {values[n][2]:g}: the data asked for more"
             for n in on_bound]  # fmt: skip
    fitted = simulate(record, np.array([best[0]]), np.array([force]))[0]
    return NsgaFit(
        float(best[0]), force, float(np.abs(fitted - record.y).mean()), fitted, generations, on_bound, tuple(notes)
    )


def is_on_bound(value: float, low: float, high: float) -> bool:
    """Whether a value lies so near to an end of its range that it would have gone further."""
    if not np.isfinite(high):
        return value <= low
    return min(value - low, high - value) <= AT_BOUND * (high - low)


def simulate(
    record: OneDirection, added_mass: Real[np.ndarray, " k"], thrust: Real[np.ndarray, " k"]
) -> Float[np.ndarray, "k n"]:
    """(m + m_a) v' = thrust - D_L v - D_Q |v| v from rest, for k candidates at once, by RK4.

    Args:
        record: Its times, mass, damping and quantity.
        added_mass: Of each candidate.
        thrust: Of each.

    Returns:
        Position from y[0], or velocity, at the record's times.
    """
    t, total = record.t, record.mass + added_mass
    steps = max(int(np.ceil((t[-1] - t[0]) / STEP)), 1)
    h = float(t[-1] - t[0]) / steps
    v = np.zeros_like(total)
    speeds = np.zeros((steps + 1, len(total)))

    def rate(v: Float[np.ndarray, " k"]) -> Float[np.ndarray, " k"]:
        return (thrust - record.linear * v - record.quadratic * np.abs(v) * v) / total

    for i in range(steps):
        k1 = rate(v)
        k2 = rate(v + h / 2 * k1)
        k3 = rate(v + h / 2 * k2)
        v = v + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(v + h * k3))
        speeds[i + 1] = v
    grid = t[0] + h * np.arange(steps + 1)
    if record.quantity == "position":
        moved = np.concatenate([np.zeros((1, len(total))), np.cumsum((speeds[1:] + speeds[:-1]) * h / 2, axis=0)])
        return record.y[0] + np.stack([np.interp(t, grid, one) for one in moved.T])
    return np.stack([np.interp(t, grid, one) for one in speeds.T])


def _check(record: OneDirection, added_mass: tuple[float, float], thrust: tuple[float, float]) -> None:
    where = record.source
    if record.quantity not in ("position", "velocity"):
        raise IdentificationError(f"{where}: quantity is {record.quantity!r}, expected position or velocity")
    if record.t.shape != record.y.shape or len(record.t) < 5 or not np.isfinite(record.y).all():
        raise IdentificationError(
            f"{where}: found {record.t.size} times and {record.y.size} values, expected 5 or more pairs"
        )
    if (np.diff(record.t) <= 0).any():
        raise IdentificationError(f"{where}: time must increase")
    for name, (low, high), closed in (("added mass", added_mass, False), ("thrust", thrust, True)):
        if not (np.isfinite([low, high]).all() and (low <= high if closed else low < high)):
            raise IdentificationError(
                f"{where}: {name} from {low:g} to {high:g}, expected a finite range, lowest first"
            )
    if record.mass + added_mass[0] <= 0:
        raise IdentificationError(f"{where}: mass {record.mass:g} with added mass {added_mass[0]:g} is not positive")
