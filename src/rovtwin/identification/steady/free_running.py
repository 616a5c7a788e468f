"""Free running: steady speeds under known commands to damping (thesis 2.6.6, 3.4 to 3.8, 3.12).

    positions -> smoother -> velocities in b -> steady windows -> mean force less inertia -> damping

Over a window the momentum balance is exact: mean drag = mean thrust + mean weight in water - mean C(nu) nu -
M (nu_end - nu_start) / T, so that neither the last of a transient nor a slow turn biases the drag. The force comes from
commands and the vehicle's thrust curve; a wrong curve is the main error of the method, and nothing in these
tests can show its scale.

The thesis's own way is kept as `method="thesis"`: average velocity by plain difference from the command to the end of
the push, force linear in the command, no correction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.arrays.rotations import heading_rotation
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.record import Record
from rovtwin.identification.steady.damping_fit import ONE_PAIR, DampingFit, fit_damping
from rovtwin.identification.steady.damping_yaml import DOFS
from rovtwin.identification.steady.forces import coriolis, forces, full_thrust, weights
from rovtwin.identification.steady.smoothed_motion import NU, Motion, motion_of
from rovtwin.identification.steady.windows import Window, steady_windows
from rovtwin.vehicle.physics.model import Model

Method = Literal["steady", "thesis"]

PURE = 0.2  # largest share of the other translations in a window
TURN = np.radians(15.0)  # largest change of heading in a window of translation
REST = {"surge": 0.01, "sway": 0.01, "heave": 0.008, "yaw": 0.03}  # below: at rest [m/s, rad/s]
UNMODELLED = 5e-3  # standard deviation of the drag, as a share of the largest
STEADY_THRUST = 0.1  # largest change of the thrust in a window, as a share
MASS_STD = 0.2  # relative, of the mass with added mass in the momentum balance
PUSH = 0.02  # share of the largest force below which nothing is pushed


@dataclass(frozen=True)
class Run:
    """One steady window in one direction.

    Attributes:
        record: Name of the test.
        dof: Direction, a name of NU.
        start: [s]
        end: [s]
        velocity: Mean through the water, b [m/s, rad/s].
        std: Standard deviation of that mean.
        force: Mean drag [N, N m], sign of the velocity.
        force_std: Standard deviation of it, from the momentum balance; not from the thrust curve.
        thrust: Mean thrust in that direction, for comparison [N, N m].
        used: Whether the fit uses it.
    """

    record: str
    dof: str
    start: float
    end: float
    velocity: float
    std: float
    force: float
    force_std: float
    thrust: float
    used: bool = True


@dataclass(frozen=True, eq=False)
class FreeRunning:
    """What the tests say.

    Attributes:
        method: "steady" or "thesis".
        histories: Smoothed motion of every test.
        runs: All windows.
        fits: Damping by direction, where it was run at two speeds at least.
        notes: What a reader must know.
    """

    method: str
    histories: tuple[Motion, ...]
    runs: tuple[Run, ...]
    fits: dict[str, DampingFit]
    notes: tuple[str, ...]


def free_running(
    model: Model,
    records: Sequence[Record],
    *,
    method: Method = "steady",
    dofs: Sequence[str] = NU,
    shortest: float = 4.0,
    tolerance: float = 0.03,
    thrust_std: float = 0.0,
) -> FreeRunning:
    """Damping of each direction that was run at two steady speeds at least.

    Args:
        model: Thrust curves, weight, buoyancy and mass of the vehicle; its damping is not used.
        records: Whole tests, start-up included, one or several directions and steps in each.
        method: "steady", or the thesis's own.
        dofs: Directions to look for, names of NU.
        shortest: Duration of the shortest steady window [s].
        tolerance: Of the velocity in a window, as a share.
        thrust_std: Relative standard deviation of the thrust's scale: it goes into the coefficients in full.

    Raises:
        IdentificationError: No velocities, no steady windows, or no direction with two speeds.
    """
    unknown = [dof for dof in dofs if dof not in NU]
    if unknown:
        raise IdentificationError(f"free running: found direction {unknown[0]!r}, expected {', '.join(NU)}")
    if not records:
        raise IdentificationError("free running: no records; give at least one log")
    histories = [motion_of(record) for record in records]
    notes = [note for history in histories for note in history.notes]
    runs: list[Run] = []
    for record, history in zip(records, histories, strict=True):
        found, remarks = _runs(model, record, history, method, dofs, shortest, tolerance)
        runs += found
        notes += remarks
    if not runs:
        raise IdentificationError(
            f"{records[0].source}: no steady window of {shortest:g} s under thrust in any direction. Run longer at one "
            "command, or ask for shorter windows. " + " ".join(notes[:3])
        )
    fits = {}
    for dof in dofs:
        own = [run for run in runs if run.dof == dof]
        if not own:
            continue
        try:
            fits[dof] = _fitted(own, method, thrust_std)
        except IdentificationError as error:
            notes.append(f"{dof}: {str(error).removeprefix('damping fit: ')}")
            continue
        notes += [f"{dof}: {note}" for note in fits[dof].notes]
        if len(fits[dof].coefficients) == 2 and len({run.velocity > 0 for run in own}) == 2:
            notes.append(f"{dof}: {ONE_PAIR}")
        against = [run for run in own if run.force * run.velocity < 0 and abs(run.force) > 3 * run.force_std]
        if against:
            notes.append(
                f"{dof}: {len(against)} of {len(own)} windows move against their thrust: a sign of the commands or of "
                "the measurements is wrong, or something else pulls (current, tether)"
            )
    if not fits:
        raise IdentificationError("free running: " + "; ".join(notes[-4:]))
    if thrust_std == 0:
        notes.append("thrust is taken as the vehicle's curve says; damping has its scale and, at low speed, its shape")
    if any(record.tether_length for record in records):
        notes.append("a tether was paid out: its drag is in the damping")
    return FreeRunning(method, tuple(histories), tuple(runs), fits, tuple(notes))


def _runs(
    model: Model,
    record: Record,
    history: Motion,
    method: Method,
    dofs: Sequence[str],
    shortest: float,
    tolerance: float,
) -> tuple[list[Run], list[str]]:
    """Windows of one test in all directions."""
    t = history.t
    tau = forces(model, record, t, linear=method == "thesis")
    rest = np.concatenate([weights(model, record, history.attitude), np.zeros((len(t), 3))], axis=1)
    mass = np.asarray(model.inertia) + np.diag([1.0, 1, 1, 0, 0, 0]) * sum(b.mass for b in record.ballast)
    nu = history.nu()
    turning = coriolis(mass, nu)
    most = np.abs(np.asarray(model.thrusters.configuration)) @ full_thrust(model)
    runs, notes = [], []
    for dof in (d for d in dofs if d in history.velocity):
        i = DOFS.index(dof)
        force = tau[:, i] + rest[:, i]
        find = _pushes if method == "thesis" else _steady
        for window in find(record, history, dof, tau[:, i], float(most[i]), shortest, tolerance):
            inside = (t >= window.start) & (t <= window.end)
            if not np.all(np.isfinite(history.velocity[dof][inside])):
                continue
            impure = _impure(history, dof, inside)
            if impure:
                notes.append(f"{record.name}: {dof} at {window.start:.1f}-{window.end:.1f} s left out: {impure}")
                continue
            if method == "thesis":
                run = _difference(record, history, dof, inside, force[inside], tau[inside, i])
            else:
                run = _balance(record, history, dof, inside, force - turning[:, i], tau[:, i], mass[i], nu)
            if abs(run.velocity) > REST[dof]:
                runs.append(run)
    return runs, notes


def _steady(
    record: Record,
    history: Motion,
    dof: str,
    tau: Float[np.ndarray, " m"],
    largest: float,
    shortest: float,
    tolerance: float,
) -> list[Window]:
    """Steady windows under way, with thrust."""
    v, std = history.velocity[dof], history.std[dof]
    slow = float(np.nanmedian(std))
    found = steady_windows(
        history.t,
        v,
        tau,
        shortest=shortest,
        tolerance=tolerance,
        force_tolerance=STEADY_THRUST,
        slow=slow,
        rest=max(REST[dof], 2 * slow),
        name=f"{record.source}: {dof}",
    )
    out = []
    for w in (w for w in found if not w.rest):
        pull = tau[(history.t >= w.start) & (history.t <= w.end)]
        # A vehicle that coasts, or is braked, is not held at its speed by the thrust.
        if abs(pull.mean()) > PUSH * largest:
            out.append(w)
    return out


def _pushes(
    record: Record,
    history: Motion,
    dof: str,
    tau: Float[np.ndarray, " m"],
    largest: float,
    shortest: float,
    tolerance: float,
) -> list[Window]:
    """From each command that sets a force to the next: what the thesis averages over."""
    least = PUSH * largest
    if np.abs(tau).max() < least:
        return []
    found = steady_windows(history.t, tau, shortest=shortest, tolerance=0.05, rest=least, name=record.source)
    return [w for w in found if not w.rest]


def _impure(history: Motion, dof: str, inside: Bool[np.ndarray, " m"]) -> str:
    """Why a window is not motion in one direction with the others held; empty where it is."""
    means = {name: float(np.nanmean(v[inside])) for name, v in history.velocity.items()}
    heading = history.attitude[inside, 2]
    if dof != "yaw" and np.all(np.isfinite(heading)) and np.ptp(heading) > TURN:
        return f"heading not held, it turns by {np.degrees(np.ptp(heading)):.0f} deg"
    others = [name for name in means if name not in (dof, "yaw")]
    for name in others if dof != "yaw" else []:
        noise = float(np.nanmedian(history.std[name][inside]))
        if abs(means[name]) > PURE * abs(means[dof]) + noise:
            return f"also moving in {name}, {means[name]:.3f} m/s beside {means[dof]:.3f}"
    return ""


def _balance(
    record: Record,
    history: Motion,
    dof: str,
    inside: Bool[np.ndarray, " m"],
    force: Float[np.ndarray, " m"],
    tau: Float[np.ndarray, " m"],
    mass: Float[np.ndarray, "6"],
    nu: Float[np.ndarray, "m 6"],
) -> Run:
    """Mean velocity and mean drag by the momentum balance of a window; mass is the row of M of that direction."""
    t, std = history.t[inside], history.std[dof][inside]
    start, end = float(t[0]), float(t[-1])
    inertia = float(mass @ (nu[inside][-1] - nu[inside][0])) / (end - start)
    own = float(mass[DOFS.index(dof)])
    noise = float(np.hypot(own * np.hypot(std[0], std[-1]) / (end - start), MASS_STD * inertia))
    mean, mean_std = history.mean(dof, inside)
    drag = float(np.mean(force[inside])) - inertia
    return Run(record.name, dof, start, end, mean, mean_std, drag, noise, float(np.mean(tau[inside])))


def _difference(
    record: Record,
    history: Motion,
    dof: str,
    inside: Bool[np.ndarray, " m"],
    force: Float[np.ndarray, " m"],
    tau: Float[np.ndarray, " m"],
) -> Run:
    """The thesis's way: plain difference over the whole push."""
    t = history.t[inside]
    start, end = float(t[0]), float(t[-1])
    velocity = float(_plain_difference(record, history, dof, start, end))
    return Run(record.name, dof, start, end, velocity, 0.0, float(np.mean(force)), 0.0, float(np.mean(tau)))


def _plain_difference(record: Record, history: Motion, dof: str, start: float, end: float) -> float:
    """Difference of the first and the last reading over time, turned into b with the mean heading."""

    def slope(name: str, column: int, angle: bool = False) -> float:
        signal = record.signals[name].cut(start, end)
        value = np.unwrap(signal.value[:, column]) if angle else signal.value[:, column]
        return float((value[-1] - value[0]) / (signal.t[-1] - signal.t[0]))

    if dof == "yaw":
        return slope("attitude", 2, angle=True)
    if dof == "heave":
        return slope("depth", 0) if "depth" in record.signals else slope("position", 2)
    name = "horizontal" if "horizontal" in record.signals else "position"
    north, east = slope(name, 0), slope(name, 1)
    psi = float(np.mean(history.attitude[(history.t >= start) & (history.t <= end), 2]))
    along = heading_rotation(psi)[:, ("surge", "sway").index(dof)]
    return along[0] * north + along[1] * east


def _fitted(runs: list[Run], method: Method, thrust_std: float) -> DampingFit:
    v, F = np.array([r.velocity for r in runs]), np.array([r.force for r in runs])
    both = all(len({round(abs(x), 2) for x in v[side]}) >= 2 for side in (v > 0, v < 0))
    if method == "thesis":
        return fit_damping(v, F, astern=both)
    # What little motion there is in other directions has drag too, which is not modelled.
    floor = UNMODELLED * float(np.abs(F).max())
    sigma = np.hypot([r.force_std for r in runs], floor)
    fit = fit_damping(v, F, sigma=sigma, sigma_velocity=np.array([r.std for r in runs]), astern=both)
    scale = thrust_std**2 * np.outer(fit.coefficients, fit.coefficients)
    return replace(fit, covariance=fit.covariance + scale)
