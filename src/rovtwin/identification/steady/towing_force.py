"""The force record of a tow before anything is read off it: a low-pass that makes sense, and the tare."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import signal

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.steady.towing_files import TowRun
from rovtwin.identification.steady.windows import BLOCKS, Window


def lowpass(
    t: Float[np.ndarray, " n"], x: Float[np.ndarray, " n"], cutoff: float, name: str = "record"
) -> Float[np.ndarray, " n"]:
    """Zero-phase low-pass: a second-order Butterworth forwards and backwards, -6 dB at the cut-off.

    Args:
        t: Times, evenly spaced but for a few missing readings [s].
        x: Readings.
        cutoff: [Hz].
        name: For messages.

    Raises:
        IdentificationError: A cut-off that this sample rate cannot have.
    """
    rate = 1.0 / float(np.median(np.diff(t)))
    if not 0 < cutoff < 0.5 * rate:
        raise IdentificationError(
            f"{name}: a low-pass of {cutoff:g} Hz on {rate:.4g} readings per second, which hold nothing above "
            f"{rate / 2:.4g} Hz: it would filter nothing. Expected about 1 to 5 Hz"
        )
    even = np.linspace(t[0], t[-1], round((t[-1] - t[0]) * rate) + 1)
    sections = signal.butter(2, cutoff, fs=rate, output="sos")
    reach = min(len(even) - 1, int(3 * rate / cutoff))
    return np.interp(t, even, signal.sosfiltfilt(sections, np.interp(even, t, x), padlen=reach))


def sensible_cutoff(runs: Sequence[TowRun], cutoff: float | None, shortest: float) -> tuple[float, list[str]]:
    """The cut-off, and whether it makes sense: between what a window needs and what the motion can have."""
    resolved = BLOCKS / (2 * shortest)
    slowest = min(run.rate for run in runs)
    if cutoff is None:
        return min(resolved, 0.2 * slowest), []
    if cutoff > 10 * resolved:
        return cutoff, [
            f"a low-pass of {cutoff:g} Hz lets through what a tow cannot have: windows of {shortest:g} s need nothing "
            f"above {resolved:.3g} Hz; the rest is noise and the rig's own vibration"
        ]
    if cutoff < 0.5 * resolved:
        return cutoff, [
            f"a low-pass of {cutoff:g} Hz smears the start of the tow into windows of {shortest:g} s; expected about "
            f"{resolved:.3g} Hz, or longer windows"
        ]
    return cutoff, []


@dataclass(frozen=True)
class Tare:
    """Force at rest, along a straight line between the rests before and after [N]."""

    t: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    std: float

    def at(self, t: float) -> float:
        return float(np.interp(t, self.t, self.force))


def tares_of(runs: Sequence[TowRun], windows: list[list[Window]], given: float | None) -> tuple[list[Tare], list[str]]:
    """The tare of each run, given or from its own rests, and what there is to say of it."""
    if given is not None:
        return [Tare(np.zeros(1), np.full(1, given), 0.0)] * len(runs), []
    own = [[w for w in found if w.rest] for found in windows]
    known = [w.force for rests in own for w in rests]
    if not known:
        nothing = (
            "no part of any run at rest and no tare given: an offset of the force sensors is in the linear damping"
        )
        return [Tare(np.zeros(1), np.zeros(1), 0.0)] * len(runs), [nothing]
    notes, tares = [], []
    spread = float(np.std(known, ddof=1)) if len(known) > 1 else 0.0
    for run, rests in zip(runs, own, strict=True):
        if not rests:
            notes.append(f"run {run.name}: never at rest; the tare is the mean of the other runs', +- {spread:.2g} N")
            tares.append(Tare(np.zeros(1), np.full(1, np.mean(known)), spread))
            continue
        force, std = np.array([w.force for w in rests]), float(np.mean([w.force_std for w in rests]))
        if np.ptp(force) > max(4 * std, 0.05 * np.ptp(run.force)):
            notes.append(f"run {run.name}: the tare drifts by {np.ptp(force):.2g} N; taken along a straight line")
        tares.append(Tare(np.array([(w.start + w.end) / 2 for w in rests]), force, std))
    return tares, notes
