"""The figure of docs/guidance_and_control.md: the model-based autopilot beside the thesis's, same seed, same water.

python docs/scripts/model_based.py [--scenario lawnmower_hard] [--seed 1] [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.runs.compose.composition import compose
from rovtwin.runs.run import chunks
from rovtwin.scenario.files import load_scenario

AUTOPILOTS = {"thesis_placed": "#c0504d", "model_based": "#1f5fa8"}


def fly(scenario, autopilot, seed):
    """Truth, estimate, its standard deviation, commands and set-point at every tick."""
    given = load_scenario(scenario, [f"autopilot={autopilot}"], seed=seed)
    run = compose(given)
    records = list(chunks(run.loop, run.key, run.start, given.control_dt, given.duration))

    def joined(pick):
        return np.concatenate([np.asarray(pick(r)) for r in records])

    return {
        "t": given.control_dt * np.arange(len(joined(lambda r: r.state.position))),
        "truth": joined(lambda r: r.state.position),
        "error": joined(lambda r: r.autopilot.estimate.position) - joined(lambda r: r.state.position),
        "std": np.sqrt(joined(lambda r: np.diagonal(r.autopilot.estimate.covariance, axis1=1, axis2=2)[:, :3])),
        "u": joined(lambda r: r.autopilot.command.u),
        "reference": joined(lambda r: r.autopilot.reference.position[:, :2]),
    }


def draw(flights, scenario, out):
    """Path, error of the estimate, and commands."""
    fig, (path, error, thrust) = plt.subplots(
        1, 3, figsize=(13, 3.8), gridspec_kw={"width_ratios": [1.5, 1.2, 1.2]}, layout="constrained"
    )
    way = flights["model_based"]["reference"]
    path.plot(way[:, 1], way[:, 0], color="0.6", lw=4, alpha=0.5, label="path")
    for (name, colour), width in zip(AUTOPILOTS.items(), (1.0, 1.4), strict=True):
        f = flights[name]
        path.plot(f["truth"][:, 1], f["truth"][:, 0], color=colour, lw=width, label=name)
        error.plot(f["t"], f["error"][:, 0], color=colour, lw=1)
        error.fill_between(f["t"], -2 * f["std"][:, 0], 2 * f["std"][:, 0], color=colour, alpha=0.12, lw=0)
        some = (f["t"] > 60) & (f["t"] < 90)
        thrust.plot(f["t"][some], f["u"][some, 2], color=colour, lw=1)
    path.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", title=f"{scenario}: where it went")
    path.set_ylim(-2.6, 7.5)
    path.legend(loc="lower center", ncols=3, frameon=False, fontsize="small")
    error.set(xlabel="time [s]", ylabel="error of the estimate, north [m]", title="what it believes, and ± 2 sigma")
    error.set_ylim(-1.0, 1.0)
    thrust.set(xlabel="time [s]", ylabel="command of a heave thruster", title="what the thrusters do")
    fig.savefig(out / "model_based.png", dpi=110)


def main():
    """Fly and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="lawnmower_hard")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    args = parser.parse_args()
    draw({name: fly(args.scenario, name, args.seed) for name in AUTOPILOTS}, args.scenario, args.out)


if __name__ == "__main__":
    main()
