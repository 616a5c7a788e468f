"""The figure of piloting in docs/guidance_and_control.md.

python docs/scripts/piloting.py [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario

WORDS = {10: "down", 22: "ahead", 42: "ahead, turning", 62: "to starboard", 75: "stay"}


def main():
    """Fly the example and draw track, velocities and depth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    options = parser.parse_args()
    flight = fly(load_scenario("examples/piloting.yaml"))
    eta, nu = flight.log["truth/eta"], flight.log["truth/nu"]
    figure, (above, beside) = plt.subplots(1, 2, figsize=(9, 3.8), width_ratios=(1, 1.7))
    above.plot(eta["y"], eta["x"], "C0", lw=1.2)
    for at, words in WORDS.items():
        k = int(np.argmin(np.abs(eta.t - at)))
        above.plot(eta["y"][k], eta["x"][k], "o", color="#b2182b", ms=4)
        if at > 10:
            place, shift = (eta["y"][k], eta["x"][k]), (6, -12 if at == 75 else 3)
            above.annotate(f"{at} s: {words}", place, shift, textcoords="offset points", fontsize=7)
        beside.axvline(at, color="0.85", lw=0.8)
    above.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", xlim=(-1.0, 5.5))
    for name, label in (("u", "surge"), ("v", "sway"), ("w", "heave")):
        beside.plot(nu.t, nu[name], lw=1.1, label=f"{label} [m/s]")
    beside.plot(eta.t, eta["z"] / 10, "0.4", lw=1.1, label="depth / 10 [m]")
    beside.set(xlabel="time [s]", xlim=(0, 90), ylim=(-0.06, 0.34))
    beside.legend(frameon=False, fontsize=8, ncols=2, loc="upper right")
    figure.tight_layout()
    figure.savefig(options.out / "piloting.png", dpi=120)


if __name__ == "__main__":
    main()
