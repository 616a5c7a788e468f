"""Where the numbers of the library's double_blueye come from: the thesis's own tests, fitted again.

    python docs/scripts/double_blueye_refits.py --t200 ../shared/data/t200

1. Thrust curve: power law with dead band through Blue Robotics' bollard test of the T200 at 16 V.
2. Roll and pitch decay, thesis (3.13) and (3.17): released from rest, so the printed fit without phase is itself fitted
   to simulated decays (printed parameters are those of a damped cosine without phase: +41 % and +16 % inertia).
3. Yaw, thesis table 3.6, with the thrust curve of 1 instead of force linear in command.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares, nnls

from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.assembly import assemble
from rovtwin.vehicle.thrust_curve import read_bollard_csv

BG, WEIGHT = 0.025, 294.3  # [m], [N]
INERTIA = {"roll": 2.69, "pitch": 0.85}  # about CG [kg m2]
# Thesis (3.13), (3.17): initial angle [rad], b/2 [1/s], omega [rad/s].
DECAYS = {"roll": (np.radians(33.42), 0.39, 0.95), "pitch": (np.radians(39.95), 0.50, 1.87)}
# Thesis table 3.6 without its first test, whose rate does not fit between its neighbours (errata 25).
YAW_COMMAND = np.array([0.4, 0.6, 0.8, 1.0])
YAW_RATE = np.array([0.442, 0.586, 0.731, 0.785])  # [rad/s]
YAW_MOMENT = 2 * 10.0 * 0.28  # at full command: table 5.3 and (5.2) [N m]


def thrust_shape(command, dead_band, exponent):
    """Share of the largest force, without sign."""
    return (np.maximum(np.abs(command) - dead_band, 0) / (1 - dead_band)) ** exponent


def fit_thrust(folder):
    """Dead band and exponent of a T200 at 16 V."""
    voltage, points = read_bollard_csv(folder / "16V.csv")
    command, force = points.T
    largest = np.where(command > 0, force[-1], -force[0])
    best = (np.inf, 0.0, 0.0)
    for dead_band in np.arange(0.05, 0.1001, 0.005):
        for exponent in np.arange(1.0, 2.001, 0.01):
            error = np.sign(command) * thrust_shape(command, dead_band, exponent) - force / largest
            best = min(best, (float(np.sqrt(np.mean(error**2))), dead_band, exponent))
    print(
        f"T200 at {voltage:g} V: {force[-1]:.1f} N ahead, {-force[0]:.1f} N astern; dead band {best[1]:.3f}, "
        f"exponent {best[2]:.2f}, rms {100 * best[0]:.2f} % of the largest force"
    )
    return best[1], best[2]


def decay(inertia, stiffness, linear, quadratic, angle, duration=12.0, dt=0.01):
    """Angle after release from rest [rad], every dt."""

    def rate(x):
        return np.array([x[1], -(stiffness * np.sin(x[0]) + linear * x[1] + quadratic * abs(x[1]) * x[1]) / inertia])

    x, angles = np.array([angle, 0.0]), [angle]
    for _ in range(round(duration / dt)):
        k1 = rate(x)
        k2 = rate(x + dt / 2 * k1)
        k3 = rate(x + dt / 2 * k2)
        k4 = rate(x + dt * k3)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        angles.append(x[0])
    return np.arange(len(angles)) * dt, np.array(angles)


def cosine_fit(t, angle):
    """b/2 and omega of phi0 exp(-b t / 2) cos(omega t), as the thesis fitted them."""
    return least_squares(lambda p: angle[0] * np.exp(-p[0] * t) * np.cos(p[1] * t) - angle, [0.4, 1.3]).x


def fit_decay(axis, quadratic):
    """Inertia and linear damping whose simulated decay is fitted by the printed parameters."""
    angle, half_b, omega = DECAYS[axis]

    def error(p):
        return cosine_fit(*decay(p[0], BG * WEIGHT, p[1], quadratic, angle)) - (half_b, omega)

    inertia, linear = least_squares(error, [INERTIA[axis] + 2.0, 2.0], diff_step=1e-3).x
    print(
        f"{axis}: D_Q {quadratic:.3g} from the parts; inertia in all {inertia:.3f} kg m2, "
        f"added {inertia - INERTIA[axis]:.3f} kg m2, D_L {linear:.3f} N m s/rad, with BG {BG} m"
    )


def fit_yaw(dead_band, exponent, linear):
    """Quadratic yaw damping from the steady turns."""
    moment = YAW_MOMENT * thrust_shape(YAW_COMMAND, dead_band, exponent)
    free, _ = nnls(np.stack([YAW_RATE, YAW_RATE**2], axis=1), moment)
    quadratic = float(YAW_RATE**2 @ (moment - linear * YAW_RATE) / np.sum(YAW_RATE**4))
    rms = np.sqrt(np.mean((linear * YAW_RATE + quadratic * YAW_RATE**2 - moment) ** 2))
    print(f"yaw: moments {np.round(moment, 2)} N m at {YAW_RATE} rad/s")
    print(f"yaw: both free, N_r {free[0]:.2f}, N_r|r| {free[1]:.2f}")
    print(f"yaw: N_r {linear:.2f} from the parts, then N_r|r| {quadratic:.2f}, rms {rms:.2f} N m")


def main():
    """Print all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--t200", type=Path, default=Path("../shared/data/t200"), help="folder with 16V.csv")
    dead_band, exponent = fit_thrust(parser.parse_args().t200)
    parts = load_vehicle("double_blueye").file.model_copy(update={"hydrodynamics": None})
    total = assemble(parts, "double_blueye without hydrodynamics")
    damping = total.damping()
    print(
        "parts alone: D_Q", np.round(np.diag(damping.quadratic_ahead), 3), "D_L", np.diag(damping.linear_ahead).round(3)
    )
    print("parts alone: inertia about CG", np.diag(total.solid.inertia).round(3))
    fit_decay("roll", damping.quadratic_ahead[3, 3])
    fit_decay("pitch", damping.quadratic_ahead[4, 4])
    fit_yaw(dead_band, exponent, damping.linear_ahead[5, 5])


if __name__ == "__main__":
    main()
