"""How many parameters: a ladder of structures, climbed as long as predictions of what was not fitted get better.

Each rung adds a group of parameters to those that were kept; what is not free stays at the starting value. A rung is
judged by cross-validation over blocks of time: every log is cut into blocks, half of them are fitted and the other half
predicted in open loop, then the other way round. It is kept where the predictions get better by more than chance may
make of the differences between the blocks (Student's t, one-sided, SURE), and by more than MARGIN; else it is left out,
and the next one is tried without it. Intervals of what is kept hold if what was left out is what it was taken for.

Reference: Ljung (1999), System Identification (cross-validation).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.config import near
from rovtwin.identification.diagnostics.validation import Prediction, judged
from rovtwin.identification.joint.model.catalogue import with_inflow
from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import INFLOW, Parameters
from rovtwin.identification.logs.record import Record

LADDER = {
    "linear": "added mass, linear damping, restoring, thrusters' forces, each direction for itself; gyro's mounting",
    "quadratic": "quadratic damping",
    "astern": "damping of its own astern",
    "thrusters": "shape of the thrust curve, dead band, lag and delay of thrusters",
    "symmetric": "couplings that a hull has which is alike to port and starboard",
    "full": "all other couplings",
    "inflow": "thrust that an inflow takes",
}
ALL, CHOSEN = "full", "auto"
WITH_INFLOW = (CHOSEN, "inflow")  # ways to choose that may free it
BLOCKS = 4  # of each log, where it is long enough
SHORTEST = 8.0  # block [s]
SURE = 0.9  # that a gain is one
LEAST_BLOCKS = 4  # from which differences between blocks tell anything
MARGIN = 0.01  # least decrease of the logarithm of the prediction error
LENGTHWISE = frozenset({0, 2, 4})  # surge, heave, pitch: what a symmetric hull does not couple with the others

Progress = Callable[[str], None]
"""Called with words for who waits."""
Predicted = Callable[[Sequence[str], str], list[Prediction]]
"""Free parameters, and words for who waits -> predictions of all blocks, each by what was fitted to others."""


@dataclass(frozen=True)
class Rung:
    """A step of the ladder.

    Attributes:
        name: Of LADDER.
        added: Names of its parameters.
        change: Of the logarithm of the rms prediction error with it, mean over blocks; negative is better. Of the first
            rung it is that against predicting with the starting values.
        std: Standard error of that.
        kept: Whether its parameters are free.
    """

    name: str
    added: tuple[str, ...]
    change: float
    std: float
    kept: bool


def rung_of(name: str) -> str:
    """The rung of LADDER on which a parameter comes in."""
    family, _, where = name.partition(".")
    at = place_of(name)
    if at is not None:
        return "symmetric" if len(LENGTHWISE & set(at)) != 1 else "full"
    if family.endswith("_astern"):
        return "astern"
    if family == "quadratic_damping":
        return "quadratic"
    if family == "commands":
        return "thrusters"
    if where.endswith(f".{INFLOW}"):
        return "inflow"
    if family == "thrusters" and not where.rpartition(".")[2].startswith("force"):
        return "thrusters"
    return "linear"


def restricted(parameters: Parameters, start: Gaussian, free: Sequence[str]) -> tuple[Parameters, Gaussian]:
    """The parameters that are free, and what is known of them; the others are held at what is most likely before."""
    rows = [i for i, p in enumerate(parameters.free) if p.name in set(free)]
    held = np.array(start.mean, dtype=float)
    held[rows] = 0.0
    kept = tuple(parameters.free[i] for i in rows)
    some = Parameters(with_inflow(parameters.model_at(held)[0], kept), kept, parameters.groups)
    return some, Gaussian(start.mean[rows], start.covariance[np.ix_(rows, rows)])


def up_to(name: str, free: Sequence[str]) -> list[str]:
    """Of the parameters those of a rung and all below it.

    Raises:
        IdentificationError: There is no such rung.
    """
    rungs = list(LADDER)
    if name not in rungs:
        known = [CHOSEN, *rungs]
        raise IdentificationError(f"structure: found '{name}', expected one of {', '.join(known)}.{near(name, known)}")
    return [p for p in free if rungs.index(rung_of(p)) <= rungs.index(name)]


def climbed(free: Sequence[str], predicted: Predicted) -> tuple[list[str], list[Rung]]:
    """The parameters that are worth their freedom, and how the ladder was climbed.

    Args:
        free: All that may be free.
        predicted: Fits and predicts, always the same blocks in the same order.
    """
    errors = errors_of(predicted([], "starting values"))
    kept: list[str] = []
    rungs: list[Rung] = []
    for name in LADDER:
        added = [p for p in free if rung_of(p) == name]
        if not added:
            continue
        tried = [p for p in free if p in kept or p in added]
        now = errors_of(predicted(tried, name))
        change, std = change_between(now, errors)
        # Something has to be free, also where the starting values predict as well.
        keep = not kept or change < -max(float(t.ppf(SURE, len({block for block, _ in now}) - 1)) * std, MARGIN)
        rungs.append(Rung(name, tuple(added), change, std, keep))
        if keep:
            kept, errors = tried, now
    return kept, rungs


def folds(
    records: Sequence[Record], option: str = "structure", off: str = "full"
) -> list[tuple[list[Record], list[Record]]]:
    """Two divisions of the records into parts to fit and parts to predict.

    Args:
        records: Of the tests.
        option: Whose choice it is, for messages, and
        off: its value for none.

    Raises:
        IdentificationError: They are too short.
    """
    parts: tuple[list[Record], list[Record]] = ([], [])
    for k, record in enumerate(records):
        count = min(BLOCKS, int(record.duration / SHORTEST))
        if count < 2:
            parts[k % 2].append(record)
            continue
        ends = np.linspace(record.start, record.end, count + 1)
        for i, (start, end) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
            parts[(i + k) % 2].append(record.cut(float(start), float(end)))
    if len(parts[0]) + len(parts[1]) < LEAST_BLOCKS or not parts[0] or not parts[1]:
        raise IdentificationError(
            f"{option}: found {sum(r.duration for r in records):.0f} s of tests, expected {LEAST_BLOCKS} tests, or "
            f"blocks of at least {SHORTEST:g} s, to fit some and predict the others; or choose: --{option} {off}"
        )
    return [(parts[0], parts[1]), (parts[1], parts[0])]


def lines_about(rungs: Sequence[Rung]) -> list[str]:
    """The ladder in words."""
    lines = []
    for rung in rungs:
        what = f"structure '{rung.name}' ({LADDER[rung.name]}; {len(rung.added)} parameters)"
        if np.isfinite(rung.change):
            times = np.exp(rung.change)
            change = f"{100.0 * (times - 1.0):+.1f} % +- {100.0 * rung.std * times:.1f}"
            how = f"changes the error of predicted blocks by {change}"
        else:
            how = f"makes predictions {'follow the motion where they ran away' if rung.change < 0 else 'run away'}"
        lines.append(f"{what} {how}: {'kept' if rung.kept else 'left at the starting values'}")
    if any(not rung.kept for rung in rungs):
        lines.append("intervals take what was left at the starting values for exact")
    return lines


def errors_of(predictions: Sequence[Prediction]) -> dict[tuple[int, str], float]:
    """Logarithm of the rms prediction error, by block and component."""
    found = {}
    for i, one in enumerate(predictions):
        for component in judged(one):
            rms = one.scores[component].rms
            found[i, component] = float(np.log(rms)) if np.isfinite(rms) and rms > 0.0 else np.inf
    return found


def change_between(now: dict[tuple[int, str], float], before: dict[tuple[int, str], float]) -> tuple[float, float]:
    """Mean change over the blocks, each the mean of its components, and its standard error.

    Infinite where more predictions run away than before, or fewer.
    """
    blocks: dict[int, list[float]] = {}
    for key in before.keys() & now.keys():
        blocks.setdefault(key[0], []).append(now[key] - before[key])
    means = np.array([np.mean(changes) for changes in blocks.values()])
    if np.isnan(means).any():  # both ran away: no difference
        means = np.nan_to_num(means, nan=0.0, posinf=np.inf, neginf=-np.inf)
    if not np.isfinite(means).all():
        worse, better = np.isposinf(means).sum(), np.isneginf(means).sum()
        return (np.inf if worse >= better else -np.inf), 0.0
    return float(means.mean()), float(means.std(ddof=1) / np.sqrt(len(means)))
