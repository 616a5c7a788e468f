"""Scores of a run, as `docs/scenarios.md` defines them: from the truth, never from the estimate."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Real

from rovtwin.core.arrays.correlation import effective_samples
from rovtwin.core.arrays.rotations import heading_of, quaternion_from_euler, wrapped
from rovtwin.core.flow import FINISHED, GO, HOLD, PHASES, REASONS, TURN

SETTLED = 60.0  # NEES is averaged from here on [s]
STATION = 10.0  # holding counts as keeping a station from this long on [s]
DEPTH, NORTH_EAST = 2, slice(0, 2)
SAMPLED = (  # parts of a Flown with a row for each instant
    *("t", "eta", "nu", "eta_hat", "nu_hat", "covariance", "leg", "mode", "health", "reference", "setpoint", "tau"),
    *("bias", "water", "outside", "progress"),
)


class Failure(NamedTuple):
    """What of somebody else's gave what is no number, 1 and its place in a list, and when [s]."""

    code: int
    t: float


@dataclass(frozen=True)
class Flown:
    """One run on the host, sampled at n instants.

    Attributes:
        t: Time [s].
        eta, nu: Truth; attitude as zyx Euler angles.
        eta_hat, nu_hat: Estimate.
        covariance: Of [eta, nu].
        leg: Start and end of the leg.
        mode: phase, reason, waypoint, on_leg.
        thrust: Every control tick [N].
        control_dt: Period of `thrust` [s].
        saturated: Every control tick, whether any thruster was at its limit.
        duration: From arming to the end [s].
        energy: Taken from the batteries [J]; None where none are simulated.
        health: What each thruster gives, as the autopilot estimates it; None where unknown.
        reference: Pose that the controller was given; None where nobody kept it.
        setpoint: Pose that guidance asked for, tau: wrench that the controller asked for, bias: disturbance that the
            filter estimated (force in n, moment in b); None where nobody kept them.
        water: Velocity of the water at CO, n [m/s]; None where nobody knows it.
        outside: Wrench of waves, their drift and tethers at CO, b; None where nobody knows it.
        progress: One of core.flow.PROGRESS, as a number; None where nobody kept it.
        pose: Truth every control tick, as `eta`; None where nobody kept it.
        failed: The first part of the autopilot (of gnc.guard.PLACES) that gave what is no number; None: none did.
        broken_force: The first of the world's forces that did.
    """

    t: Float[np.ndarray, " n"]
    eta: Float[np.ndarray, "n 6"]
    nu: Float[np.ndarray, "n 6"]
    eta_hat: Float[np.ndarray, "n 6"]
    nu_hat: Float[np.ndarray, "n 6"]
    covariance: Float[np.ndarray, "n 12 12"]
    leg: Float[np.ndarray, "n 6"]
    mode: Float[np.ndarray, "n 4"]
    thrust: Float[np.ndarray, "m thrusters"]
    saturated: Bool[np.ndarray, " m"]
    control_dt: float
    duration: float
    energy: float | None = None
    health: Float[np.ndarray, "n thrusters"] | None = None
    reference: Float[np.ndarray, "n 6"] | None = None
    setpoint: Float[np.ndarray, "n 6"] | None = None
    tau: Float[np.ndarray, "n 6"] | None = None
    bias: Float[np.ndarray, "n 6"] | None = None
    water: Float[np.ndarray, "n 3"] | None = None
    outside: Float[np.ndarray, "n 6"] | None = None
    progress: Int[np.ndarray, " n"] | None = None
    pose: Float[np.ndarray, "m 6"] | None = None
    failed: Failure | None = None
    broken_force: Failure | None = None

    def during(self, start: float, end: float = np.inf) -> "Flown":
        """The instants from a start up to an end [s]; what is of every control tick stays whole."""
        first, last = np.searchsorted(self.t, [start - 1e-9, end - 1e-9])
        if first == 0 and last == len(self.t):
            return self
        parts = {name: getattr(self, name) for name in SAMPLED}
        return replace(self, **{name: part[first:last] for name, part in parts.items() if part is not None})


def headings(eta: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, " n"]:
    """What control holds of poses, `rotations.heading_of` and not psi [rad]."""
    return heading_of(quaternion_from_euler(eta[:, 3:]))


def finished(flown: Flown) -> bool:
    """Whether the mission came to its own end, whatever came after it."""
    return bool(np.any(flown.mode[:, 0] == FINISHED))


def distance_to_leg(position: Float[np.ndarray, "n _"], leg: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, " n"]:
    """Horizontal distance of points to their legs, the segments from start to end [m]."""
    start, end = leg[:, NORTH_EAST], leg[:, 3:5]
    along = end - start
    length2 = np.sum(along**2, axis=1)
    offset = position[:, NORTH_EAST] - start
    share = np.clip(np.sum(offset * along, axis=1) / np.where(length2 > 0, length2, 1.0), 0.0, 1.0)
    return np.hypot(*(offset - share[:, None] * along).T)


def after_first_dive(mode: Real[np.ndarray, "n 4"]) -> Bool[np.ndarray, " n"]:
    """Whether the first dive is over: from the first turn, leg, hold or finish on."""
    return np.logical_or.accumulate(np.isin(mode[:, 0], (TURN, GO, HOLD, FINISHED)))


def nees(flown: Flown) -> Float[np.ndarray, "n 2"]:
    """Normalised estimation error squared: horizontal position (2 dof), pose and velocity (12 dof).

    Bar-Shalom, Li and Kirubarajan (2001), eq. 5.4.2-1.
    """
    error = estimate_error(flown)
    both = [(error[:, :2], flown.covariance[:, :2, :2]), (error, flown.covariance)]
    return np.stack([_quadratic_form(e, P) for e, P in both], axis=1)


def _quadratic_form(error: Float[np.ndarray, "n k"], covariance: Float[np.ndarray, "n k k"]) -> Float[np.ndarray, " n"]:
    usable = np.all(np.isfinite(covariance), axis=(1, 2)) & np.all(np.isfinite(error), axis=1)
    out = np.full(len(error), np.inf)
    if usable.any():
        # A filter that is sure of a component (variance 0) would make P singular: the least positive number guards it.
        P = covariance[usable] + np.eye(error.shape[1]) * np.finfo(float).tiny
        solved = np.linalg.solve(P, error[usable][:, :, None])[:, :, 0]
        out[usable] = np.sum(error[usable] * solved, axis=1)
    return out


def estimate_error(flown: Flown) -> Float[np.ndarray, "n 12"]:
    """Estimate minus truth of [eta, nu], angles wrapped."""
    error = np.concatenate([flown.eta_hat - flown.eta, flown.nu_hat - flown.nu], axis=1)
    error[:, 3:6] = wrapped(error[:, 3:6])
    return error


def score(flown: Flown) -> dict[str, Any]:
    """Figures of one run; those of a phase that never came are None."""
    phase_of = flown.mode[:, 0].astype(int)
    settled = after_first_dive(flown.mode)
    legs = settled & (flown.mode[:, 3] > 0.5)
    station = settled & (flown.mode[:, 0] == HOLD)
    if np.sum(station) * np.median(np.diff(flown.t, prepend=0.0)) < STATION:
        station = np.zeros_like(station)  # passing a way-point holds for a tick; that is no station
    error = estimate_error(flown)
    position_nees = nees(flown)[:, 0]
    late = flown.t >= SETTLED
    return {
        **_ending(flown),
        **_pair("cross_track", distance_to_leg(flown.eta[legs], flown.leg[legs])),
        **_pair("station", np.hypot(*(flown.eta[station, :2] - flown.leg[station, 3:5]).T)),
        # On its way to another depth a vehicle is not at the depth it goes to: that is no error.
        "depth_rms_m": _rms((flown.eta[:, DEPTH] - flown.leg[:, 5])[settled & np.isin(phase_of, (TURN, GO, HOLD))]),
        "heading_rms_deg": _heading(flown, settled),
        "position_error_rms_m": [_rms(error[:, 0]), _rms(error[:, 1])],
        "nees_position_mean": _mean(position_nees[late]),
        "nees_effective_samples": effective_samples(position_nees[late]) if late.any() else None,
        **_tilt(flown),
        **_exertion(flown),
    }


def score_test(flown: Flown) -> dict[str, Any]:
    """Figures of an identification test, by the same names: it has no path to follow and no filter; those are None."""
    missing = ("cross_track_rms_m", "cross_track_max_m", "station_rms_m", "station_max_m", "depth_rms_m",
               "heading_rms_deg", "position_error_rms_m", "nees_position_mean", "nees_effective_samples")  # fmt: skip
    return {"test": True, **_ending(flown), **dict.fromkeys(missing), **_tilt(flown), **_exertion(flown)}


def _tilt(flown: Flown) -> dict[str, float]:
    """Largest roll and pitch of the whole run, either way, and the rms of both about their means [deg]."""
    roll, pitch = np.degrees(np.abs(flown.eta[:, 3:5]).max(axis=0))
    swing = np.degrees(np.sqrt(np.sum(np.var(flown.eta[:, 3:5], axis=0))))
    return {"roll_max_deg": float(roll), "pitch_max_deg": float(pitch), "attitude_rms_deg": float(swing)}


def _ending(flown: Flown) -> dict[str, Any]:
    phase = int(flown.mode[-1, 0])
    return {
        "completed": phase == FINISHED,
        "phase": PHASES[phase],
        "reason": REASONS[int(flown.mode[-1, 1])],
        "duration_s": flown.duration,
    }


def _exertion(flown: Flown) -> dict[str, Any]:
    rate = np.diff(flown.thrust, axis=0) / flown.control_dt
    return {
        "effort_n2s": float(np.sum(flown.thrust**2) * flown.control_dt),
        "energy_wh": None if flown.energy is None else flown.energy / 3600.0,
        "saturated_share": _mean(flown.saturated.astype(float)),
        "thruster_activity_n_per_s": _rms(rate),
    }


def _heading(flown: Flown, settled: Bool[np.ndarray, " n"]) -> float | None:
    if flown.reference is None:
        return None
    return _rms(np.degrees(wrapped(headings(flown.eta[settled]) - headings(flown.reference[settled]))))


def _pair(name: str, distance: Float[np.ndarray, " n"]) -> dict[str, float | None]:
    return {
        f"{name}_rms_m": _rms(distance),
        f"{name}_max_m": float(distance.max()) if distance.size else None,
    }


def _rms(values: Float[np.ndarray, "..."]) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _mean(values: Float[np.ndarray, " n"]) -> float | None:
    return float(np.mean(values)) if values.size else None


def nees_interval(scores: list[dict[str, Any]], level: float = 0.95, dof: int = 2) -> tuple[float, float]:
    """Interval that the mean NEES over these runs falls into with probability `level` if the filter is consistent.

    Chi-square with dof * N_eff degrees, N_eff the effective samples of all runs together (correlation in time widens
    it against independent samples). Bar-Shalom, Li and Kirubarajan (2001), sec. 5.4.2.
    """
    from scipy.special import gammaincinv

    samples = max(sum(s["nees_effective_samples"] or 1.0 for s in scores), 1.0)
    low, high = (
        2.0 * gammaincinv(dof * samples / 2.0, [(1 - level) / 2, (1 + level) / 2]) / samples
    )  # chi-square quantiles
    return float(low), float(high)
