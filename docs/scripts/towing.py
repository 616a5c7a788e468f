"""Tows of the Double Blueye as a carriage would log them, for docs/identification/towing.md: surge and rig as CSV.

The drag is that of the vehicle's own model and 6 N s2/m2 of the rig; inertia, tare, noise and a vibration of 12 Hz
on top. Run in any folder: python docs/scripts/towing.py
"""

import csv
from pathlib import Path

import numpy as np

from rovtwin.core.numerics import jax
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.dynamics import damping_wrench

SPEEDS = np.array([0.1, 0.15, 0.2, 0.25, 0.3, 0.35])
RIG, TARE, RATE, RAMP = 6.0, 1.7, 50.0, 0.1


def carriage(speed: float, hold: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and speeds: 4 s at rest, ramp, hold, ramp, 4 s at rest."""
    ramp = abs(speed) / RAMP
    t = np.arange(0.0, 8.0 + hold + 2 * ramp, 1 / RATE)
    return t, np.interp(t, np.cumsum([4.0, ramp, hold, ramp]), [0.0, speed, speed, 0.0])


def nu_of(speed: np.ndarray) -> np.ndarray:
    """Surge alone, shape (n, 6)."""
    return np.concatenate([speed[:, None], np.zeros((len(speed), 5))], axis=1)


def write(path: Path, with_vehicle: bool, rng: np.random.Generator) -> None:
    """One file of all tows, of rig and vehicle or of the rig alone."""
    model = load_vehicle("double_blueye").model()
    drag = jax.jit(jax.vmap(lambda nu: damping_wrench(model, nu)))
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["run", "t [s]", "speed [m/s]", "force [N]"])
        for speed in np.concatenate([SPEEDS, -SPEEDS]):
            t, v = carriage(float(speed), hold=20.0)
            force = RIG * np.abs(v) * v + TARE + rng.normal(0, 1.0, t.size) + 2 * np.sin(2 * np.pi * 12 * t)
            if with_vehicle:
                force += float(model.inertia[0, 0]) * np.gradient(v, t)
                force += np.asarray(drag(nu_of(v)))[:, 0]
            for row in zip(t, v + rng.normal(0, 0.002, t.size), force, strict=True):
                rows.writerow([f"{speed:+.2f}", *(f"{x:.4f}" for x in row)])


if __name__ == "__main__":
    rng = np.random.default_rng(1)
    write(Path("surge_tow.csv"), True, rng)
    write(Path("rig_tow.csv"), False, rng)
