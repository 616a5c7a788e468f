"""Whether predictive control or LQR beats the tracking controller near the thrusters' limits; table and figure.

python docs/scripts/mpc_study.py [--out docs/figures] [--cases calm current_ahead ...] [--controllers tracking lqr ...]

All fly one path with the full 6-DOF plant, thrusters with lag, and are given the truth: pose, velocity and force of the
current (predictive control the current itself). Predictive control is in three degrees of freedom with the forces of
the horizontal thrusters, their lag and limits, and plans its own speed along the path up to the leg's (contouring
control, predictive.py). It is solved to convergence at 10 Hz and its answer comes at once. It needs casadi, which is no
dependency of rovtwin: pip install casadi
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from predictive import LEVEL, Predictive
from scipy.linalg import solve_continuous_are

from rovtwin.core.block import Start
from rovtwin.core.flow import FINISHED, Environment, Estimate
from rovtwin.core.frames import level_attitude, rotation_error, rotation_from_quaternion, yaw_rotation
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.control.tracking import PathReference, Tracking
from rovtwin.gnc.guidance.mission import mission
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.interfaces import MODE_RUNNING, AllocationInput, ControlInput, GuidanceInput, Mode
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.actuation import wrench_limits
from rovtwin.vehicle.physics.dynamics import State, coriolis_wrench, damping_wrench, plant_step

DT, HOLD, LIMIT = 0.02, 5, 500.0  # control period [s], periods between two plans, longest flight [s]
LAWNMOWER = [(6, 0), (6, 3), (0, 3), (0, 6), (6, 6), (6, 9), (0, 9)]  # thesis, table 8.3
ERROR, MEMORY = 0.16, 10.0  # of the acoustic estimate, per axis: rms [m], correlation time [s]
CONTROLLERS = {"tracking": "#8064a2", "tracking_limits": "#1f5fa8", "lqr": "#9bbb59", "mpc": "#c0504d"}
RUNNING = Mode(jnp.asarray(MODE_RUNNING), jnp.asarray(0))


class Case(NamedTuple):
    """What is flown: speed of the legs [m/s], current to north and east [m/s], share a sway thruster has left."""

    speed: float
    current: tuple[float, float] = (0.0, 0.0)
    sway: float = 1.0


CASES = {
    "calm": Case(0.2),
    "current_aside": Case(0.2, (0.0, 0.22)),
    "current_ahead": Case(0.2, (0.0, -0.22)),
    "fast": Case(0.32),
    "weak_sway": Case(0.2, (0.0, 0.15), 0.2),
}


class Parts(NamedTuple):
    """Of the autopilot that is flown; `gain` (3, 6) of [pose error, velocity error] takes Tracking's place if given."""

    guidance: PathGuidance
    reference: PathReference
    control: Tracking
    allocation: PriorityAllocation
    gain: jax.Array | None = None


def parts(model, controller, speed):
    """The autopilot's parts for the name of a controller."""
    gain = jnp.asarray(lqr(model, speed)) if controller == "lqr" else None
    guidance = PathGuidance.of(model)
    if controller != "tracking_limits":  # guidance that does not ask what thrusters can keep up
        guidance = eqx.tree_at(lambda g: g.sustained, guidance, None)
    return Parts(guidance, PathReference.of(model), Tracking.of(model), PriorityAllocation.of(model), gain)


def lqr(model, speed):
    """K (3, 6) of the motion linearised about going ahead; Bryson's rule: 0.1 m and 0.1 rad against all thrust."""

    def rate(nu):
        full = jnp.zeros(6).at[LEVEL].set(nu)
        return -(coriolis_wrench(model.inertia, full) + damping_wrench(model, full))[LEVEL]

    inverse = np.linalg.inv(np.asarray(model.inertia)[np.ix_(LEVEL, LEVEL)])
    A, B = np.zeros((6, 6)), np.vstack([np.zeros((3, 3)), inverse])
    A[:3, 3:], A[3:, 3:] = np.eye(3), inverse @ np.asarray(jax.jacobian(rate)(jnp.array([speed, 0.0, 0.0])))
    A[1, 2] = speed  # going ahead with a wrong heading leads aside
    Q, R = (
        np.diag([100.0, 100.0, 100.0, 0, 0, 0]),
        np.diag(1.0 / np.asarray(wrench_limits(model.thrusters)[1])[LEVEL] ** 2),
    )
    return np.linalg.solve(R, B.T @ solve_continuous_are(A, B, Q, R))


def estimate_of(model, state, environment, off):
    """The truth as an estimate, with the force that the current makes, and an error `off` (2,) of the position."""
    R = rotation_from_quaternion(state.attitude)
    nu_r = state.nu.at[:3].add(-R.T @ environment.velocity)
    still, flowing = (coriolis_wrench(model.inertia, nu) + damping_wrench(model, nu) for nu in (state.nu, nu_r))
    carried = model.inertia[:3, :3] @ jnp.cross(state.nu[3:], R.T @ environment.velocity)
    bias = jnp.concatenate([R @ (still - flowing)[:3] - R @ carried, jnp.zeros(3)])
    place = state.position.at[:2].add(off)
    return Estimate(place, state.attitude, state.nu, bias, jnp.eye(12) * 1e-4, jnp.zeros(1), jnp.zeros(1))


@eqx.filter_jit
def advance(model, p, route, environment, health, carry, off, level, planned):
    """HOLD periods of everything; `level` is the plan's wrench (3,), used where `planned`."""

    def tick(carry, _):
        state, guidance, reference, control, allocation, short = carry
        estimate = estimate_of(model, state, environment, off)
        guidance, asked = p.guidance.step(guidance, GuidanceInput(estimate, route, RUNNING), DT)
        reference, path = p.reference.step(reference, asked, DT)
        control, desired = p.control.step(control, ControlInput(estimate, path, short), DT)
        tau = desired.tau if p.gain is None else fed_back(p, model, control, estimate, path, short)
        tau = jnp.where(planned, tau.at[LEVEL].set(level), tau)
        allocation, given = p.allocation.step(allocation, AllocationInput(tau, health), DT)
        after = plant_step(model, state, given.command, environment, DT)
        record = state.position, state.thrust, jnp.any(given.limited), asked.phase, asked.position[:2]
        return (after, guidance, reference, control, allocation, given.shortfall), record

    return jax.lax.scan(tick, carry, None, length=HOLD)


def fed_back(p, model, integral, estimate, path, short):
    """tau (6,) with LQR's feedback in place of Tracking's, which without errors is what is left: feed-forward."""
    R = yaw_rotation(estimate.heading).T
    e = (path.position - estimate.position).at[2].set(rotation_error(path.attitude, estimate.attitude)[2])
    rate = R @ path.velocity.at[2].set(path.angular_velocity[2]) - estimate.nu[LEVEL]
    ahead = eqx.tree_at(lambda c: (c.K_p, c.K_d), p.control, replace_fn=lambda k: k.at[LEVEL].set(0.0))
    _, forward = ahead.step(integral, ControlInput(estimate, path, short), DT)
    return forward.tau.at[LEVEL].add(p.gain @ jnp.concatenate([R @ e, rate]))


class Way(NamedTuple):
    """The smoothed path every centimetre: place (n, 2), direction (n,), length [m]."""

    place: np.ndarray
    direction: np.ndarray
    length: float

    def at(self, s):
        """Place (k, 2), direction (k,) and curvature (k,) at ways s (k,)."""
        i = np.clip(np.round(np.asarray(s) / 0.01).astype(int), 0, len(self.place) - 2)
        return self.place[i], self.direction[i], (self.direction[i + 1] - self.direction[i]) / 0.01


def way_of(guidance, route):
    """What guidance asks of a vehicle that is always where it should be."""
    none = jnp.zeros(6)

    def tick(memory, _):
        there = Estimate(
            memory.position, level_attitude(memory.heading), none, none, jnp.eye(12), jnp.zeros(1), jnp.zeros(1)
        )
        memory, asked = guidance.step(memory, GuidanceInput(there, route, RUNNING), DT)
        return memory, asked.eta

    begin = guidance.init(jax.random.key(0), Start.at((0.0, 0.0, 3.0)))
    eta = np.asarray(jax.jit(lambda b: jax.lax.scan(tick, b, None, length=round(LIMIT / DT))[1])(begin))
    s = np.append(0.0, np.cumsum(np.hypot(*np.diff(eta[:, :2], axis=0).T)))
    even = np.arange(0.0, s[-1], 0.01)
    columns = [np.interp(even, s, x) for x in (eta[:, 0], eta[:, 1], np.unwrap(eta[:, 5]))]
    return Way(np.stack(columns[:2], axis=1), columns[2], float(s[-1]))


def fly(name, controller, noisy, seed=1):
    """Scores of one flight, and where it went (n, 2) beside the way."""
    case, model = CASES[name], load_vehicle("double_blueye").model()
    route = mission([{"x": x, "y": y, "depth": 3.0, "speed": case.speed} for x, y in LAWNMOWER])
    environment = Environment.calm(velocity=jnp.array([*case.current, 0.0]))
    health = model.thrusters.health.at[1].set(case.sway)
    weak = eqx.tree_at(lambda m: m.thrusters.health, model, health)
    p, start = parts(model, controller, case.speed), Start.at((0.0, 0.0, 3.0))
    way, key = way_of(p.guidance, route), jax.random.key(0)
    plan = Predictive(weak, way, case.speed, case.current, HOLD * DT) if controller == "mpc" else None
    begin = [block.init(key, start) for block in (p.guidance, p.reference, p.control, p.allocation)]
    carry, records, level, off = (State.at(model, start), *begin, jnp.zeros(6)), [], np.zeros(3), np.zeros(2)
    random, decay = np.random.default_rng(seed), np.exp(-HOLD * DT / MEMORY)
    for _ in range(round(LIMIT / DT / HOLD)):
        if noisy:
            off = decay * off + ERROR * np.sqrt(1 - decay**2) * random.standard_normal(2)
        level = plan(carry[0], off) if plan else level
        arguments = (
            route,
            environment,
            health,
            carry,
            jnp.asarray(off),
            jnp.asarray(level),
            jnp.asarray(plan is not None),
        )
        carry, record = advance(weak, p, *arguments)
        records.append(jax.tree.map(np.asarray, record))
        at, phase = record[0][-1, :2], int(record[3][-1])
        gone = np.hypot(*(at - way.place[-1])) < 0.2
        if gone and (plan.s > way.length - 0.02 if plan else phase == FINISHED):
            break
    position, thrust, limited, *_ = (np.concatenate(x) for x in zip(*records, strict=True))
    away = np.array([np.hypot(*(way.place - at).T).min() for at in position[::HOLD, :2]])
    done, seconds = len(records) < round(LIMIT / DT / HOLD), len(position) * DT
    effort, activity = np.sum(thrust**2) * DT, np.sqrt(np.mean((np.diff(thrust, axis=0) / DT) ** 2))
    scores = [np.sqrt(np.mean(away**2)), away.max(), seconds if done else np.inf, effort, activity, limited.mean()]
    return scores, position[:, :2], away, way, np.array(plan.times if plan else [0.0])


def cells(name, controller):
    """A row of the table: what the vehicle does when told the truth, and with the error of acoustic positions."""
    (rms, most, seconds, effort, activity, limited), *_, times = flown = fly(name, controller, False)
    noisy = fly(name, controller, True)[0]
    work = f"{1e3 * np.median(times):.1f} / {1e3 * times.max():.1f}" if controller == "mpc" else ""
    row = [f"`{name}`", controller, f"{rms:.3f} / {most:.3f}", f"{noisy[0]:.2f} / {noisy[1]:.2f}", f"{seconds:.0f}",
           f"{effort:.0f}", f"{activity:.1f} / {noisy[4]:.1f}", f"{100 * limited:.0f} %", work]  # fmt: skip
    print("| " + " | ".join(row) + " |", flush=True)
    return flown


def draw(flights, path):
    """Where each went in the case in which they differ most, and how far off the path."""
    fig, (where, off) = plt.subplots(1, 2, figsize=(11, 3.8), layout="constrained")
    for controller, (_, position, away, _, _) in flights.items():
        where.plot(position[:, 1], position[:, 0], color=CONTROLLERS[controller], lw=1.2, label=controller)
        off.plot(np.arange(len(away)) * HOLD * DT, away, color=CONTROLLERS[controller], lw=1.2)
    place = next(iter(flights.values()))[3].place
    where.plot(place[:, 1], place[:, 0], "k:", lw=1, label="path")
    where.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", title="0.22 m/s of current to the west")
    off.set(xlabel="time [s]", ylabel="off the path [m]", title="legs and corners, told the truth")
    fig.legend(*where.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    fig.savefig(path, dpi=100)


def main():
    """Fly, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--controllers", nargs="+", choices=CONTROLLERS, default=list(CONTROLLERS))
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "figures")
    given = parser.parse_args()
    print("| case | controller | off the path, rms / max [m] | with 0.16 m of error | time [s] | effort [N2 s] | "
          "activity, with error [N/s] | at a limit | a plan: median, longest [ms] |")  # fmt: skip
    print("|---" * 9 + "|")
    flights = {case: {name: cells(case, name) for name in given.controllers} for case in given.cases}
    if "current_ahead" in flights:
        draw(flights["current_ahead"], given.out / "mpc_study.png")


if __name__ == "__main__":
    main()
