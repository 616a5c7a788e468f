"""Roll decays of the Double Blueye as a compass would log them, for docs/identification/decay.md: CSV files.

A tilt by hand, a release at 5 s, 20 Hz, noise of 0.3 deg, trim of 1.5 deg; the coefficients are those of double_blueye.
The third file has 1 kg of lead 0.3 m under the axis. Run in any folder: python docs/scripts/decay.py
"""

import csv
from pathlib import Path

import numpy as np

from rovtwin.identification.decay.motion import swing

J, K, LINEAR, QUADRATIC = 5.17, 7.36, 3.04, 4.04
ADDED_STIFFNESS = 1.0 * (1 - 1000 / 11340) * 9.81 * 0.30
ADDED_INERTIA = 1.0 * 0.30**2


def write(path: Path, tilt_deg: float, stiffness: float, inertia: float, rng: np.random.Generator) -> None:
    """One test."""
    t = np.arange(0.0, 25.0, 0.05)
    free = t >= 5.0
    angle = np.radians(tilt_deg) * np.minimum(t / 2.0, 1.0)
    c, b, a = stiffness / inertia, LINEAR / inertia, QUADRATIC / inertia
    angle[free] = swing(t[free], (np.radians(tilt_deg), 0.0), c, b, a, 0.01)
    measured = np.degrees(angle) + 1.5 + rng.normal(0, 0.3, t.size)
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["t", "roll_deg"])
        rows.writerows([f"{x:.2f}", f"{y:.2f}"] for x, y in zip(t, measured, strict=True))


if __name__ == "__main__":
    rng = np.random.default_rng(1)
    write(Path("roll_1.csv"), -33.4, K, J, rng)
    write(Path("roll_2.csv"), 28.0, K, J, rng)
    write(Path("roll_1kg.csv"), -30.0, K + ADDED_STIFFNESS, J + ADDED_INERTIA, rng)
    print(f"--weight {ADDED_STIFFNESS:.3f} {ADDED_INERTIA:.3f}")
