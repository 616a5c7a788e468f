"""The figure of docs/vehicles.md: how fast pitch grows or dies out against surge speed.

python docs/scripts/munk_figure.py docs/figures/munk.svg
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.numerics import jax
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.analysis.stability import depth_held, linearised, reach, stability, steady_speed

VEHICLES = {"double_blueye_thesis": "tab:red", "double_blueye": "tab:blue"}
PITCH, THETA = 4, 7


def fastest_pitch(A):
    """Largest real part [1/s] among eigenvalues in which theta moves, the neutral one of the constraint left out."""
    values, vectors = np.linalg.eig(A[np.ix_([0, 2, PITCH, THETA], [0, 2, PITCH, THETA])])
    moves = (np.abs(vectors[3]) > 1e-6) & (np.abs(values) > 1e-9)
    return values.real[moves].max()


def main(path):
    """Draw and save."""
    at = jax.jit(linearised)
    figure, axes = plt.subplots(figsize=(7.2, 3.6), layout="constrained")
    for name, colour in VEHICLES.items():
        model = load_vehicle(name).model()
        speeds = np.linspace(0.005, 0.8, 200)
        As = [np.asarray(at(model, u)) for u in speeds]
        held = [fastest_pitch(depth_held(model, A, u)) for A, u in zip(As, speeds, strict=True)]
        axes.plot(speeds, held, color=colour, label=f"{name}, depth held")
        axes.plot(speeds, [fastest_pitch(A) for A in As], color=colour, linestyle="--", label=f"{name}, free")
        top = steady_speed(model, 0, reach(model)[0, 1])
        axes.axvline(top, color=colour, linewidth=0.8, linestyle=":")
        found = stability(model)
        print(name, found, f"top speed {top:.3f} m/s")
        axes.plot(found.pitch_static, 0, "o", color=colour)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set(xlabel="surge speed [m/s]", ylabel="growth of pitch [1/s]", xlim=(0, 0.8), ylim=(-0.6, 0.6))
    axes.annotate("grows", (0.01, 0.5))
    axes.annotate("dies out", (0.01, -0.55))
    axes.legend(loc="upper right", fontsize="small")
    axes.set_title("dots: sqrt(k / (A33 - A11)); dotted: top speed of each", fontsize="small")
    # No date and fixed ids: the same figure is the same file.
    plt.rcParams["svg.hashsalt"] = "rovtwin"
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "docs/figures/munk.svg")
