"""Towing: force and speed records of a carriage to damping in one direction (thesis, ch. 4).

    record -> low-pass -> steady windows -> less tare and rig -> F = d_l v + d_q |v| v, ahead and astern apart

At constant speed drag is all that is left to hold the vehicle back. The thesis says a low-pass of '500 Hz', no tare and
no rig, and takes a heave stroke of 0.15 m for steady drag: here each of them is done, or called out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.steady.damping_fit import ONE_PAIR, DampingFit, fit_damping
from rovtwin.identification.steady.towing_files import TowRun
from rovtwin.identification.steady.towing_force import Tare, lowpass, sensible_cutoff, tares_of
from rovtwin.identification.steady.windows import Window, steady_windows, window_over

REST = 0.003  # speed of a carriage that stands [m/s]
# Widths travelled before drag is steady. Behind a body set going from rest the force overshoots while the first
# vortices grow, about 2 widths on, and settles after some 5 (Sarpkaya 1966, AIAA Journal 4, 414, circular cylinder).
WIDTHS = 5.0
BLUFF = 2.2  # largest steady C_D of a box on the area it shows (long square section; Hoerner 1965, ch. 3)


@dataclass(frozen=True)
class Pull:
    """One steady window of one run.

    Attributes:
        run: Its name.
        window: Where in the run; its force has tare and rig still in it.
        speed: Mean [m/s].
        force: Net mean force on the vehicle, sign of the speed [N].
        std: Standard deviation of that mean, tare's included [N].
        tare: What was subtracted as tare [N].
        rig: What was subtracted as the rig's drag [N].
        travelled: From where the motion began to the start of the window [m].
        stroke: From where the motion began to the end of the window [m].
        used: Whether the fit uses it.
    """

    run: str
    window: Window
    speed: float
    force: float
    std: float
    tare: float
    rig: float
    travelled: float
    stroke: float
    used: bool = True


@dataclass(frozen=True, eq=False)
class Towing:
    """What the tows say.

    Attributes:
        runs: As given, the force turned to the sign of the speed where it was logged against it.
        filtered: Force of each run after the low-pass, for looking at [N].
        cutoff: Of the low-pass [Hz].
        pulls: Every steady window under way.
        fit: Damping; ahead and astern apart where both were towed at two speeds at least.
        width: Of the body across the motion [m], or None where nobody said.
        drag_coefficient: On the area across the motion, at the largest speed; None where the area is unknown.
        notes: What a reader must know.
    """

    runs: tuple[TowRun, ...]
    filtered: tuple[np.ndarray, ...]
    cutoff: float
    pulls: tuple[Pull, ...]
    fit: DampingFit
    width: float | None
    drag_coefficient: float | None
    notes: tuple[str, ...]


def towing(
    runs: Sequence[TowRun],
    *,
    cutoff: float | None = None,
    shortest: float = 2.0,
    tare: float | None = None,
    rig: DampingFit | None = None,
    across: tuple[float, float] | None = None,
    density: float = 1000.0,
    nonnegative: bool = True,
) -> Towing:
    """Damping from tows in one direction.

    Args:
        runs: Tows of one vehicle in one direction, ahead and astern.
        cutoff: Of the zero-phase low-pass [Hz]; None takes the fastest that the steady test can see, half a period in
            one of its blocks.
        shortest: Duration of the shortest steady window [s].
        tare: Force of the sensors at rest [N]; None takes it from the parts of each run in which the carriage stands.
        rig: Drag of the rig towed alone, as `towing(rig_runs).fit`; None leaves it in the vehicle's, and says so.
        across: Two sizes of the body across the motion [m]; they say whether the strokes were long enough.
        density: Of the water [kg/m3]; only for the drag coefficient.
        nonnegative: See `fit_damping`.

    Raises:
        IdentificationError: No steady window, a sign that was lost, a cut-off that the record cannot have.
    """
    if not runs:
        raise IdentificationError("towing: no runs; give at least one record with columns t,speed,force")
    for what, value in (
        ("cutoff", cutoff),
        ("shortest", shortest),
        ("across", None if across is None else min(across)),
    ):
        if value is not None and not value > 0:
            raise IdentificationError(f"towing: {what} is {value:g}, expected more than 0")
    notes: list[str] = []
    cutoff, remarks = sensible_cutoff(runs, cutoff, shortest)
    notes += remarks
    filtered = [lowpass(run.t, run.force, cutoff, run.source) for run in runs]
    windows = [
        steady_windows(
            run.t,
            lowpass(run.t, run.speed, cutoff, run.source),
            force,
            shortest=shortest,
            rest=REST,
            name=f"{run.source}: run {run.name}",
        )
        for run, force in zip(runs, filtered, strict=True)
    ]
    tares, remarks = tares_of(runs, windows, tare)
    notes += remarks
    settled = 0.0 if across is None else WIDTHS * min(across)
    pulls = [
        _pull(run, window, offset, settled, shortest)
        for run, found, offset in zip(runs, windows, tares, strict=True)
        for window in found
        if not window.rest
    ]
    missing = [run.name for run, found in zip(runs, windows, strict=True) if all(w.rest for w in found)]
    notes += [f"run {name}: no steady window of {shortest:g} s; left out" for name in missing]
    if not pulls:
        raise IdentificationError(
            f"{runs[0].source}: no steady window of {shortest:g} s in any run. Tow longer at constant speed, or ask "
            "for shorter windows"
        )
    sign, remarks = _sign(pulls)
    notes += remarks
    pulls = [replace(p, force=sign * p.force, tare=sign * p.tare) for p in pulls]
    width = None if across is None else min(across)
    pulls, remarks = _long_enough(pulls, width)
    notes += remarks
    pulls, fit = _fitted(pulls, rig, nonnegative)
    notes += [*fit.notes] if rig is not None else [*fit.notes, "drag of the rig was not given: it is in the damping"]
    if len(fit.coefficients) == 2 and len({p.speed > 0 for p in pulls if p.used}) == 2:
        notes.append(ONE_PAIR)
    coefficient, remarks = _drag_coefficient(pulls, across, density)
    notes += remarks
    turned = tuple(replace(run, force=sign * run.force) for run in runs)
    return Towing(
        turned, tuple(sign * f for f in filtered), cutoff, tuple(pulls), fit, width, coefficient, tuple(notes)
    )


def _pull(run: TowRun, window: Window, tare: Tare, settled: float, shortest: float) -> Pull:
    """A window with its tare; it begins where the flow has settled if enough of it is left."""
    distance = np.concatenate([[0.0], np.cumsum(np.diff(run.t) * (run.speed[1:] + run.speed[:-1]) / 2)])
    travelled = np.sign(window.mean) * (distance - np.interp(_set_off(run, window), run.t, distance))
    behind = run.t[(run.t >= window.start) & (travelled >= settled)]
    if len(behind) and behind[0] > window.start and window.end - behind[0] >= shortest:
        window = window_over(run.t, run.speed, run.force, float(behind[0]), window.end)
    start, end = (float(x) for x in np.interp([window.start, window.end], run.t, travelled))
    offset = tare.at((window.start + window.end) / 2)
    std = float(np.hypot(window.force_std, tare.std))
    return Pull(run.name, window, window.mean, window.force - offset, std, offset, 0.0, start, end)


def _set_off(run: TowRun, window: Window) -> float:
    """When the motion of a window began: when the carriage last stood, or turned round [s]."""
    onward = np.sign(window.mean) * run.speed > max(REST, 0.1 * abs(window.mean))
    # Noise of the speed must not count as standing: a rest lasts.
    lasting = max(int(0.2 * run.rate), 1)
    standing = np.convolve(~onward, np.ones(lasting) / lasting)[: len(onward)] > 0.5
    before = np.flatnonzero(standing & (run.t <= window.start))
    return float(run.t[before[-1]] if len(before) else run.t[0])


def _sign(pulls: list[Pull]) -> tuple[float, list[str]]:
    """1 where the force has the sign of the speed, -1 where it was logged as the water's on the vehicle."""
    clear = [p for p in pulls if abs(p.force) > 4 * p.std] or pulls
    along = {side: {bool(p.force * p.speed > 0) for p in clear if p.speed * side > 0} for side in (1, -1)}
    signs = along[1] | along[-1]
    if signs == {True, False}:
        if len(along[1]) == len(along[-1]) == 1:
            raise IdentificationError(
                "towing: the force has the same sign ahead and astern: the sign of the force or of the speed was lost. "
                "Log both with their sign, or fit ahead and astern in two calls"
            )
        wrong = [p.run for p in clear if (p.force * p.speed > 0) != (sum(p.force * q.speed > 0 for q in clear) > 0)]
        raise IdentificationError(
            f"towing: runs differ in the sign of the force ({', '.join(dict.fromkeys(wrong)) or 'some'} against the "
            "others). Check the tare and the rig's direction in these runs"
        )
    if signs == {False}:
        return -1.0, ["the force opposes the speed in the files: taken as the water's on the vehicle, sign turned"]
    return 1.0, []


def _long_enough(pulls: list[Pull], width: float | None) -> tuple[list[Pull], list[str]]:
    """Pulls whose flow had not settled are left out where others remain at two speeds."""
    if width is None:
        return pulls, ["size across the motion not given: whether strokes are long enough for steady drag is unchecked"]
    short = [p for p in pulls if p.travelled < 0.99 * WIDTHS * width]  # within a reading of it is long enough
    if not short:
        return pulls, []
    worst = min(short, key=lambda p: p.stroke)
    what = (
        f"{len(short)} of {len(pulls)} steady windows are too short a stroke for steady drag: the shortest is "
        f"{worst.stroke:.2g} m, {worst.stroke / width:.2g} widths of {width:.3g} m (Keulegan-Carpenter number "
        f"{np.pi * worst.stroke / width:.2g}); flow needs about {WIDTHS:g} widths, {WIDTHS * width:.2g} m"
    )
    kept = [p for p in pulls if p not in short]
    if len({round(abs(p.speed), 3) for p in kept}) >= 2:
        return [replace(p, used=p not in short) for p in pulls], [what + ". They are left out"]
    return pulls, [what + ". No others: the damping is that of start-up flow, too large for steady motion"]


def _fitted(pulls: list[Pull], rig: DampingFit | None, nonnegative: bool) -> tuple[list[Pull], DampingFit]:
    """Rig subtracted, curve fitted; the rig's uncertainty is common to all runs and added to the coefficients."""
    if rig is not None:
        pulls = [replace(p, rig=float(rig.force(np.array([p.speed]))[0])) for p in pulls]
        pulls = [replace(p, force=p.force - p.rig) for p in pulls]
    used = [p for p in pulls if p.used]
    v, F, std = (np.array([getattr(p, name) for p in used]) for name in ("speed", "force", "std"))
    both = all(len({round(abs(x), 3) for x in v[side]}) >= 2 for side in (v > 0, v < 0))
    # A window cannot be known better than the sensor repeats from run to run; that is not in its own scatter.
    sigma = np.maximum(std, 1e-3 * np.abs(F).max())
    speed_std = np.array([p.window.std for p in used])
    fit = fit_damping(v, F, sigma=sigma, sigma_velocity=speed_std, nonnegative=nonnegative, astern=both)
    if rig is not None and np.all(np.isfinite(rig.covariance)):
        share = rig.covariance
        if len(share) != len(fit.covariance):
            share = np.kron(np.ones((2, 2)), share) if len(share) == 2 else (share[:2, :2] + share[2:, 2:]) / 2
        fit = replace(fit, covariance=fit.covariance + share)
    return pulls, fit


def _drag_coefficient(
    pulls: list[Pull], across: tuple[float, float] | None, density: float
) -> tuple[float | None, list[str]]:
    if across is None:
        return None, []
    fastest = max((p for p in pulls if p.used), key=lambda p: abs(p.speed))
    coefficient = 2 * abs(fastest.force) / (density * across[0] * across[1] * fastest.speed**2)
    if coefficient <= BLUFF:
        return coefficient, []
    return coefficient, [
        f"C_D is {coefficient:.2g} on {across[0]:.3g} x {across[1]:.3g} m at {abs(fastest.speed):.3g} m/s; no box has "
        f"more than {BLUFF:g} in steady flow: start-up flow, a tare or rig left in, or a wrong unit"
    ]
