"""Velocities through the water, b, from what a test logged: smoothed positions, depth, heading or a DVL."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.identification.steady.smoother import FEWEST, Track, smooth

STEP = 0.1  # of the grid on which velocities are given [s]
NU = ("surge", "sway", "heave", "yaw")
AXES, ANGLES = ("north", "east", "down"), ("phi", "theta", "psi")


@dataclass(frozen=True, eq=False)
class Motion:
    """Smoothed motion of one test.

    Attributes:
        record: Its name.
        t: Grid of times [s].
        velocity: Through the water, b, by direction of NU where it was measured [m/s, rad/s]; NaN in gaps.
        std: Standard deviations of them.
        attitude: Euler angles [rad]; zero where they were not measured, NaN in gaps.
        tracks: Smoothed components by name: north, east, down, phi, theta, psi; those that were measured.
        notes: Outliers and gaps, a line each.
    """

    record: str
    t: Float[np.ndarray, " m"]
    velocity: Mapping[str, Float[np.ndarray, " m"]]
    std: Mapping[str, Float[np.ndarray, " m"]]
    attitude: Float[np.ndarray, "m 3"]
    tracks: Mapping[str, Track]
    notes: tuple[str, ...]

    def nu(self) -> Float[np.ndarray, "m 6"]:
        """All six velocities, zero where one was not measured; p, q as rates of small roll and pitch."""
        out = np.zeros((len(self.t), 6))
        for name, column in (("surge", 0), ("sway", 1), ("heave", 2), ("yaw", 5)):
            if name in self.velocity:
                out[:, column] = self.velocity[name]
        for name, column in (("phi", 3), ("theta", 4)):
            if name in self.tracks:
                out[:, column] = self.tracks[name].velocity(self.t)
        return np.nan_to_num(out)

    def mean(self, dof: str, inside: Bool[np.ndarray, " m"]) -> tuple[float, float]:
        """Mean velocity over some of the grid, and its standard deviation by the smoother's own covariance."""
        t, count = self.t[inside], int(inside.sum())
        value = float(np.mean(self.velocity[dof][inside]))
        if dof == "yaw":
            return value, float(np.sqrt(self.tracks["psi"].weighted_velocity(t, np.full(count, 1 / count))[1]))
        R = rotation_from_euler(self.attitude[inside])[:, :, NU.index(dof)] / count
        parts = [self.tracks[n].weighted_velocity(t, R[:, i])[1] for i, n in enumerate(AXES) if n in self.tracks]
        if parts:
            return value, float(np.sqrt(sum(parts)))
        # A DVL's velocity, smoothed as if it were a position: its errors last about a second.
        spread = float(np.mean(self.std[dof][inside] ** 2))
        return value, float(np.sqrt(spread / max(t[-1] - t[0], 1.0)))


def motion_of(record: Record) -> Motion:
    """Smooth every signal of a record and turn the velocities into b.

    Without attitude the vehicle is taken as level, and horizontal positions cannot be turned into b: only heave comes
    out.

    Raises:
        IdentificationError: Nothing in the record gives a velocity, or too few readings.
    """
    t = np.arange(record.start, record.end, STEP)
    notes: list[str] = []
    angles = _angles(record, notes)
    attitude = np.zeros((len(t), 3))
    for i, track in enumerate(angles):
        attitude[:, i] = track.position(t)
    tracks = _over_ground(record, angles, notes)
    rates = {AXES.index(name): track.velocity(t) for name, track in tracks.items()}
    stds = {AXES.index(name): track.velocity_std(t) for name, track in tracks.items()}
    velocity, std = _in_body(record, rates, stds, attitude, bool(angles))
    if angles:
        velocity["yaw"], std["yaw"] = angles[2].velocity(t), angles[2].velocity_std(t)
        tracks |= zip(ANGLES, angles, strict=True)
    for i, name in enumerate(("surge", "sway", "heave")):
        if name not in velocity and (signal := record.signals.get("velocity")) is not None and len(signal.t) >= FEWEST:
            track = smooth(signal.t, signal.value[:, i], name=f"{record.source}: velocity {name}")
            velocity[name], std[name] = track.position(t), track.position_std(t)
    if not velocity:
        raise IdentificationError(
            f"{record.source}: found {', '.join(record.signals)}, from which no velocity comes; expected depth, "
            "attitude, positions with attitude, or velocity"
        )
    return Motion(record.name, t, velocity, std, attitude, tracks, tuple(notes))


def _angles(record: Record, notes: list[str]) -> list[Track]:
    signal = record.signals.get("attitude")
    if signal is None or len(signal.t) < FEWEST:
        return []
    return [_track(record, signal, i, name, notes, angle=True) for i, name in enumerate(ANGLES)]


def _over_ground(record: Record, angles: list[Track], notes: list[str]) -> dict[str, Track]:
    """Positions of CO, n, smoothed, by name of the axis."""
    tracks = {}
    for kind, axes in (("position", (0, 1, 2)), ("horizontal", (0, 1)), ("depth", (2,))):
        signal = record.signals.get(kind)
        if signal is None or len(signal.t) < FEWEST:
            continue
        signal = _at_origin(signal, axes, angles)
        for column, axis in enumerate(axes):
            # Depth from pressure is far better than that of a positioning system: it comes last and stays.
            tracks[AXES[axis]] = _track(record, signal, column, AXES[axis], notes)
    return tracks


def _track(record: Record, signal: Signal, column: int, name: str, notes: list[str], angle: bool = False) -> Track:
    track = smooth(signal.t, signal.value[:, column], angle=angle, name=f"{record.source}: {name}")
    if track.left_out:
        notes.append(f"{record.name}: {track.left_out} readings of {name} left out (outliers, scraps between gaps)")
    gaps = len(track.spans) - 1
    if gaps:
        lost = sum(b[0] - a[1] for a, b in zip(track.spans[:-1], track.spans[1:], strict=True))
        notes.append(
            f"{record.name}: {name} has {gaps} gap{'s' * (gaps > 1)}, {lost:.1f} s in all; nothing is used there"
        )
    return track


def _at_origin(signal: Signal, axes: tuple[int, ...], angles: list[Track]) -> Signal:
    """Positions of CO instead of the sensor's place."""
    if not np.any(signal.lever) or not angles:
        return signal
    attitude = np.stack([track.position(signal.t) for track in angles], axis=1)
    known = np.isfinite(attitude).all(axis=1)
    arm = np.einsum("nij,j->ni", rotation_from_euler(attitude[known]), signal.lever)[:, list(axes)]
    return Signal(signal.t[known], signal.value[known] - arm, signal.sigma)


def _in_body(
    record: Record,
    rates: dict[int, Float[np.ndarray, " m"]],
    stds: dict[int, Float[np.ndarray, " m"]],
    attitude: Float[np.ndarray, "m 3"],
    turned: bool,
) -> tuple[dict[str, Float[np.ndarray, " m"]], dict[str, Float[np.ndarray, " m"]]]:
    """What can be turned into b: all three axes, or heave alone of a vehicle taken as level."""
    if len(rates) == 3 and turned:
        water = np.stack([rates[i] - record.current[i] for i in range(3)], axis=1)
        R = rotation_from_euler(attitude)
        v = np.einsum("nij,ni->nj", R, water)
        s = np.sqrt(np.einsum("nij,ni->nj", R**2, np.stack([stds[i] for i in range(3)], axis=1) ** 2))
        return {name: v[:, i] for i, name in enumerate(NU[:3])}, {name: s[:, i] for i, name in enumerate(NU[:3])}
    if 0 in rates and 1 in rates and turned:  # no depth: held, so the motion is level
        down = np.zeros_like(rates[0])
        with_depth = ({**rates, 2: down + record.current[2]}, {**stds, 2: down})
        v, s = _in_body(record, *with_depth, attitude, turned)
        return {name: v[name] for name in NU[:2]}, {name: s[name] for name in NU[:2]}
    if 2 in rates:
        return {"heave": rates[2] - record.current[2]}, {"heave": stds[2]}
    return {}, {}
