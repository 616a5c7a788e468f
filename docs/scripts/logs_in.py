"""Figure of docs/identification/logs_in.md: how the tank's motion tells that commands are late.

Needs the public logs beside the repository. Run: python docs/scripts/logs_in.py
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from rovtwin.identification.logs.evidence_file import read_evidence
from rovtwin.identification.logs.motion import Motion
from rovtwin.identification.logs.readers import read_tests
from rovtwin.identification.logs.response import Regression, thruster_forces
from rovtwin.report.parts.style import BLACK, BLUE, GREY, ORANGE, SMALL, WIDTH, dress, name_panel
from rovtwin.vehicle import load_vehicle

ROOT = Path(__file__).parents[2]
OFFSET = 0.32  # by which they are made late [s]
SURGE = 0


def main() -> None:
    """Draw it."""
    evidence = read_evidence(ROOT / "examples" / "bluerov2_heavy_tank" / "evidence.yaml")
    model = load_vehicle("bluerov2_heavy").model()
    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 3))
    lags = np.arange(-1.0, 0.61, 0.05)
    for test, colour in zip(read_tests(evidence, load_vehicle("bluerov2_heavy"))[::2], (BLUE, ORANGE), strict=True):
        record = replace(test.record, t_command=test.record.t_command + OFFSET)
        motion = Motion.of(record)
        regression = Regression.of(model, motion)
        assert regression is not None
        answers = [regression.against(thruster_forces(model, motion, lag)).explainable for lag in lags]
        left.plot(lags, 100 * np.array(answers)[:, :3].mean(axis=1), color=colour, label=record.name[:5])
        if colour == BLUE:
            good, y = regression.good, regression.left[:, SURGE]
            t = motion.t[good]
            right.plot(t, y, color=BLACK, linewidth=0.9, label="measured")
            for lag, style, label in ((0.0, GREY, "0.32 s late"), (-OFFSET, BLUE, "as they were given")):
                force = thruster_forces(model, motion, lag)[good]
                force = force - regression.basis @ (regression.basis.T @ force)
                fit = force @ np.linalg.lstsq(force, y, rcond=None)[0]
                right.plot(t, fit, color=style, linewidth=1.3, label=f"of commands {label}")
            right.set_xlim(20, 40)
            inside = (t > 20) & (t < 40)
            right.set_ylim(1.9 * y[inside].min(), 1.9 * y[inside].max())
    left.axvline(-OFFSET, color=GREY, linewidth=0.8, linestyle=":")
    dress(left, "[%]", "commands moved by [s]").set_ylim(0, 100)
    dress(right, "[m/s2]", "time [s]")
    name_panel(left, "accelerations that thrusters explain")
    name_panel(right, "surge acceleration, run_1")
    left.legend(fontsize=SMALL, frameon=False, loc="lower left")
    right.legend(fontsize=SMALL, frameon=False, loc="lower center", ncols=2)
    figure.savefig(ROOT / "docs" / "figures" / "identification_logs_in.png", dpi=130)


if __name__ == "__main__":
    main()
