"""The figure of docs/world.md about the surface and walls, and the figures in its text.

python docs/scripts/surface_and_walls.py [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import quaternion_from_euler, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.environment.world import walls_of
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import State, rollout

DT, SECONDS = 0.002, 60


@jax.jit
def fly(model, start, u, environment):
    """60 s under one command; every 20th step."""
    commands = Command(jnp.broadcast_to(u, (20, model.thrusters.count)))

    def chunk(state, _):
        state = jax.tree.map(lambda leaf: leaf[-1], rollout(model, state, commands, environment, DT))
        return state, state

    return jax.lax.scan(chunk, start, None, length=round(SECONDS / DT / 20))[1]


def rising(axes):
    """Net buoyancy, thrusters off: it comes up and floats where what is dry displaces the net buoyancy."""
    t = 20 * DT * np.arange(1, round(SECONDS / DT / 20) + 1)
    for net in (2.0, 10.0, 30.0):
        model = load_vehicle("double_blueye").model(net_buoyancy=net)
        start = State.at(model, Start.at((0.0, 0.0, 2.0)))
        start = State(start.position, quaternion_from_euler(jnp.array([0.2, -0.1, 0.0])), start.nu, start.thrust)
        states = fly(model, start, jnp.zeros(6), Environment.calm(surface=jnp.zeros(())))
        top = np.asarray(states.position[:, 2]) + float(model.hull.corners[:, 2].min())
        axes.plot(t, top, label=f"{net:g} N")
        print(f"net buoyancy {net:g} N: top of the hull {-1000 * top[-1]:.1f} mm above the water at rest")
    axes.axhline(0.0, color="0.6", lw=0.8)
    axes.invert_yaxis()
    axes.set(xlabel="time [s]", ylabel="depth of the hull's top [m]", title="left to itself, by net buoyancy")
    axes.legend(fontsize=8)


def pushing(axes):
    """Full thrust ahead and a little down against the walls of a tank 4 m x 2 m x 1.5 m."""
    model = load_vehicle("double_blueye").model()
    walls = walls_of((-2.0, 2.0), (-1.0, 1.0), 1.5)
    u = jnp.array([1.0, 0.0, 0.3, 0.9, 0.0, 0.3])
    states = fly(
        model, State.at(model, Start.at((0.0, 0.0, 0.7))), u, Environment.calm(surface=jnp.zeros(()), walls=walls)
    )
    R = jax.vmap(rotation_from_quaternion)(states.attitude)
    corners = np.asarray(states.position[:, None] + jnp.einsum("mi,tji->tmj", model.hull.corners, R))
    print(f"deepest into a wall: {1000 * (corners @ np.asarray(walls.normals).T - walls.offsets).max():.1f} mm")
    axes.plot([-1, 1, 1, -1, -1], [-2, -2, 2, 2, -2], color="0.3", lw=1.5)
    for k in range(0, len(corners), 125):
        outline = corners[k][[0, 2, 6, 4, 0]]
        axes.plot(outline[:, 1], outline[:, 0], color="C0", lw=0.6, alpha=0.5)
    axes.plot(states.position[:, 1], states.position[:, 0], color="C1", lw=1.2)
    axes.set(xlabel="east [m]", ylabel="north [m]", title="full thrust, 60 s", aspect="equal")


def main():
    """Both panels."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    folder = parser.parse_args().out
    fig, (left, right) = plt.subplots(1, 2, figsize=(8.5, 3.8), layout="constrained", width_ratios=(3, 2))
    rising(left)
    pushing(right)
    fig.savefig(folder / "world_surface.png", dpi=110)


if __name__ == "__main__":
    main()
