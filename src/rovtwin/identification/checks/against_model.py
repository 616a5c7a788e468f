"""Accelerations against what the thrusters push: clocks, signs, swapped columns, frames, slips of units, clipping."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.identification.checks.clocks import LAGS, all_behind, slipped_rows
from rovtwin.identification.checks.findings import Finding
from rovtwin.identification.logs.motion import Motion
from rovtwin.identification.logs.response import AXES, Regression, Response, thruster_forces
from rovtwin.vehicle.physics.model import Model

LATE = 0.25  # [s]; less may be the lag of the thrusters
BLIND_LATE = 0.7  # [s], where the attitude is not known
JUDGED = 0.2  # share of an axis' acceleration that thrusters must explain before it is judged
BETTER = 0.15  # how much more of it a mistake must explain than none
CONVINCING = 0.7  # share that a mistake must explain at all
AGREED = 0.25  # by how much the best lag of an axis may differ from that of all [s]
ALIKE = 0.02  # shares that differ by less say the same
NAMES = {"u": "surge", "v": "sway", "w": "heave", "p": "roll", "q": "pitch", "r": "yaw"}


@dataclass(frozen=True, eq=False)
class Suspect:
    """A mistake that is tried: what it is, where, the fix, and the rows by which forces act if it was made."""

    what: str
    where: str
    text: str
    fix: str
    rows: Float[np.ndarray, "a n"]


def check_response(model: Model, motion: Motion) -> list[Finding]:
    """What does not fit between commands and motion; nothing where the motion is too small to tell.

    Without both an attitude and a measured rate, restoring moments are taken for thrust now and then: only warnings.
    Nor is more than a warning to be had from commands that were read more rarely than LATE.
    """
    found = _check_response(model, motion)
    if (motion.record.command_interval or 0.0) > LATE:
        return [
            replace(f, severity="warning", fix=f"{f.fix} Commands were read so rarely that this may be wrong.")
            for f in found
        ]
    if motion.rotation is not None and {"gyro", "velocity"} & set(motion.record.signals):
        return found
    return [replace(f, severity="warning", fix=f"{f.fix} With so few signals this may be wrong.") for f in found]


def _check_response(model: Model, motion: Motion) -> list[Finding]:
    regression = Regression.of(model, motion)
    if regression is None:
        return []
    lag, found = _late(model, motion, regression)
    force = thruster_forces(model, motion, lag)
    answer = regression.against(force)
    judged = (answer.explainable > JUDGED) & _pushed(answer)
    if not judged.any():
        return found
    wrong = _mistaken(answer, judged, motion.record.command.shape[1])
    found += wrong or _slips(answer, judged)
    return found + ([] if wrong else _cut_off(model, motion, regression, lag, judged))


def _pushed(answer: Response) -> Bool[np.ndarray, " a"]:
    """Axes on which the expected forces act at all."""
    size = np.einsum("an,anm,am->a", answer.expected, answer.gram, answer.expected)
    return size > 1e-6 * np.einsum("an,ann->a", answer.expected**2, answer.gram) + 1e-12


def _late(model: Model, motion: Motion, regression: Regression) -> tuple[float, list[Finding]]:
    """The lag of the commands at which forces explain most, whatever their signs and order, if it is large."""
    table = np.array([regression.against(thruster_forces(model, motion, lag)).explainable for lag in LAGS])
    explained = table.max(axis=0) > JUDGED
    if not explained.any():
        return 0.0, []
    score = table[:, explained].mean(axis=1)
    best, now = int(np.argmax(score)), int(np.argmin(np.abs(LAGS)))
    lag = float(LAGS[best])
    # A clock moves all axes alike: what only the motion of one explains, or what has no end within the search, is none.
    own = LAGS[table.argmax(axis=0)]
    alike = explained & (np.abs(own - lag) <= AGREED) & (np.abs(own) < LAGS[-1])
    if 2 * alike.sum() <= explained.sum():
        return 0.0, []
    score = table[:, alike].mean(axis=1)
    # Without an attitude the restoring moments are not known, and look like thrust that is late.
    blind = motion.rotation is None
    # Nor without a velocity what the water does to the turning of a vehicle that moves.
    least = 0.5 if blind else CONVINCING if motion.velocity is None else 0.0
    if abs(lag) < (BLIND_LATE if blind else LATE) or score[best] < max(score[now] + 0.15, least):
        return 0.0, []
    shares = float(score[best]), float(score[now])
    rows = slipped_rows(model, motion, regression, explained, float(table[best, explained].mean()))
    return lag, [all_behind(motion.record, lag, shares, rows)]


def _total(answer: Response, rows: Float[np.ndarray, "a n"], judged: Bool[np.ndarray, " a"]) -> float:
    """Mean share of what can be explained that these rows explain, with positive gains only."""
    share, gain = answer.explained(rows)
    return float(np.mean(np.where(gain > 0, share, 0.0)[judged] / answer.explainable[judged]))


def _mistaken(answer: Response, judged: Bool[np.ndarray, " a"], thrusters: int) -> list[Finding]:
    """The one mistake that explains the motion much better than none; the simpler one where two do equally."""
    now = _total(answer, answer.expected, judged)
    if now > 1.0 - BETTER:
        return []
    best, most = None, max(now + BETTER, CONVINCING)
    tried = [(s, _total(answer, s.rows, judged)) for s in _suspects(answer, judged, thrusters)]
    for suspect, share in tried:
        if share > most + (ALIKE if best is not None else 0.0):
            best, most = suspect, share
    if best is None:
        return []
    # Two equal thrusters, one on either side: motion shows only that the vehicle turns the other way.
    alike = [s.text for s, share in tried if s is not best and s.where.startswith("thrusters") and share > most - ALIKE]
    text = ", or ".join([best.text, *alike])
    text += f" (that explains {most:.0%} of what thrusters do to the motion, as written {max(now, 0):.0%})."
    return [Finding("error", best.what, best.where, text, best.fix)]


def _suspects(answer: Response, judged: Bool[np.ndarray, " a"], thrusters: int) -> Iterator[Suspect]:
    rows, axes = answer.expected, [AXES[i] for i in answer.axes]
    if judged.sum() > 1:  # one axis alone is a sign of its own
        yield Suspect("sign", "commands", "all commands have the wrong sign", "Turn their sign.", -rows)
    turned = np.array([-1.0 if axis in "vwqr" else 1.0 for axis in axes])[:, None]
    if (turned[judged] < 0).sum() > 1:
        text = "the motion is that of a body with z up and y to port instead of z down"
        fix = "Write frame: flu for body vectors, nwu or enu for the attitude."
        yield Suspect("z_up", "signals", text, fix, turned * rows)
    for i, axis in enumerate(axes):
        flip = np.ones((len(axes), 1))
        flip[i] = -1.0
        text = f"{NAMES[axis]} answers with the wrong sign"
        yield Suspect(
            "sign", NAMES[axis], text, f"Check the sign of {axis}, or of the commands that drive it.", flip * rows
        )
    for i in range(thrusters):
        flip = np.ones(thrusters)
        flip[i] = -1.0
        text = f"thruster {i + 1} pushes the other way"
        yield Suspect("sign", f"thruster {i + 1}", text, "Turn the sign of its command or its direction.", rows * flip)
    for i, k in ((a, b) for a in range(len(axes)) for b in range(a) if answer.axes[a] // 3 == answer.axes[b] // 3):
        order = np.arange(len(axes))
        order[[i, k]] = k, i
        text = f"{axes[k]} and {axes[i]} are swapped"
        yield Suspect("swapped", f"{axes[k]}, {axes[i]}", text, "Put the columns in order.", rows[order])
    for i, k in ((a, b) for a in range(thrusters) for b in range(a)):
        order = np.arange(thrusters)
        order[[i, k]] = k, i
        text = f"commands of thrusters {k + 1} and {i + 1} are swapped"
        yield Suspect("swapped", f"thrusters {k + 1}, {i + 1}", text, "Put the columns in order.", rows[:, order])


def _slips(answer: Response, judged: Bool[np.ndarray, " a"]) -> list[Finding]:
    """Accelerations too large or too small by a slip of units; no model is wrong by that much."""
    gain, angular = np.abs(answer.explained(answer.expected)[1]), np.array(answer.axes) > 2
    found = []
    for axes, low, high, what, unit in (
        (judged & angular, 20.0, 200.0, "degrees", "degrees: deg or deg/s"),
        (judged & ~angular, 200.0, 5000.0, "millimetres", "millimetres: mm or mm/s"),
    ):
        if not axes.any():
            continue
        middle = float(np.median(gain[axes]))
        if low < middle < high or low < 1 / max(middle, 1e-9) < high:
            text = f"the vehicle answers {middle:.3g} times as much as its model says: it looks like {unit}."
            found.append(Finding("error", what, "angular" if what == "degrees" else "linear", text, "Check the unit."))
    return found


def _cut_off(
    model: Model, motion: Motion, regression: Regression, lag: float, judged: Bool[np.ndarray, " a"]
) -> list[Finding]:
    """Thrust that stops growing below the largest command: forces of cut commands explain the motion far better."""

    def unexplained(shape: float | None, limit: float = np.inf) -> float:
        force = thruster_forces(model, motion, lag, shape, limit)
        return float(1.0 - regression.against(force).explainable[judged].mean())

    largest = float(np.abs(motion.record.command).max())
    plain = min(unexplained(shape) for shape in (None, 1.0, 1.5, 2.0, 0.7))
    limits = largest * np.arange(0.3, 0.91, 0.1)
    # Of every shape, so that a wrong curve is not taken for a limit.
    tried = {(limit, shape): unexplained(shape, limit) for limit in limits for shape in (None, 1.0, 2.0)}
    (limit, _), left = min(tried.items(), key=lambda item: item[1])
    if left > 0.6 * plain or plain < 0.01:
        return []
    text = (
        f"thrust stops growing at a command of about {limit:.2f}, though commands reach {largest:.2f}: clipped on the "
        "way to the thrusters."
    )
    return [Finding("warning", "clipped", "commands", text, "Log what the thrusters get; check limits and voltage.")]
