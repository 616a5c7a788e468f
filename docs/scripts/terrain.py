"""The figure of terrain following in docs/guidance_and_control.md.

python docs/scripts/terrain.py [--seed 1] [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.numerics import as_array, jax
from rovtwin.runs.compose.world import relief_of
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario

NAME = "terrain_following"


def main():
    """Fly it and draw floor, depth and altitude."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    options = parser.parse_args()
    scenario = load_scenario(NAME, seed=options.seed)
    flight = fly(scenario)
    t, eta = flight.log["truth/eta"].t, flight.log["truth/eta"].values
    relief = relief_of(scenario.world)
    floor = np.asarray(jax.vmap(lambda at: relief.under(at)[0])(as_array(eta[:, :2])))
    desired = scenario.waypoints[0].altitude

    figure, (deep, high) = plt.subplots(2, 1, figsize=(8, 4.6), sharex=True, height_ratios=(2, 1))
    deep.fill_between(t, floor, floor.max() + 0.3, color="#d9c7a3", lw=0)
    deep.plot(t, floor, "#8c6d31", lw=1, label="floor below the vehicle")
    deep.plot(t, eta[:, 2], "C0", lw=1.2, label="vehicle")
    deep.set(ylabel="depth [m]", ylim=(floor.max() + 0.3, 0))
    deep.legend(loc="upper right", frameon=False, fontsize=8)
    high.plot(t, floor - eta[:, 2], "C0", lw=1)
    high.axhline(desired, color="0.6", lw=0.8, ls="--")
    high.set(xlabel="time [s]", ylabel="altitude [m]", ylim=(desired - 0.2, desired + 0.2), xlim=(0, t[-1]))
    figure.suptitle(f"{scenario.vehicle}, {NAME}, seed {options.seed}, {scenario.autopilot.type}", fontsize=9)
    figure.tight_layout()
    figure.savefig(options.out / "terrain.png", dpi=120)
    print(
        f"floor {floor.min():.2f} to {floor.max():.2f} m, altitude error {flight.figures['altitude_rms_m']:.3f} m rms"
    )


if __name__ == "__main__":
    main()
