"""Records cut into short segments of equal shape: what the compiled part of the estimate works on.

A grid of `step` seconds runs through every record; `steps` of them are a segment. At the start of each segment sits a
node, a state of its own that the estimate finds together with the parameters (multiple shooting: Bock 1983), so that a
long noisy log cannot diverge. Readings lie between grid points and are compared by linear interpolation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.rotations import quaternion_from_euler, rotation_from_euler
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.record import SIGNALS, Record, Signal
from rovtwin.identification.logs.smoothing import fitted, unwrapped
from rovtwin.vehicle.constants import FRESH_WATER, GRAVITY

EFFECTS = 5  # by which derivatives are taken beside theta, see `unmodelled`
_MOST = 4  # commands within one step of the grid


@dataclass(frozen=True)
class Grid:
    """How records are cut.

    Attributes:
        step: Of the integration [s].
        steps: In a segment.
        rate: Of the readings that are used, about [1/s].
        settling: For so long after a record has begun with a command its readings are not used [s]: what the thrusters
            gave before it is not known, and they are taken as settled at it. One wrong start would pass for a
            disturbance that the vehicle may have at any time, and all intervals would be wider.
    """

    step: float = 0.02
    steps: int = 250
    rate: float = 20.0
    settling: float = 0.0

    @property
    def span(self) -> float:
        """Of a segment [s]."""
        return self.step * self.steps


@dataclass(frozen=True, eq=False)
class Segments:
    """All segments of all records, padded to one shape; S segments of K steps, R_s readings of signal s.

    Attributes:
        grid: How they were cut.
        records: What they were cut from.
        arrays: For the compiled part: `command` (S, K, m, n), up to m of them one after the other in a step, and the
            share of the step that each is held, `held` (S, K, m); `fresh` (S, K) 1 where a record starts, `linked`
            (S,) 1 where the next segment continues this one, `current` (S, 3), `tether` (S,) paid-out length, `ballast`
            (S, k, 4) weight in water and place, `ballast_mass` (S, 6, 6); `effects` (S, K, 3, 6, C) wrenches at the
            start, middle and end of a step by which derivatives are taken beside theta, zero unless they are put there;
            per signal `row`, `share`, `value`, `used`.
        first: Index of the first segment of each record.
        sigma: Declared noise by signal; NaN where nobody said.
        levers: By signal.
    """

    grid: Grid
    records: tuple[Record, ...]
    arrays: dict[str, Any]
    first: tuple[int, ...]
    sigma: dict[str, Float[np.ndarray, " _"]]
    levers: dict[str, Float[np.ndarray, "3"]]

    @property
    def count(self) -> int:
        return len(self.arrays["linked"])

    @property
    def groups(self) -> list[tuple[str, int]]:
        """(signal, component) of everything measured, in the order of the compiled part."""
        return [(name, i) for name in self.levers for i in range(len(SIGNALS[name][0]))]

    def starts(self) -> Float[np.ndarray, " S"]:
        """Time at which each segment starts, in its record's clock [s]."""
        length = self.grid.span
        bounds = [*self.first, self.count]
        return np.concatenate(
            [r.start + length * np.arange(b - a) for r, a, b in zip(self.records, bounds, bounds[1:], strict=False)]
        )


@dataclass(eq=False)
class _Cut:
    """Segments of one record while they are collected."""

    command: Float[np.ndarray, "S K m n"]
    held: Float[np.ndarray, "S K m"]
    fresh: Float[np.ndarray, "S K"]
    linked: Float[np.ndarray, " S"]
    rows: dict[str, dict[str, list]] = field(default_factory=dict)


def cut(records: Sequence[Record], grid: Grid) -> Segments:
    """Segments of records.

    Raises:
        IdentificationError: A record is shorter than two steps, or records disagree about where a sensor sits.
    """
    names = [name for name in SIGNALS if any(name in r.signals for r in records)]
    levers, sigma = {}, {}
    for name in names:
        having = [r for r in records if name in r.signals]
        levers[name] = having[0].signals[name].lever
        if any(not np.allclose(r.signals[name].lever, levers[name]) for r in having):
            raise IdentificationError(f"{name}: records place this sensor differently; identify them apart")
        given = [r.signals[name].sigma for r in having]
        size = len(SIGNALS[name][0])
        known = [np.broadcast_to(s, size) for s in given if s is not None]
        sigma[name] = np.mean(known, axis=0) if known else np.full(size, np.nan)
    pieces = [_cut_one(record, names, grid) for record in records]
    counts = [len(p.linked) for p in pieces]
    arrays: dict[str, Any] = {
        **_of_one_size(pieces),
        "fresh": np.concatenate([p.fresh for p in pieces]),
        "linked": np.concatenate([p.linked for p in pieces]),
        "effects": np.zeros((sum(counts), grid.steps, 3, 6, EFFECTS)),
        "current": np.repeat([r.current for r in records], counts, axis=0),
        "tether": np.repeat([r.tether_length or 0.0 for r in records], counts),
        **_ballast(records, counts),
    }
    for name in names:
        arrays[name] = _padded([rows for p in pieces for rows in p.rows[name]["segments"]], len(SIGNALS[name][0]))
    if "attitude" in names:
        # As quaternions: Euler angles jump where a vehicle goes through the vertical.
        arrays["attitude"]["value"] = quaternion_from_euler(arrays["attitude"]["value"])
    first = tuple(int(i) for i in np.concatenate([[0], np.cumsum(counts)[:-1]]))
    return Segments(grid, tuple(records), arrays, first, sigma, levers)


def whole_steps(record: Record, step: float) -> int:
    """How many steps fit into a record."""
    return int((record.duration + 1e-9) / step)


def _cut_one(record: Record, names: Sequence[str], grid: Grid) -> _Cut:
    steps = whole_steps(record, grid.step)
    if steps < 2:
        raise IdentificationError(
            f"{record.source}: lasts {record.duration:.3g} s, expected at least {2 * grid.step} s"
        )
    count = -(-steps // grid.steps)
    edges = record.start + grid.step * np.arange(count * grid.steps + 1)
    command, held = (x.reshape(count, grid.steps, *x.shape[1:]) for x in _commands_within(record, edges))
    fresh = np.zeros((count, grid.steps))
    fresh[0, 0] = 1.0
    linked = np.ones(count)
    linked[-1] = 0.0
    out = _Cut(command, held, fresh, linked)
    used = record.start + _unsettled(record, grid.settling), record.start + steps * grid.step
    for name in names:
        out.rows[name] = {"segments": _rows(record.signals.get(name), record.start, used, count, grid, name)}
    return out


def _unsettled(record: Record, settling: float) -> float:
    """Seconds at the start of a record that tell nothing, a quarter of it at most."""
    return min(settling, 0.25 * record.duration) if np.any(record.command[0]) else 0.0


def _commands_within(
    record: Record, edges: Float[np.ndarray, " edges"]
) -> tuple[Float[np.ndarray, "N m n"], Float[np.ndarray, "N m"]]:
    """Commands within each of N steps, and the share of the step that each is held.

    They need not change where a step begins. Their forces are averaged, not they themselves: half of a thruster's
    command is a third of its force, and a mean command would bend its curve. Where more than _MOST change within one
    step of a record, each step is sampled _MOST times.
    """
    u = record.command
    new = np.concatenate([[True], np.any(np.diff(u, axis=0) != 0.0, axis=1)])
    t, u = record.t_command[new], u[new]
    first = np.clip(np.searchsorted(t, edges[:-1] + 1e-9, side="right") - 1, 0, len(t) - 1)
    last = np.maximum(np.searchsorted(t, edges[1:] - 1e-9, side="left") - 1, first)
    m = min(int((last - first).max()) + 1, _MOST)
    after = np.minimum(first[:, None] + np.arange(1, m), last[:, None] + 1)
    inside = after <= last[:, None]
    bounds = np.where(inside, t[np.minimum(after, len(t) - 1)], edges[1:, None])
    bounds = np.concatenate([edges[:-1, None], bounds, edges[1:, None]], axis=1)
    many = last - first >= m
    bounds[many] = np.linspace(edges[:-1][many], edges[1:][many], m + 1, axis=1)
    row = np.searchsorted(t, 0.5 * (bounds[:, :-1] + bounds[:, 1:]) + 1e-9, side="right") - 1
    return u[np.clip(row, 0, len(t) - 1)], np.diff(bounds, axis=1) / np.diff(edges)[:, None]


def _of_one_size(pieces: Sequence[_Cut]) -> dict[str, np.ndarray]:
    """Commands of all records with as many in a step as any record has; those that are made up are held for no time."""
    most = max(p.held.shape[2] for p in pieces)

    def padded(x: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        return np.pad(x, [(0, most - n if axis == 2 else 0) for axis, n in enumerate(x.shape)])

    return {key: np.concatenate([padded(getattr(p, key)) for p in pieces]) for key in ("command", "held")}


def _rows(
    signal: Signal | None, start: float, used: tuple[float, float], count: int, grid: Grid, name: str
) -> list[tuple]:
    """Per segment: grid row, share of the way to the next one, value; of the readings between two times."""
    size = len(SIGNALS[name][0])
    if signal is None:
        return [(np.zeros(0, int), np.zeros(0), np.zeros((0, size)))] * count
    keep = (signal.t >= used[0] - 1e-9) & (signal.t <= used[1] + 1e-9)
    t, value = signal.t[keep], signal.value[keep]
    t, value = _thinned(t, value, start, grid)
    place = np.clip((t - start) / grid.step, 0.0, None)
    place = np.where(np.abs(place - np.round(place)) < 1e-6, np.round(place), place)
    row = np.minimum(place.astype(int), count * grid.steps - 1)
    segment = row // grid.steps
    return [
        (row[segment == s] - s * grid.steps, (place - row)[segment == s], value[segment == s]) for s in range(count)
    ]


def _thinned(
    t: Float[np.ndarray, " n"], value: Float[np.ndarray, "n k"], start: float, grid: Grid
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m k"]]:
    """About `rate` readings a second, never twice that, those nearest to the grid: interpolation costs them least."""
    if len(t) < 2:
        return t, value
    every = int(np.floor((len(t) - 1) / max(t[-1] - t[0], 1e-9) / grid.rate + 1e-6))
    if every < 2:
        return t, value
    whole = len(t) // every * every
    place = (t[:whole] - start) / grid.step
    off = np.abs(place - np.round(place)).reshape(-1, every)
    pick = np.argmin(np.round(off, 3), axis=1) + every * np.arange(whole // every)
    return t[pick], value[pick]


def _padded(rows: list[tuple], size: int) -> dict[str, np.ndarray]:
    longest = max(1, max(len(r) for r, _, _ in rows))
    shape = (len(rows), longest)
    out = {"row": np.zeros(shape, int), "share": np.zeros(shape), "value": np.zeros((*shape, size))}
    out["used"] = np.zeros(shape)
    for s, (row, share, value) in enumerate(rows):
        n = len(row)
        out["row"][s, :n], out["share"][s, :n], out["value"][s, :n], out["used"][s, :n] = row, share, value, 1.0
    return out


def _ballast(records: Sequence[Record], counts: Sequence[int]) -> dict[str, np.ndarray]:
    """Known pieces as a wrench's ingredients (weight in water, place) and as a mass matrix at CO; absent if none."""
    if not any(r.ballast for r in records):
        return {}
    most = max(len(r.ballast) for r in records)
    pieces, masses = np.zeros((len(records), most, 4)), np.zeros((len(records), 6, 6))
    for i, record in enumerate(records):
        density = record.water_density or FRESH_WATER
        for j, piece in enumerate(record.ballast):
            x, y, z = piece.position
            pieces[i, j] = [GRAVITY * (piece.mass - density * piece.volume), x, y, z]
            S = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            H = np.concatenate([np.eye(3), -S], axis=1)
            masses[i] += piece.mass * H.T @ H
    return {"ballast": np.repeat(pieces, counts, axis=0), "ballast_mass": np.repeat(masses, counts, axis=0)}


def nodes_from_data(
    segments: Segments, offsets: dict[str, np.ndarray] | None = None, exact: bool = False
) -> dict[str, np.ndarray]:
    """The state at every node as far as it is measured: position, attitude (quaternion), nu.

    Args:
        segments: With the readings.
        offsets: Constant errors of the sensors by signal, to be taken off.
        exact: Take rates and velocities at the instant, not smoothed; an attitude is its nearest reading anyway.
    """
    position, euler, nu = [], [], []
    bounds = [*segments.first, segments.count]
    starts = segments.starts()
    for record, a, b in zip(segments.records, bounds, bounds[1:], strict=False):
        p, e, v = _guess(record, starts[a:b], offsets or {}, exact)
        position.append(p)
        euler.append(e)
        nu.append(v)
    attitude = quaternion_from_euler(np.concatenate(euler))
    return {"position": np.concatenate(position), "attitude": attitude, "nu": np.concatenate(nu)}


# Seconds of readings that a guess of the state is taken through, by how noisy and how quick they are.
_WIDTH = {"position": 1.0, "horizontal": 1.0, "depth": 0.6, "attitude": 0.3, "gyro": 0.2, "velocity": 0.3}


def _guess(
    record: Record, t: Float[np.ndarray, " n"], offsets: dict[str, np.ndarray], exact: bool
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, "n 6"]]:
    n = len(t)
    position, velocity, euler, nu = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 6))

    def at(name: str) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
        signal = record.signals[name]
        value, slope = fitted(signal, t, _WIDTH[name])
        if exact and name in ("gyro", "velocity"):
            value = np.stack([np.interp(t, signal.t, column) for column in signal.value.T], axis=1)
        return value - offsets.get(name, 0.0), slope

    if "attitude" in record.signals:
        # The nearest reading: between two of them Euler angles may jump, at the vertical.
        signal = record.signals["attitude"]
        nearest = np.clip(np.searchsorted(signal.t, t), 1, len(signal.t) - 1) if len(signal.t) > 1 else np.zeros(n, int)
        nearest -= (t - signal.t[nearest - 1]) < (signal.t[nearest] - t)
        euler = signal.value[nearest] - offsets.get("attitude", 0.0)
        nu[:, 3:] = fitted(unwrapped(signal), t, _WIDTH["attitude"])[1]
    if "gyro" in record.signals:
        nu[:, 3:], _ = at("gyro")
    R, arm = rotation_from_euler(euler), np.zeros((n, 3))
    for name, columns in (("horizontal", [0, 1]), ("depth", [2]), ("position", [0, 1, 2])):
        if name in record.signals:
            lever = record.signals[name].lever
            value, velocity[:, columns] = at(name)
            position[:, columns] = value - (R @ lever)[:, columns]
            arm = lever if name != "depth" else arm
    if "velocity" in record.signals:
        nu[:, :3], arm = at("velocity")[0], record.signals["velocity"].lever
    else:
        nu[:, :3] = np.einsum("nji,nj->ni", R, velocity)
    nu[:, :3] -= np.cross(nu[:, 3:], arm)
    return position, euler, nu
