"""Signals against each other: gyro with attitude, velocity with position, depth with the rest.

No model is needed but to tell which of two signals is late.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from rovtwin.core.arrays.rotations import wrapped
from rovtwin.identification.checks.clocks import Lag, check_clocks
from rovtwin.identification.checks.findings import Finding
from rovtwin.identification.logs.motion import STEP, Motion, widened
from rovtwin.identification.logs.record import SIGNALS, Record
from rovtwin.vehicle.physics.model import Model

LONGEST_LAG, SMALLEST_LAG = 3.0, 0.15  # [s] searched; [s] that counts
ALIKE, UNLIKE = 0.8, 0.4  # correlations
APART = 1.6  # ratio of sizes
SLIPS = {57.3: "degrees", 1000.0: "millimetres", 100.0: "units", 9.81: "units"}


@dataclass(frozen=True, eq=False)
class Pair:
    """The same quantities from two signals: `names`, values a and b, and how noisy each is.

    `in_world` is what b would be in n, where a mistake of a's frame would leave it; `from_body` is a in n, and
    `rotation` is R_nb, through which they are compared.
    """

    names: tuple[str, str]
    axes: tuple[str, ...]
    a: Float[np.ndarray, "m k"]
    b: Float[np.ndarray, "m k"]
    noise: tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]
    in_world: Float[np.ndarray, "m k"] | None = None
    from_body: Float[np.ndarray, "m k"] | None = None
    rotation: Float[np.ndarray, "m 3 3"] | None = None


def pairs(motion: Motion) -> list[Pair]:
    """What can be compared in this record, each two signals through the same kernel."""
    found = []
    alike = motion.alike("gyro", "attitude")
    gyro, from_attitude = alike.values("gyro"), alike.rate_of_attitude
    if gyro is not None and from_attitude is not None:
        noise = (_noise(alike, "gyro", False), _noise(alike, "attitude", True))
        found.append(Pair(("gyro", "attitude"), SIGNALS["gyro"][0], gyro[0], from_attitude, noise))
    alike = motion.alike("velocity", "position", "attitude")
    velocity, from_position = alike.values("velocity"), alike.rate_of_position
    if velocity is not None and from_position is not None:
        noise = (_noise(alike, "velocity", False), _noise(alike, "position", True))
        position = alike.values("position")
        assert position is not None and alike.rotation is not None
        turned = np.einsum("nij,nj->ni", alike.rotation, velocity[0])
        names, axes = ("velocity", "position"), SIGNALS["velocity"][0]
        found.append(Pair(names, axes, velocity[0], from_position, noise, position[1], turned, alike.rotation))
    return found + _pairs_of_depth(motion)


def _pairs_of_depth(motion: Motion) -> list[Pair]:
    found = []
    alike = motion.alike("depth", "position")
    depth, position = alike.values("depth"), alike.values("position")
    if depth is not None and position is not None:
        noise = (_noise(alike, "depth", True), _noise(alike, "position", True)[2:])
        found.append(Pair(("depth", "position"), ("down",), depth[1], position[1][:, 2:], noise))
    alike = motion.alike("depth", "velocity", "attitude")
    depth, velocity, rotation = alike.values("depth"), alike.values("velocity"), alike.rotation
    if depth is not None and position is None and velocity is not None and rotation is not None:
        down = np.einsum("ni,ni->n", rotation[:, 2], velocity[0])[:, None]
        noise = (_noise(alike, "depth", True), np.array([_noise(alike, "velocity", False).max()]))
        found.append(Pair(("depth", "velocity"), ("down",), depth[1], down, noise))
    return found


def _noise(motion: Motion, name: str, of_rate: bool) -> Float[np.ndarray, " k"]:
    """Standard deviation that noise of the readings leaves in the smoothed value or in its rate."""
    signal, known = motion.record.signals[name], motion.values(name)
    assert known is not None
    at = np.clip(np.round((signal.t - motion.t[0]) / STEP).astype(int), 0, len(motion.t) - 1)
    left = signal.value - known[0][at] - (signal.t - motion.t[at])[:, None] * known[1][at]
    if name == "attitude":
        left = wrapped(left)
    spread = 1.4826 * np.nanmedian(np.abs(left), axis=0)
    interval = float(np.median(np.diff(signal.t)))
    width = widened(signal.t, motion.width)
    per_value = np.sqrt(interval / (2 * np.sqrt(np.pi) * width))
    return spread * (per_value / (np.sqrt(2) * width) if of_rate else per_value)


def check_motion(model: Model, motion: Motion) -> list[Finding]:
    """Clock, axes, signs, units and agreement of every pair; which of two is late, the commands tell."""
    found, late = [], False
    for pair in pairs(motion):
        good = _both(pair)
        if good.sum() < 100:
            continue
        if lag_of(pair):
            late = True
        else:
            found += _check(pair, good)
    return found + (check_clocks(model, motion.record, lags_of) if late else [])


def lags_of(record: Record) -> list[Lag]:
    """Of pairs that disagree in time."""
    seen = [pair for pair in pairs(Motion.of(record)) if _both(pair).sum() >= 100]
    return [lag for pair in seen if (lag := lag_of(pair))]


def lag_of(pair: Pair) -> Lag | None:
    """Which of a pair is late against the other; None where neither is, or they agree no better so.

    Velocity and position are compared through the attitude. The one of three that agrees best is taken: in b, as if
    the attitude were on the clock of the position; in n, as if on that of the velocity; or both agree, and it is late.
    """
    first, second = pair.names
    tried = [(first, second, *best_lag(pair.a, pair.b))]
    if pair.in_world is not None and pair.from_body is not None and pair.rotation is not None:
        tried.append((first, second, *best_lag(pair.from_body, pair.in_world)))
        lag, gained, agreement = _rotation_late(pair.a, pair.in_world, pair.rotation)
        tried.append(("attitude", first, lag, gained, agreement))
    late, against, lag, gained, _ = max(tried, key=lambda way: way[4])
    return Lag(late, against, lag) if abs(lag) > SMALLEST_LAG and gained > 0.1 else None


def _rotation_late(
    a: Float[np.ndarray, "m 3"], in_world: Float[np.ndarray, "m 3"], R: Float[np.ndarray, "m 3 3"]
) -> tuple[float, float, float]:
    """By how much R_nb is late against a in b and the same in n [s]; how much better they agree then, and how well."""
    agreement, steps = [], _steps(len(a))
    for step in steps:
        late, now = (
            (slice(step, None), slice(None, len(a) - step)) if step >= 0 else (slice(None, step), slice(-step, None))
        )
        turned = np.einsum("nji,nj->ni", R[late], in_world[now])
        good = np.isfinite(turned).all(axis=1) & np.isfinite(a[now]).all(axis=1)
        x, y = a[now][good] - a[now][good].mean(axis=0), turned[good] - turned[good].mean(axis=0)
        alike = float((x * y).sum()) / max(float(np.sqrt((x**2).sum() * (y**2).sum())), 1e-12)
        agreement.append(max(alike, 0.0) ** 2)
    best = int(np.argmax(agreement))
    return float(steps[best] * STEP), agreement[best] - agreement[int(np.argmin(np.abs(steps)))], agreement[best]


def _steps(length: int) -> Int[np.ndarray, " lags"]:
    """Lags that are tried, in steps of the grid."""
    steps = np.arange(-int(LONGEST_LAG / STEP), int(LONGEST_LAG / STEP) + 1, 2)
    return steps[np.abs(steps) < length // 3]


def _both(pair: Pair) -> Bool[np.ndarray, " m"]:
    return np.asarray(np.isfinite(np.column_stack([pair.a, pair.b])).all(axis=1))


def _check(pair: Pair, good: Bool[np.ndarray, " m"]) -> list[Finding]:
    a, b = pair.a[good] - pair.a[good].mean(axis=0), pair.b[good] - pair.b[good].mean(axis=0)
    if pair.in_world is not None and _agreement(a, pair.in_world[good]) > 0.8 > _agreement(a, b) + 0.1:
        text = "velocity is the rate of position in n; expected it in b, forward, right, down."
        return [Finding("error", "frame", "velocity", text, "Turn it into b with the attitude, or leave it out.")]
    size_a, size_b = a.std(axis=0), b.std(axis=0)
    seen = (size_a > 4 * pair.noise[0]) & (size_b > 4 * pair.noise[1]) & (size_a > 1e-6) & (size_b > 1e-6)
    alike = (a.T @ b) / len(a) / np.outer(size_a + 1e-12, size_b + 1e-12)
    return _swapped(pair, alike, seen) or _signs(pair, alike, seen) or _sizes(pair, alike, seen, size_a, size_b)


def _agreement(a: Float[np.ndarray, "*axes"], b: Float[np.ndarray, "*axes"]) -> float:
    """Share of a that is b, 1 where they are equal."""
    return 1.0 - float(((a - b + b.mean(axis=0)) ** 2).sum() / max((a**2).sum(), 1e-12))


def best_lag(a: Float[np.ndarray, "m k"], b: Float[np.ndarray, "m k"]) -> tuple[float, float, float]:
    """By how much a is late against b [s], whatever axes and signs, how much better they agree there, and how well.

    Agreement at a lag is the share of a's power that the columns of b explain together.
    """
    a, b = (np.where(np.isfinite(x), x - np.nanmean(x, axis=0), 0.0) for x in (a, b))
    agreement, steps = [], _steps(len(a))
    for step in steps:
        late, early = (a[step:], b[: len(b) - step]) if step >= 0 else (a[:step], b[-step:])
        gram = early.T @ early + 1e-9 * np.trace(early.T @ early) * np.eye(b.shape[1]) + 1e-12 * np.eye(b.shape[1])
        cross = early.T @ late
        explained = np.einsum("ij,ij->j", cross, np.linalg.solve(gram, cross))
        agreement.append(explained.sum() / max((late**2).sum(), 1e-12))
    best = int(np.argmax(agreement))
    most = float(agreement[best])
    return float(steps[best] * STEP), most - float(agreement[int(np.argmin(np.abs(steps)))]), most


def _swapped(pair: Pair, alike: Float[np.ndarray, "k k"], seen: Bool[np.ndarray, " k"]) -> list[Finding]:
    if len(pair.axes) < 2 or seen.sum() < 2:
        return []
    rows, columns = linear_sum_assignment(-np.abs(alike))
    for i, k in zip(rows, columns, strict=True):
        if i != k and seen[i] and abs(alike[i, k]) > 0.6 and abs(alike[i, k]) > abs(alike[i, i]) + 0.3:
            first, second = pair.names
            text = (
                f"{pair.axes[i]} of {first} follows {pair.axes[k]} of {second} (correlation {alike[i, k]:.2f}), not "
                f"{pair.axes[i]} ({alike[i, i]:.2f}): axes are swapped."
            )
            return [Finding("error", "swapped", first, text, "Put the columns into the order of the components.")]
    return []


def _signs(pair: Pair, alike: Float[np.ndarray, "k k"], seen: Bool[np.ndarray, " k"]) -> list[Finding]:
    own = np.diag(alike)
    wrong = [i for i in range(len(own)) if seen[i] and own[i] < -0.6]
    if not wrong:
        return []
    first, second = pair.names
    names = [pair.axes[i] for i in wrong]
    others = [i for i in range(len(own)) if seen[i] and i not in wrong]
    if first == "depth" or (0 not in wrong and {1, 2} & set(wrong) and all(i == 0 for i in others)):
        text = f"{', '.join(names)} of {first} and {second} run against each other: one has z up instead of down."
        fix = "Write frame: flu (body), nwu or enu (world) or up (depth) for the one that has."
        return [Finding("error", "z_up", first, text, fix)]
    text = f"{', '.join(names)} of {first} runs against {second} (correlation {own[wrong[0]]:.2f}): wrong sign."
    return [Finding("error", "sign", first, text, "Check frame and mounting_deg of both.")]


def _sizes(
    pair: Pair,
    alike: Float[np.ndarray, "k k"],
    seen: Bool[np.ndarray, " k"],
    size_a: Float[np.ndarray, " k"],
    size_b: Float[np.ndarray, " k"],
) -> list[Finding]:
    own, found = np.diag(alike), []
    first, second = pair.names
    ratio = size_a / np.maximum(size_b, 1e-12)
    sure = seen & (own > ALIKE)
    if sure.any():
        middle = float(np.median(ratio[sure]))
        for slip, what in SLIPS.items():
            larger = middle if middle > 1 else 1 / middle
            if abs(np.log(larger / slip)) < 0.25:
                name = first if middle > 1 else second
                text = f"{first} is {middle:.4g} times what {second} says, a slip of units ({slip:g})."
                fix = f"Check the unit of {name}: {'deg or deg/s' if what == 'degrees' else 'mm, cm, g'}?"
                return [Finding("error", what, first, text, fix)]
        if not 1 / APART < middle < APART:
            text = f"{first} is {middle:.2f} times what {second} says."
            return [Finding("error", "disagree", first, text, "Check the scale of both.")]
    apart = [i for i in range(len(own)) if seen[i] and own[i] < UNLIKE and size_a[i] > 0.3 * size_a.max()]
    if apart:
        names = ", ".join(pair.axes[i] for i in apart)
        text = f"{names} of {first} and {second} disagree (correlation {own[apart[0]]:.2f})."
        fix = "Check frames (body or world?), units and levers of both."
        found.append(Finding("error" if len(apart) > 1 else "warning", "disagree", first, text, fix))
    return found
