"""The figure and the numbers on tethers in docs/world.md.

python docs/scripts/tether.py [--out docs/figures]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.block import Start
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.simulation.tether.cable import Cable
from rovtwin.simulation.tether.tether import Tether, TetherInput
from rovtwin.vehicle.physics.dynamics import State

SPEEDS = np.linspace(0.0, 0.6, 13)
THRUST = 20.0  # of the Double Blueye ahead [N]


def pulls(tether: Tether, place: Array, length: Array, speed: Array) -> tuple[Array, Array]:
    """Nodes (n, 3) and force (3,) of a tether from the origin to a place, in a current to the north."""

    def one(place: Array, length: Array, speed: Array) -> tuple[Array, Array]:
        water = jnp.array([1.0, 0.0, 0.0]) * speed
        start = Start.at(place)
        here = replace(tether, length=length)
        memory = here.settled(start, lambda nodes: jnp.broadcast_to(water, nodes.shape))
        state = State(start.position, start.attitude, start.velocity, jnp.zeros(0))
        seen = TetherInput(state, jnp.broadcast_to(water, memory.line.nodes.shape), jnp.asarray(False))
        line = here.step(memory, seen, 0.02)[0].line
        return line.nodes, line.force

    return jax.jit(jax.vmap(one))(place, length, speed)


def figure(folder: Path) -> None:
    """Shapes from the side; force at the vehicle over speed."""
    tether = Tether(Cable(0.005), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 50.0)
    fig, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.4))
    for weight, name in ((0.0, "neutral"), (0.1, "0.1 N/m heavy"), (-0.1, "0.1 N/m light")):
        here = replace(tether, cable=Cable(0.005, wet_weight=weight, surface=as_array(0.0)))
        nodes, force = pulls(here, as_array([[10.0, 0.0, 30.0]]), as_array([40.0]), as_array([0.3]))
        left.plot(nodes[0, :, 0], nodes[0, :, 2], ".-", markersize=3, label=f"{name}: {np.linalg.norm(force[0]):.1f} N")
    left.plot(10.0, 30.0, "ks", label="vehicle")
    left.set(xlabel="north [m]", ylabel="depth [m]", title="40 m of 5 mm in 0.3 m/s", aspect="equal")
    left.set(xlim=(-2, 42), ylim=(42, -2))
    left.legend(fontsize=7, loc="lower right")

    for depth in (20.0, 50.0, 100.0):
        count = len(SPEEDS)
        places = as_array([[0.0, 0.0, depth]] * count)
        _, force = pulls(tether, places, jnp.full(count, 1.05 * depth), as_array(SPEEDS))
        size = np.linalg.norm(force, axis=1)
        right.plot(SPEEDS, size, label=f"{depth:g} m deep, {1.05 * depth:g} m paid out")
        at = {s: (np.interp(s, SPEEDS, force[:, 0]), np.interp(s, SPEEDS, size)) for s in (0.1, 0.2, 0.3, 0.5)}
        print(f"{depth:g} m:", ", ".join(f"{s} m/s: {a:.1f} along, {t:.1f} N" for s, (a, t) in at.items()))
    right.axhline(THRUST, color="k", linestyle="--", linewidth=1)
    right.text(0.01, THRUST + 0.7, "full thrust ahead", fontsize=7)
    right.set(xlabel="current across [m/s]", ylabel="tension at the vehicle [N]", title="one tether, below the boat")
    right.set(ylim=(0, 40), xlim=(0, 0.6))
    right.legend(fontsize=7, loc="upper left")
    fig.tight_layout()
    fig.savefig(folder / "world_tether.png", dpi=130)


def main() -> None:
    """The figure into a folder, the numbers to standard output."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "figures")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    figure(folder)


if __name__ == "__main__":
    main()
