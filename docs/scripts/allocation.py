"""The figure and the numbers of allocation with priorities in docs/guidance_and_control.md.

python docs/scripts/allocation.py [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.block import Start
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.allocation.attainable_wrench import lost_axes, remaining
from rovtwin.gnc.allocation.prioritised import AllocationInput, PriorityAllocation
from rovtwin.gnc.thesis.allocation import Allocation
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.thrusters import force_limits, static_force

DT = 0.02
SOUND, LOST = np.ones(6), np.array([1.0, 1, 1, 0, 0, 0])
COLOURS = {"scale": "C0", "clip": "C1", "priorities": "C3"}
STEP = jax.jit(lambda block, memory, input: block.step(memory, input, DT))
SCAN = jax.jit(
    lambda block, memory, taus: jax.lax.scan(
        lambda memory, tau: block.step(memory, AllocationInput(tau, jnp.asarray(SOUND)), DT), memory, taus
    )[1]
)
MARKERS = {"scale": "s", "clip": "^", "priorities": "o"}


def made(model, tau, health):
    """Wrench that the thrusters settle at with each allocation, which is given the health, by name."""
    thrusters = model.thrusters
    weak = model.replace(thrusters=thrusters_with(thrusters, health))
    commands = {name: Allocation.of(weak, saturation=name)(jnp.asarray(tau))[0].u for name in ("scale", "clip")}
    block = PriorityAllocation.of(model)
    input = AllocationInput(jnp.asarray(tau), jnp.asarray(health))
    commands["priorities"] = STEP(block, block.init(jax.random.key(0), Start.at()), input)[1].command.u
    plant = weak.thrusters
    return {name: np.asarray(plant.configuration @ static_force(plant, u)) for name, u in commands.items()}


def thrusters_with(thrusters, health):
    """The same thrusters with another health."""
    fields = {name: getattr(thrusters, name) for name in thrusters.__dataclass_fields__}
    return type(thrusters)(**fields | {"health": jnp.asarray(health)})


def plane(axis, model, tau, health, title):
    """Surge and yaw that can be made, what was requested and what is made."""
    T, (low, high) = np.asarray(model.thrusters.configuration) * health, force_limits(model.thrusters)
    surge = [i for i in range(T.shape[1]) if abs(np.asarray(model.thrusters.configuration)[0, i]) > 0.5]
    port, starboard = ((T[[0, 5], i], low[i], high[i]) for i in surge)
    corners = [(0, 0), (0, 1), (1, 1), (1, 0), (0, 0)]
    outline = np.array([port[0] * port[1 + a] + starboard[0] * starboard[1 + b] for a, b in corners])
    axis.fill(*outline.T, color="0.9", ec="0.5", lw=2, label="can be made")
    axis.plot(tau[0], tau[5], "k*", ms=12, label="wanted")
    for name, wrench in made(model, tau, health).items():
        axis.plot(wrench[0], wrench[5], MARKERS[name], color=COLOURS[name], ms=8, label=name)
        print(f"{title}: {name}: surge {wrench[0]:.2f} N, yaw {wrench[5]:.2f} N m, heave {wrench[2]:.2f} N")
    axis.axhline(0, color="0.7", lw=0.6)
    axis.axvline(0, color="0.7", lw=0.6)
    axis.set(xlabel="surge [N]", ylabel="yaw [N m]", title=title, xlim=(-23, 23), ylim=(-7, 7))
    axis.title.set_fontsize(10)


def chatter(axis, model):
    """Commands of one thruster for noise about no surge, with and without rest near standstill."""
    noise = 0.05 * np.random.default_rng(1).normal(size=400)
    tau = jnp.asarray(noise)[:, None] * jnp.eye(6)[0]
    time = DT * np.arange(len(noise))
    for start, stop, colour, label in ((0.0, 0.0, "0.6", "no rest"), (0.01, 0.005, "C3", "rest below 1 %")):
        block = PriorityAllocation.of(model, start=start, stop=stop)

        memory = block.init(jax.random.key(0), Start.at())
        u = np.asarray(SCAN(block, memory, tau).command.u[:, 0])
        axis.step(time, u, color=colour, lw=0.8, label=label)
        print(f"{label}: {np.sum(np.diff(np.sign(u)) != 0) / time[-1]:.1f} starts, stops and reversals a second")
    axis.set(
        xlabel="time [s]", ylabel="command of port surge", title="Noise of 0.05 N about no surge", ylim=(-0.2, 0.2)
    )
    axis.title.set_fontsize(10)
    axis.legend(fontsize=8)


def left_over(model):
    """Prints what remains of each axis."""
    thrusters, what = model.thrusters, jax.jit(remaining, static_argnames="held")
    sound = what(thrusters, jnp.asarray(SOUND))
    for name, health in {"sound": SOUND, "port surge lost": [0, 1, 1, 1, 1, 1], "starboard Blueye lost": LOST}.items():
        now = what(thrusters, jnp.asarray(health, dtype=float))
        either = ", ".join(f"{value:.2f}" for value in now.either)
        lost = [axis for axis, gone in zip("XYZKMN", lost_axes(now, sound), strict=True) if gone]
        print(f"{name}: X, Y, Z, K, M, N {either}; horizontal {now.horizontal:.2f} N; lost {lost}")


def main():
    """Draw and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    out = parser.parse_args().out
    model = load_vehicle("double_blueye").model()
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.8), layout="constrained")
    plane(axes[0], model, np.array([20.0, 0, 0, 0, 0, 2.8]), SOUND, "Full surge and half of yaw")
    plane(axes[1], model, np.array([8.0, 0, 5.0, 0, 0, 0]), LOST, "One Blueye lost: 8 N of surge, no yaw")
    axes[0].legend(fontsize=8, loc="lower left")
    chatter(axes[2], model)
    figure.savefig(out / "allocation.png", dpi=130)
    left_over(model)


if __name__ == "__main__":
    main()
