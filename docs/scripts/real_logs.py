"""The figures of docs/identification/real_logs.md: what was never fitted, measured and predicted.

python docs/scripts/real_logs.py
"""

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from rovtwin.identification.diagnostics.validation import Prediction
from rovtwin.identification.identify import identify
from rovtwin.identification.logs.evidence_file import read_evidence
from rovtwin.identification.logs.readers import read_tests
from rovtwin.vehicle import load_vehicle

ROOT = Path(__file__).parents[2]


def predictions(example: str) -> dict[tuple[str, float | None], Prediction]:
    """Of everything held out, by record and window."""
    evidence = read_evidence(ROOT / "examples" / example / "evidence.yaml")
    assert evidence.vehicle is not None
    vehicle, file = load_vehicle(evidence.vehicle), evidence.file
    tests = read_tests(evidence, vehicle)
    fit, held_out = ([t.record for t in tests if t.use == use] for use in ("fit", "validate"))
    found = identify(vehicle, fit, validate=held_out, free=file.free, prior=file.prior, options=file.options)
    return {(p.record, p.window): p for p in found.held_out}


def draw(axes: Any, prediction: Prediction, signal: str, column: int, label: str) -> None:
    """Measured and predicted, with the fit in a corner."""
    t, measured, predicted = prediction.readings[signal]
    order = np.argsort(t)
    t = t[order] - t.min()
    axes.plot(t, measured[order, column], "0.5", lw=1, label="measured")
    axes.plot(t, predicted[order, column], "C0", lw=1.2, label="predicted")
    name = {"gyro": "pqr", "velocity": "uvw"}[signal][column]
    fit = prediction.scores[f"{signal}.{name}"].fit
    axes.text(0.99, 0.04, f"fit {fit:.0f} %", transform=axes.transAxes, ha="right", fontsize=8)
    axes.set(ylabel=label, xlim=(0, t[-1]))


def liu() -> None:
    """Rates of all_3 in one run and every second, and yaw of yaw_4."""
    found = predictions("bluerov_liu")
    figure = plt.figure(figsize=(11, 8), layout="constrained")
    grid = figure.add_gridspec(4, 2)
    ways = ((None, "one run from the first state"), (1.0, "restarted from the readings every second"))
    for column, (window, how) in enumerate(ways):
        for row, name in enumerate("pqr"):
            axes = figure.add_subplot(grid[row, column], title=f"all_3, {how}" if row == 0 else "")
            draw(axes, found["all_3", window], "gyro", row, f"{name} [rad/s]")
    last = figure.add_subplot(grid[3, :], title="yaw_4, one run from the first state", xlabel="time [s]")
    draw(last, found["yaw_4", None], "gyro", 2, "r [rad/s]")
    figure.legend(*last.get_legend_handles_labels(), loc="outside lower right", ncols=2, frameon=False)
    figure.savefig(ROOT / "docs" / "figures" / "identification_real_logs_liu.png", dpi=75)


def tank() -> None:
    """Velocities of the last 30 %."""
    found = [p for (_, window), p in predictions("bluerov2_heavy_tank").items() if window is None]
    figure, grid = plt.subplots(3, len(found), figsize=(11, 6), layout="constrained", squeeze=False)
    for column, prediction in enumerate(found):
        for row, name in enumerate("uvw"):
            draw(grid[row, column], prediction, "velocity", row, f"{name} [m/s]")
        grid[0, column].set_title(prediction.record)
        grid[2, column].set_xlabel("time [s]")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower right", ncols=2, frameon=False)
    figure.savefig(ROOT / "docs" / "figures" / "identification_real_logs_tank.png", dpi=75)


if __name__ == "__main__":
    liu()
    tank()
