"""The figures and the numbers of docs/guidance_and_control.md.

    python docs/scripts/guidance.py [--vehicle double_blueye] [--out docs/figures]

Feedback is perfect (the plant's own state, as in thesis 7.2), so that only guidance and control show.
"""

import argparse
from pathlib import Path

import equinox as eqx
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import (
    ABORTED,
    FINISHED,
    NO_REQUEST,
    PHASES,
    REASONS,
    AutopilotInput,
    Environment,
    Estimate,
    Setpoint,
    Slot,
)
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.control.reference_model import ReferenceModel
from rovtwin.gnc.guidance.mission import mission
from rovtwin.gnc.interfaces import ControlInput
from rovtwin.gnc.thesis.allocation import Allocation
from rovtwin.gnc.thesis.pid import Pid, linearised_damping
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State, plant_step
from rovtwin.vehicle.physics.linearisation import restoring_stiffness

DT = 0.02
SETS = {
    "table 7.1": {"gains": "table_7_1"},
    "placed": {"gains": "pole_placement"},
    "placed, obeys speed": {"gains": "pole_placement", "obey_speed": True},
}
SQUARE = [{"x": x, "y": y, "depth": 3.0, "speed": 0.2} for x, y in [(3, 0), (3, 3), (0, 3), (0, 0)]]
# Table 8.3 at a speed that the vehicle reaches without saturating.
LAWNMOWER = [
    {"x": x, "y": y, "depth": 3.0, "speed": 0.2} for x, y in [(6, 0), (6, 3), (0, 3), (0, 6), (6, 6), (6, 9), (0, 9)]
]


class Perfect(Block):
    """Believes the truth it is given."""

    def init(self, key, start):
        return jnp.zeros(())

    def step(self, memory, input, dt):
        truth = input.measurements["truth"].value[0]
        nothing = jnp.zeros(1)
        return memory, Estimate.from_euler(truth[:6], truth[6:], jnp.zeros(6), 1e-4 * jnp.eye(12), nothing, nothing)


@eqx.filter_jit
def fly(autopilot, model, start, n):
    """Truth (n, 12) and the autopilot's outputs."""

    def tick(carry, _):
        memory, state = carry
        truth = jnp.concatenate([state.position, euler_from_quaternion(state.attitude), state.nu])
        slot = Slot(truth[None], jnp.ones(1, dtype=bool), jnp.zeros(1))
        memory, output = autopilot.step(memory, AutopilotInput({"truth": slot}, jnp.asarray(NO_REQUEST)), DT)
        return (memory, plant_step(model, state, output.command, Environment.calm(), DT)), (truth, output)

    begin = autopilot.init(jax.random.key(0), start), State.at(model, start)
    return jax.lax.scan(tick, begin, None, length=n)[1]


def flown(model, points, start, seconds, **options):
    """A flight with the thesis's autopilot, as NumPy arrays."""
    autopilot = Autopilot.thesis(model, Perfect(), mission(points), **options)
    return jax.tree.map(np.asarray, fly(autopilot, model, start, round(seconds / DT)))


def cross_track(truth, setpoint):
    """Distance to the right of the leg, on legs only [m]."""
    on = setpoint.on_leg
    way, away = (setpoint.leg_end - setpoint.leg_start)[on, :2], truth[on, :2] - setpoint.leg_start[on, :2]
    return (way[:, 0] * away[:, 1] - way[:, 1] * away[:, 0]) / np.linalg.norm(way, axis=1)


@eqx.filter_jit
def respond(pid, reference, allocate, model, eta, n):
    """Pose and reference after a step of the set-point to eta, without guidance, shapes (n, 6)."""
    zero, no = jnp.zeros((), dtype=int), jnp.asarray(False)
    setpoint = Setpoint(
        eta[:3], quaternion_from_euler(eta[3:]), jnp.zeros(6), jnp.zeros(3), jnp.zeros(3), no, zero, zero, zero
    )

    def tick(carry, _):
        smooth, integral, state, shortfall = carry
        pose = jnp.concatenate([state.position, euler_from_quaternion(state.attitude)])
        nothing = jnp.zeros(1)
        estimate = Estimate(
            state.position, state.attitude, state.nu, jnp.zeros(6), jnp.zeros((12, 12)), nothing, nothing
        )
        smooth, path = reference.step(smooth, setpoint, DT)
        integral, wrench = pid.step(integral, ControlInput(estimate, path, shortfall), DT)
        command, allocated = allocate(wrench.tau)
        state = plant_step(model, state, command, Environment.calm(), DT)
        return (smooth, integral, state, wrench.tau - allocated), (pose, path.eta)

    key, start = jax.random.key(0), Start.at()
    begin = reference.init(key, start), pid.init(key, start), State.at(model, start), jnp.zeros(6)
    return jax.lax.scan(tick, begin, None, length=n)[1]


def step_figure(model, path):
    """Steps of one axis at a time through the reference model of (7.8), as in thesis 7.2 and figure 7.12."""
    steps = {0: (2.0, "north [m]"), 1: (1.0, "east [m]"), 2: (1.5, "depth [m]"), 5: (1.0, "heading [rad]")}
    figure, axes = plt.subplots(2, 2, figsize=(9, 5), sharex=True, layout="constrained")
    time = DT * np.arange(round(120 / DT))
    for axis, (dof, (size, label)) in zip(axes.flat, steps.items(), strict=True):
        for name, pid in {"table 7.1": Pid.table_7_1(model), "placed": Pid.pole_placement(model)}.items():
            eta, allocate = size * jnp.eye(6)[dof], Allocation.of(model)
            pose, smooth = respond(pid, ReferenceModel.thesis(), allocate, model, eta, len(time))
            axis.plot(time, pose[:, dof], label=name)
        axis.plot(time, smooth[:, dof], "k--", lw=0.8, label="reference")
        axis.set(ylabel=label)
    axes[0, 0].legend(loc="lower right", fontsize=8)
    for axis in axes[1]:
        axis.set(xlabel="time [s]")
    figure.savefig(path, dpi=120)


def square_figure(model, path):
    """The way-points of thesis 7.4 from (0, 0, 0)."""
    figure, (plan, depth) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    for name, options in SETS.items():
        truth, output = flown(model, SQUARE, Start.at(), 400, **options)
        end = int(np.argmax(output.setpoint.phase == FINISHED)) or len(truth)
        plan.plot(truth[:end, 1], truth[:end, 0], lw=1, label=f"{name}: {end * DT:.0f} s")
        depth.plot(DT * np.arange(end), truth[:end, 2], lw=1)
    corners = np.array([(0, 0)] + [(p["x"], p["y"]) for p in SQUARE])
    plan.plot(corners[:, 1], corners[:, 0], "k--", lw=0.8)
    plan.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
    plan.legend(loc="center", fontsize=8)
    depth.invert_yaxis()
    depth.set(xlabel="time [s]", ylabel="depth [m]")
    figure.savefig(path, dpi=120)


def print_gains(name, model):
    """Gains placed from the model, and whether the printed roll gains are stable on it (Routh)."""
    placed, printed = Pid.pole_placement(model), Pid.table_7_1(model)
    print(f"{name}: gains placed from the model")
    for row in zip("surge sway heave roll pitch yaw".split(), placed.K_p, placed.K_i, placed.K_d, strict=True):
        print("  {:6s} K_p {:7.2f}  K_i {:6.3f}  K_d {:7.2f}".format(*row))
    m, d, g = model.inertia[3, 3], linearised_damping(model)[3], restoring_stiffness(model)[3]
    bound = (d + printed.K_d[3]) * (g + printed.K_p[3]) / m
    print(f"  roll with table 7.1: K_i is {printed.K_i[3]:g}, stable below {bound:.2f}")


def print_lawnmower(model):
    """Table 8.3 with each set of gains."""
    for label, options in SETS.items():
        truth, output = flown(model, LAWNMOWER, Start.at((0, 0, 0.5)), 1200, **options)
        phase = output.setpoint.phase
        over = np.isin(phase, (FINISHED, ABORTED))
        end = int(np.argmax(over)) if over.any() else len(truth)
        truth, setpoint = jax.tree.map(lambda leaf, end=end: leaf[:end], (truth, output.setpoint))
        error, tilt = cross_track(truth, setpoint), np.degrees(np.abs(truth[:, 3:5]).max(axis=0))
        reason = REASONS[int(output.setpoint.reason[-1])]
        print(f"  lawn-mower, {label}: {PHASES[phase[-1]]} {reason} after {end * DT:.0f} s")
        print(f"    roll up to {tilt[0]:.1f} deg, pitch {tilt[1]:.1f} deg", end="")
        if len(error):
            print(f", cross-track rms {np.sqrt(np.mean(error**2)):.2f} m, max {np.abs(error).max():.2f} m", end="")
        print()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vehicle", default="double_blueye")
    parser.add_argument("--speed", type=float, default=0.2, help="of the way-points [m/s]")
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "figures")
    given = parser.parse_args()
    for point in SQUARE + LAWNMOWER:
        point["speed"] = given.speed
    given.out.mkdir(parents=True, exist_ok=True)
    vehicle_model = load_vehicle(given.vehicle).model()
    step_figure(vehicle_model, given.out / "guidance_step.png")
    square_figure(vehicle_model, given.out / "guidance_square.png")
    print_gains(given.vehicle, vehicle_model)
    print_lawnmower(vehicle_model)
