"""The figures of docs/positioning.md.

PYTHONPATH=. python docs/scripts/positioning.py [--keep square_corners.npz] [--out docs/figures]

With --keep, corners of rendered images as tests/positioning/accuracy.py leaves them; else projected corners with noise.
"""

import argparse
from pathlib import Path

import cv2
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from tests.positioning.accuracy import FACE, run_square
from tests.positioning.tracks import rotations

from rovtwin.positioning.detection import Detector
from rovtwin.positioning.port_study import port_cost, port_figure
from rovtwin.simulation.camera import renderer
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.camera import cameras_of

COLOURS = {"truth": "0.2", "Luenberger, thesis": "#c0392b", "filter": "#1f5a87", "smoother": "#3a8a4d"}


def track_figure(keep: Path | None):
    """The square from above, and errors over time."""
    run = run_square(0, keep)
    t, truth = run.drive.t, run.drive.position
    figure = plt.figure(figsize=(10.5, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.5])
    left.plot(truth[:, 1], truth[:, 0], color=COLOURS["truth"], lw=3, alpha=0.35, label="truth")
    for name in ("Luenberger, thesis", "filter"):
        p = run.results[name].position
        left.plot(p[:, 1], p[:, 0], color=COLOURS[name], lw=1.3, label=name)
    left.set(xlabel="east [m]", ylabel="north [m]", aspect="equal", title="the square of thesis 6.3")
    for name in ("Luenberger, thesis", "filter", "smoother"):
        e = 1e3 * np.linalg.norm(run.results[name].position - truth, axis=1)
        right.semilogy(t, np.maximum(e, 0.1), color=COLOURS[name], lw=1.3, label=name)
    right.set(xlabel="time [s]", ylabel="position error [mm]", title="error", ylim=(0.3, 1e3))
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(frameon=False, fontsize=8)
    return figure


def detection_figure(distance: float = 2.0):
    """The markers on the box as the camera sees them, with the corners found."""
    scene, camera = load_scene("mclab"), cameras_of(load_vehicle("double_blueye"))[0]
    R = rotations(np.array([[0.02, 0.03, 0.05]]))[0]
    place = np.array([FACE - distance, 0.0, 0.75]) - R @ camera.position
    image = renderer(scene, camera, kind="raycast").image(place, R, seed=0)
    found = Detector()(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    figure, axis = plt.subplots(figsize=(8, 4.45), layout="constrained")
    axis.imshow(image)
    for number, corners in zip(found.ids, found.corners, strict=True):
        axis.plot(*np.vstack([corners, corners[:1]]).T, color="#e74c3c", lw=1.5)
        axis.plot(*corners[0], "o", color="#e74c3c", ms=4)
        axis.annotate(str(number), corners[0] + [6, -12], color="#e74c3c", fontsize=11, weight="bold")
    axis.set(xlim=(480, 1380), ylim=(830, 330))
    axis.set_axis_off()
    return figure


def main() -> None:
    """Draws all figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    given = parser.parse_args()
    figures = {
        "positioning_port": port_figure(port_cost()),
        "positioning_track": track_figure(given.keep),
        "positioning_detection": detection_figure(),
    }
    for name, figure in figures.items():
        figure.savefig(given.out / f"{name}.png", dpi=70 if name == "positioning_detection" else 90)


if __name__ == "__main__":
    main()
