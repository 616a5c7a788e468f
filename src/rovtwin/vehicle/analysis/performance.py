"""What a vehicle can do on one axis at a time: top speed, stopping, coasting, the steady current it holds.

The axis alone, v > 0 along the direction, other velocities zero:

    M_ii v_dot = X(t) + c - (d_l + d_q v) v

X is the thrust along the direction, c what weight and buoyancy add in heave, M_ii of M_RB + M_A, d the diagonal of the
damping ahead or astern. What the thrusters do on other axes is not balanced, and no thrust is kept back for holding
course or depth: these are limits, not what an autopilot reaches.

- Top speed: drag = thrust, in closed form. In a steady uniform current only the velocity through the water counts, so
  it is also the largest current on the axis in which the vehicle keeps its place. Thrust is that at rest (bollard);
  real thrusters lose some in an inflow.
- Stopping: at top speed the command goes to full reverse; thrust follows by each thruster's lag and rate limit, and the
  equation is integrated until v = 0 (scipy's DOP853, relative tolerance 1e-9).
- Coasting: the command goes to zero; integrated until a tenth of the top speed is left. Linear drag alone never ends.

Reference: Fossen (2021), ch. 6.5 (decoupled equations of motion), 9 (thrusters).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import as_array
from rovtwin.core.programs.values import once_and_for_all
from rovtwin.vehicle.analysis.stability import steady_speed
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force

# Axis of nu and names of the directions, positive first.
DIRECTIONS = {
    "surge": (0, ("ahead", "astern")),
    "sway": (1, ("starboard", "port")),
    "heave": (2, ("down", "up")),
    "yaw": (5, ("starboard", "port")),
}
COASTED = 0.1  # share of the top speed at which coasting ends
_LONGEST = 1e5  # [s]


@dataclass(frozen=True)
class AxisPerformance:
    """In one direction of one axis; distances are angles in yaw. NaN: it never comes to that.

    Attributes:
        force: Largest steady force, thrust and net buoyancy together [N or N m].
        top_speed: Where drag balances it [m/s or rad/s]; 0 where it pushes the other way, inf without drag.
        stopping_distance: From top speed to rest under full reverse thrust [m or rad].
        stopping_time: The same [s].
        coasting_distance: From top speed to a tenth of it without thrust [m or rad].
        coasting_time: The same [s].
    """

    force: float
    top_speed: float
    stopping_distance: float
    stopping_time: float
    coasting_distance: float
    coasting_time: float


@once_and_for_all
def performance(model: Model) -> dict[str, dict[str, AxisPerformance]]:
    """By axis and direction, as `DIRECTIONS` names them."""
    net = float(model.weight) - float(model.buoyancy)
    return {
        axis: {
            direction: _ability(model, i, sign, sign * net if axis == "heave" else 0.0)
            for direction, sign in zip(directions, (1.0, -1.0), strict=True)
        }
        for axis, (i, directions) in DIRECTIONS.items()
    }


def _ability(model: Model, axis: int, sign: float, constant: float) -> AxisPerformance:
    """With `constant` [N] acting along the direction besides the thrusters."""
    lever = sign * np.asarray(model.thrusters.configuration)[axis]
    most, least = _forces(model, np.sign(lever)), _forces(model, -np.sign(lever))
    force = float(lever @ most) + constant
    speed = steady_speed(model, axis, sign * force) if force > 0 else 0.0
    if not 0 < speed < np.inf:
        rest = 0.0 if speed == 0 else np.nan
        return AxisPerformance(force, speed, rest, rest, rest, rest)

    def run(command: Float[np.ndarray, " n"], until: float) -> tuple[float, float]:
        thrust = _thrust(model, lever, most, command)
        if _settles_at(model, axis, sign, float(lever @ command) + constant) >= until:
            return np.nan, np.nan
        return _way(model, axis, sign, lambda t: thrust(t) + constant, speed, until)

    return AxisPerformance(force, speed, *run(least, 0.0), *run(np.zeros_like(most), COASTED * speed))


def _forces(model: Model, command: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Steady force of each thruster at a command [N]."""
    return np.asarray(static_force(model.thrusters, as_array(command)), dtype=float)


def _settles_at(model: Model, axis: int, sign: float, force: float) -> float:
    """Speed along the direction that a constant force leads to; -inf when it pushes back."""
    return steady_speed(model, axis, sign * force) if force >= 0 else -np.inf


def _thrust(
    model: Model, lever: Float[np.ndarray, " n"], start: Float[np.ndarray, " n"], target: Float[np.ndarray, " n"]
) -> Callable[[float], float]:
    """Thrust along the axis [N] over time [s], from steady forces towards others: what `thrusters.lag` does in steps.

    A thruster first ramps at its rate limit, as long as its lag would ask for more, then closes in exponentially.
    """
    tau, rate = np.asarray(model.thrusters.time_constant), np.asarray(model.thrusters.rate_limit)
    change = target - start
    # inf x 0: neither rate limit nor lag, so nothing is left for the ramp.
    within = np.where(np.isinf(rate), np.inf, np.where(np.isinf(rate), 0.0, rate) * tau)
    left = np.minimum(np.abs(change), within)
    ramp = (np.abs(change) - left) / rate
    slow = np.where(tau > 0, tau, 1.0)

    def thrust(t: float) -> float:
        closing = np.where(tau > 0, np.exp(-np.maximum(t - ramp, 0.0) / slow), 0.0)
        missing = np.where(t < ramp, np.abs(change) - np.where(t < ramp, rate, 0.0) * t, left * closing)
        return float(lever @ (target - np.sign(change) * missing))

    return thrust


def _way(
    model: Model, axis: int, sign: float, force: Callable[[float], float], speed: float, until: float
) -> tuple[float, float]:
    """Distance and time in which a speed falls to another under a force over time."""
    from scipy.integrate import solve_ivp

    side = "ahead" if sign > 0 else "astern"
    linear = float(np.asarray(getattr(model, f"linear_damping_{side}"))[axis, axis])
    quadratic = float(np.asarray(getattr(model, f"quadratic_damping_{side}"))[axis, axis])
    mass = float(np.asarray(model.inertia)[axis, axis])

    def rate(t: float, x: Sequence[float] | np.ndarray) -> tuple[float, float]:
        v = float(x[1])
        return v, (force(t) - (linear + quadratic * abs(v)) * v) / mass

    def slow(t: float, x: Sequence[float] | np.ndarray) -> float:
        return float(x[1]) - until

    slow.terminal, slow.direction = True, -1.0  # type: ignore[attr-defined]  (as scipy wants them)
    found = solve_ivp(rate, (0.0, _LONGEST), (0.0, speed), "DOP853", events=slow, rtol=1e-9, atol=1e-12 * speed)
    if not found.t_events[0].size:
        return np.nan, np.nan
    return float(found.y_events[0][0][0]), float(found.t_events[0][0])
