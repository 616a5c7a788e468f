"""How a real Underwater GPS errs: 24 minutes of a Water Linked G2, vehicle out to 100 m and back from an anchored boat.

python docs/scripts/ugps_errors.py docs/figures/ugps_errors.png

Nothing in the log says where the vehicle truly was. What it does over seconds is known all the same: it moves smoothly.
So the track is turned into north and east by the antenna's own yaw, taken apart into range and bearing, and each is
compared with a smooth curve around every fix (quadratic in time, over +-7, +-15 and +-30 s, tricube weights). The curve
takes part of the error with it. How much is known: for errors of covariance C the residuals of the linear fit H have
covariance (I - H) C (I - H)', so that the variances of white noise and of a first-order (Gauss-Markov) process that
explain the residuals best follow by non-negative least squares, for each time constant tried.
"""

import csv
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import nnls
from scipy.sparse import csr_array

from rovtwin.core.numerics import jax, jnp
from rovtwin.simulation.sensors.acoustic import AcousticErrors

DATA = Path(__file__).parents[2] / ".." / "shared" / "data" / "ugps_g2"
IN_WATER = (300.0, 1340.0)  # of the log; before and after it the locator is on deck [s]
WINDOWS = (7.0, 15.0, 30.0)
RANGES = ((4, 10), (10, 20), (20, 35), (35, 50), (50, 70), (70, 85), (85, 110))
TAUS = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0)
BURST = 4.0  # robust standard deviations beyond which a residual counts as one of a burst


def column(name, *keys):
    """Columns of a CSV file as arrays."""
    with (DATA / name).open() as file:
        rows = list(csv.DictReader(file))
    return [
        np.array([float(row[k] == "True" if row[k] in ("True", "False") else row[k]) for row in rows]) for k in keys
    ]


def fixes():
    """Time, range and bearing (north-based) of every new valid fix in the water, and its own standard deviation."""
    t, valid, x, y, own = column("g2_acoustic.csv", "timestamp", "position_valid", "x", "y", "std")
    t_yaw, yaw = column("g2_orientation.csv", "timestamp", "yaw")
    new = np.r_[True, (np.diff(x) != 0) | (np.diff(y) != 0)] & (valid > 0)
    heading = np.interp(t, t_yaw, np.unwrap(np.radians(yaw)))
    bearing = np.unwrap((np.arctan2(y, x) + heading)[new])
    t = t[new] - t[0]
    inside = (t > IN_WATER[0]) & (t < IN_WATER[1])
    return t[inside], np.hypot(x, y)[new][inside], bearing[inside], own[new][inside]


def residual_maker(t, window):
    """I - H of the local quadratic fit, shape (n, n)."""
    H = np.eye(len(t))
    for i, now in enumerate(t):
        near = np.flatnonzero(np.abs(t - now) < window)
        s = (t[near] - now) / window
        weight = (1 - np.abs(s) ** 3) ** 3
        A = np.vander(s, 3)
        if len(near) > 5:
            H[i, near] -= np.linalg.solve(A.T @ (weight[:, None] * A), A.T * weight)[-1]
    return csr_array(H)


def explained(t, residuals, makers, bins, parts):
    """Variances of the parts of an error, for the time constant that explains the mean square residuals best.

    Args:
        t: Times of the fixes.
        residuals: Per window, shape (n,).
        makers: Per window, shape (n, n).
        bins: Which fixes are in which range, bool, shape (b, n).
        parts: tau -> covariances of unit variance.
    """
    best = None
    for tau in TAUS:
        columns, target = [], []
        for maker, residual in zip(makers, residuals, strict=True):
            usual = np.abs(residual) < BURST * 1.4826 * np.median(np.abs(residual))
            spread = [maker.multiply(maker @ C).sum(axis=1) for C in parts(tau)]
            for chosen in bins:
                k = chosen & usual
                measured = np.mean(residual[k] ** 2)
                columns.append([np.mean(s[k]) / measured for s in spread])  # relative: each bin counts alike
                target.append(1.0)
        found, misfit = nnls(np.array(columns), np.array(target))
        if best is None or misfit < best[0]:
            best = misfit, tau, found
    return best


def gaps(t, reach):
    """Intervals between fixes, and the range at which they began."""
    return np.diff(t), reach[:-1]


@jax.jit
def simulated(key, t, reach):
    """Errors along and across of the twin's own model at the log's times and ranges, shape (n, 2), and validity."""
    errors = AcousticErrors()

    def fix(state, seen):
        k, dt, r = seen
        state, error, valid = errors.step(state, jnp.stack([r, 0.0]), jax.random.fold_in(key, k), dt)
        return state, (error, valid)

    rows = (jnp.arange(t.size), jnp.concatenate([jnp.full(1, 0.6), jnp.diff(t)]), reach)
    return jax.lax.scan(fix, errors.init(key), rows)[1]


def draw(path, t, reach, across, along, makers, after_gaps):
    """Residuals over time, and their spread against range beside that of the twin's model over the same ranges."""
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained", width_ratios=(1.4, 1))
    axes[0].plot(t - t[0], across[2], ".", markersize=2, label="across")
    axes[0].plot(t - t[0], along[2], ".", markersize=2, label="along")
    axes[0].plot(after_gaps - t[0], np.full(len(after_gaps), -6.5), "|", color="black", label="gap over 1.5 s")
    axes[0].plot(t - t[0], reach / 20, color="grey", linewidth=0.8, label="range / 20")
    axes[0].set(xlabel="time [s]", ylabel="residual of +-30 s fits [m]", ylim=(-7, 7))
    axes[0].legend(fontsize="small", ncols=2)
    runs = [np.asarray(simulated(jax.random.key(seed), t, reach)[0]) for seed in range(20)]
    middles = [np.mean(limits) for limits in RANGES]
    for i, (residuals, name) in enumerate(((across, "across"), (along, "along"))):
        for window, maker, residual, shade in zip(WINDOWS, makers, residuals, (0.35, 0.65, 1.0), strict=True):
            flown = np.stack([maker @ run[:, 1 - i] for run in runs])
            bins = [(reach >= low) & (reach < high) for low, high in RANGES]
            colour = ("tab:blue", "tab:orange")[i]
            axes[1].plot(middles, [np.std(residual[k]) for k in bins], "o", color=colour, alpha=shade, markersize=4)
            model = [np.std(flown[:, k]) for k in bins]
            axes[1].plot(middles, model, color=colour, alpha=shade, label=f"{name}, +-{window:g} s")
            print(f"model {name} +-{window:g} s:", " ".join(f"{one:.2f}" for one in model))
    axes[1].set(xlabel="range [m]", ylabel="spread of residuals [m]", yscale="log")
    axes[1].set_title("dots: the log; lines: the twin's model", fontsize="small")
    axes[1].legend(fontsize="x-small", ncols=2)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def main(path):
    """Fit, print, draw."""
    if not DATA.is_dir():
        print(f"skipped: there is no {DATA}")
        return
    t, reach, bearing, own = fixes()
    print(f"{len(t)} fixes in {t[-1] - t[0]:.0f} s, range {reach.min():.1f} to {reach.max():.1f} m")
    makers = [residual_maker(t, w) for w in WINDOWS]
    along, across = [M @ reach for M in makers], [reach * (M @ bearing) for M in makers]
    bins = np.array([(reach >= low) & (reach < high) for low, high in RANGES])
    lag = np.abs(t[:, None] - t)
    eye = np.eye(len(t))
    misfit, tau_r, (white_r, slow_r) = explained(t, along, makers, bins, lambda tau: (eye, np.exp(-lag / tau)))
    print(f"range: white {white_r**0.5:.3f} m, slow {slow_r**0.5:.3f} m over {tau_r:g} s (misfit {misfit:.2f})")
    # (M bearing) is in radians: an error of so many metres across is one of so many over the range.
    inverse = 1.0 / np.maximum(reach, 1.0)

    def bearing_parts(tau):
        slow = np.exp(-lag / tau)
        return np.diag(inverse**2), slow * np.outer(inverse, inverse), eye, slow

    scaled = [reach * (M @ bearing) / np.maximum(reach, 1.0) for M in makers]
    misfit, tau_b, found = explained(t, scaled, makers, bins, bearing_parts)
    white_a, slow_a = found[:2] ** 0.5
    white_b, slow_b = np.degrees(found[2:] ** 0.5)
    print(f"across: white {white_a:.3f} m + {white_b:.3f} deg, slow {slow_a:.3f} m + {slow_b:.3f} "
          f"deg over {tau_b:g} s (misfit {misfit:.2f})")  # fmt: skip
    for low, high in RANGES:
        k = (reach >= low) & (reach < high)
        row = " ".join(f"{np.std(e[k]):.2f}" for e in across) + " | " + " ".join(f"{np.std(e[k]):.2f}" for e in along)
        print(f"  {low}-{high} m: across, along over {WINDOWS} s: {row}; own std {np.median(own[k]):.1f}")
    draw(path, t, reach, across, along, makers, t[np.r_[False, np.diff(t) > 1.5]])
    robust = across[1] / np.maximum(0.1, 0.02 * reach)
    print(
        f"bursts beyond {BURST} sd: {np.mean(np.abs(robust) > BURST * 1.4826 * np.median(np.abs(robust))):.3f} of fixes"
    )
    dt, at = gaps(t, reach)
    for low, high in ((0, 50), (50, 85), (85, 110)):
        k = (at >= low) & (at < high)
        long = k & (dt > 1.5)
        print(
            f"gaps at {low}-{high} m: {k.sum()} intervals, median {np.median(dt[k]):.2f} s, mean {dt[k].mean():.2f} s, "
            f"beyond 1.5 s: {long.sum()} (mean {dt[long].mean():.1f} s, longest {dt[k].max():.1f} s)"
        )
    jumps = np.abs(np.diff(across[2]))
    far = at > 30
    for name, k in (("after a gap", far & (dt > 1.5)), ("else", far & (dt <= 1.5))):
        print(f"rms jump of the bearing beyond 30 m {name}: {np.sqrt(np.mean((jumps / at)[k] ** 2)):.4f} rad")
    print("jump across of the fix after a gap beyond 1.5 s [m]:", np.round(np.sort(jumps[dt > 1.5])[::-1][:12], 1))
    print("usual jump across (median, 95 %, 99 %):", np.round(np.percentile(jumps[dt <= 1.5], [50, 95, 99]), 2))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "docs/figures/ugps_errors.png")
