"""The figure and the numbers of docs/navigation.md.

python docs/scripts/navigation.py [--vehicle double_blueye] [--seeds 10] [--out docs/figures]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import chi2

from rovtwin.core.frames import euler_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.navigation.accuracy_bound import damping_slopes, inertial_bound, position_bound
from rovtwin.gnc.thesis.ekf import Ekf, EkfTuning
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.loop import Loop
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle

DT, SECONDS, SETTLED = 0.02, 300.0, 60.0
ACOUSTIC, DVL = {"position_sigma": 0.5, "position_rate": 1.0}, {"dvl_sigma": 0.005, "dvl_rate": 10.0}
ACCELEROMETER = {"accelerometer_sigma": 0.0308, "accelerometer_rate": 100.0}
TUNINGS = {
    "as printed": EkfTuning.as_printed(DT),
    "consistent, 0.03 N/√s": EkfTuning.consistent(),
    "consistent, 0.3 N/√s": EkfTuning.consistent(force_walk=0.3),
}
SCENARIOS = ("lawnmower_calm", "lawnmower_waves", "lawnmower_mismatch", "lawnmower_hard", "lawnmower_dropout")


@jax.jit
def fly(loop, memory):
    """Horizontal error (n, 2), its covariance (n, 2, 2) and NIS with its dof per sensor (n, n_sensors), each tick."""

    def tick(memory, k):
        memory, record = loop.tick(memory, k, DT)
        estimate, state = record.autopilot.estimate, record.state
        yaw = estimate.eta[5] - euler_from_quaternion(state.attitude)[2]
        error = jnp.concatenate([estimate.position[:2] - state.position[:2], yaw[None]])
        return memory, (error, estimate.covariance[:2, :2], estimate.nis, estimate.nis_dof)

    return jax.lax.scan(tick, memory, jnp.arange(round(SECONDS / DT)))[1]


def runs(name, vehicle, tuning, seeds):
    """Errors and covariances of some seeds of a scenario, the filter tuned as said."""
    out = []
    for seed in seeds:
        scenario = load_scenario(name, [f"vehicle={vehicle}", "autopilot=thesis_placed"], seed=seed)
        run = compose(scenario)
        autopilot = run.loop.autopilot
        observer = Ekf(run.model, tuning)
        loop = Loop(type(autopilot)(**(vars(autopilot) | {"observer": observer})), run.loop.twin)
        out.append(jax.device_get(fly(loop, loop.init(run.key, run.start, DT))))
    return [np.stack(parts) for parts in zip(*out, strict=True)]


def nees(error, P):
    """e' P^-1 e of the horizontal position, shape (n_runs, n)."""
    e = error[..., :2]
    return np.sum(e * np.linalg.solve(P, e[..., None])[..., 0], axis=-1)


def table_of_nees(vehicle, seeds):
    """NEES, error and NIS of the positions for each scenario and tuning; returns the runs in waves for the figure."""
    kept = {}
    print(f"\n{vehicle}, thesis_placed, seeds 1-{seeds}, {SETTLED:.0f} to {SECONDS:.0f} s")
    print("| scenario | " + " | ".join(f"{label}: NEES, error, sigma [m]" for label in TUNINGS) + " |")
    for name in SCENARIOS:
        cells = []
        for label, tuning in TUNINGS.items():
            error, P, _, _ = runs(name, vehicle, tuning, range(1, seeds + 1))
            late = slice(round(SETTLED / DT), None, 10)
            score = nees(error[:, late], P[:, late]).mean()
            rms = np.sqrt(np.mean(error[:, late, :2] ** 2))
            sigma = np.sqrt(np.mean(np.diagonal(P[:, late], axis1=-2, axis2=-1)))
            cells.append(f"{score:.3g}, {rms:.2f}, {sigma:.2f}")
            if name == "lawnmower_waves":
                kept[label] = error, P
        print(f"| `{name}` | " + " | ".join(cells) + " |", flush=True)
    return kept


def figure_nees(kept, path):
    """NEES over time of two tunings, and one run's error with its 3-sigma band."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2))
    labels = list(TUNINGS)[:2]
    for label, colour in zip(labels, ("tab:red", "tab:blue"), strict=True):
        error, P = kept[label]
        t = DT * np.arange(error.shape[1])
        left.semilogy(t, nees(error, P).mean(0), color=colour, label=label)
        sigma = 3 * np.sqrt(P[0, :, 0, 0])
        right.plot(t, error[0, :, 0], color=colour, lw=1.2)
        right.fill_between(t, -sigma, sigma, color=colour, alpha=0.2, lw=0)
    count = len(error)
    low, high = chi2.ppf([0.025, 0.975], 2 * count) / count
    left.axhspan(low, high, color="tab:green", alpha=0.4, lw=0, label=f"95 % of consistent filters ({count} runs)")
    left.set(xlabel="time [s]", ylabel="NEES, horizontal position", title="lawnmower_waves", ylim=(0.3, None))
    left.legend(fontsize=8)
    right.set(xlabel="time [s]", ylabel="north, estimate − truth [m]", title="one run, with ±3 sigma")
    right.set_ylim(-4, 4)
    fig.tight_layout()
    fig.savefig(path, dpi=130)
    print(f"wrote {path}")


def table_of_bounds(vehicles):
    """Position bounds for vehicles and speeds, surge and sway."""
    print("\nbound [m] per axis, 0.03 N/sqrt(s), positions 0.5 m at 1 Hz")
    print("| vehicle, speed | d surge, sway [N s/m] | positions | and accelerometer | and DVL |")
    for name in vehicles:
        model = load_vehicle(name).model()
        for speed in (0.0, 0.1, 0.2, 0.3):
            cells = [
                position_bound(model, speed, **ACOUSTIC, force_walk=0.03, **extra) for extra in ({}, ACCELEROMETER, DVL)
            ]
            slopes = damping_slopes(model, speed)
            numbers = " | ".join(f"{surge:.3f}, {sway:.3f}" for surge, sway in cells)
            print(f"| `{name}`, {speed} m/s | {slopes[0]:.1f}, {slopes[1]:.1f} | {numbers} |")
    for walk in (0.0, 1e-5):
        bounds = [inertial_bound(**ACOUSTIC, **ACCELEROMETER, accelerometer_bias_walk=walk, **e) for e in ({}, DVL)]
        print(f"inertial, bias walk {walk:g}: {bounds[0]:.3f}; with the DVL {bounds[1]:.4f}")
    model = load_vehicle("double_blueye_thesis").model()
    for when in ("before", "mean", "after"):
        print(f"{when}: {position_bound(model, 0.22, **ACOUSTIC, force_walk=0.03, when=when).round(4)}")


def main():
    """Print the tables and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicle", default="double_blueye")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    arguments = parser.parse_args()
    table_of_bounds(("double_blueye", "double_blueye_thesis"))
    kept = table_of_nees(arguments.vehicle, arguments.seeds)
    figure_nees(kept, arguments.out / "navigation_nees.png")


if __name__ == "__main__":
    main()
