"""The figure of docs/fail_safes.md: what a model-based Double Blueye does when something breaks.

python docs/scripts/fail_safes.py [--scenario lawnmower_hard] [--seed 1] [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario

CASES = {
    "a leak at 60 s": ["faults=[{fault: leak, at: 60}]"],
    "battery at 20 % after 60 s": [
        "battery={charge: 0.19}",
        "sensors.battery=true",
        "autopilot.supervisor.battery_low.after=60",
    ],
    "port surge lost at 60 s": ["faults=[{thruster: port.surge, fault: dead, at: 60}]"],
    "port heave lost at 60 s": ["world.net_buoyancy=4", "faults=[{thruster: port.heave, fault: dead, at: 60}]"],
}
OWN = ("no longer used", "surfacing", "returning", "surfaced", "returned")


def draw(axes, name, flight):
    """Track from above and depth, with what was decided where and when."""
    above, deep = axes
    t, eta = flight.log["truth/eta"].t, flight.log["truth/eta"].values
    leg = flight.log["autopilot/leg"].values
    corners = np.vstack([leg[0, :2], leg[np.r_[True, np.any(np.diff(leg[:, 3:5], axis=0), axis=1)], 3:5]])
    above.plot(corners[:, 1], corners[:, 0], "0.75", lw=1, label="legs")
    above.plot(eta[:, 1], eta[:, 0], "C0", lw=1.2, label="track")
    above.plot(*eta[-1, 1::-1], "C0o", ms=5)
    above.set(title=name, xlabel="east [m]", ylabel="north [m]", aspect="equal", xlim=(-1.5, 10), ylim=(-1.5, 7.5))
    deep.plot(t, eta[:, 2], "C0", lw=1.2)
    decisions = [one for one in flight.figures["decisions"] if any(word in one["what"] for word in OWN)]
    for k, one in enumerate(decisions):
        deep.axvline(one["t"], color="#b2182b", lw=0.8, ls="--")
        words = f"{one['t']:.0f} s: {one['what']}"
        deep.text(
            0.03, 0.06 + 0.1 * (len(decisions) - 1 - k), words, transform=deep.transAxes, fontsize=7, color="#b2182b"
        )
        row = int(np.argmin(np.abs(t - one["t"])))
        above.plot(*eta[row, 1::-1], "o", color="#b2182b", ms=4)
    end = "completed" if flight.completed else flight.figures["phase"]
    deep.set(xlabel="time [s]", ylabel="depth [m]", ylim=(4.6, -0.1), xlim=(0, 185))
    deep.text(
        0.97, 0.9, f"{end}, {flight.figures['duration_s']:.0f} s", transform=deep.transAxes, ha="right", fontsize=8
    )


def main():
    """Fly the cases and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="lawnmower_hard")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    args = parser.parse_args()
    figure, grid = plt.subplots(2, len(CASES), figsize=(13, 6.2), layout="constrained", height_ratios=[3, 2])
    for column, (name, changes) in enumerate(CASES.items()):
        flight = fly(load_scenario(args.scenario, ["autopilot=model_based", *changes], seed=args.seed))
        print(name, flight.figures["phase"], flight.figures["reason"], flight.figures["decisions"])
        draw(grid[:, column], name, flight)
    grid[0, 0].legend(fontsize=8, frameon=False, loc="lower right")
    figure.savefig(args.out / "fail_safes.png", dpi=75)


if __name__ == "__main__":
    main()
