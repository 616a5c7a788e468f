"""The figures of docs/positioning.md.

PYTHONPATH=. python docs/scripts/positioning.py [--keep runs/square] [--turbidity turbidity.json]
    [--chain runs/chain] [--only chain] [--out docs/figures]

With --keep, corners of rendered images as tests/positioning/accuracy.py leaves them; else projected corners with noise.
--turbidity and --chain are what tests/positioning/turbidity.py and chain.py leave; what is not there is rendered anew.
"""

import argparse
import json
from pathlib import Path

import cv2
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from tests.positioning.accuracy import FACE, run_square
from tests.positioning.chain import TABLE_8_1, TABLE_8_2, damping, report, run
from tests.positioning.tracks import rotations
from tests.positioning.turbidity import ranges

from rovtwin.core.log import Log
from rovtwin.positioning.calibration.port_study import port_cost
from rovtwin.positioning.images.detection import Detector
from rovtwin.report.cameras.lens import port_figure
from rovtwin.simulation.camera.renderer import renderer
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.cameras import cameras_of

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


def turbidity_figure(keep: Path | None):
    """Share of markers found over distance, a curve for each water."""
    found = ranges(keep)
    settings = {key.rpartition(", ")[0] for rows in found.values() for key in rows}
    figure, panels = plt.subplots(1, 2, figsize=(10.5, 3.6), layout="constrained", sharey=True)
    for axis, size in zip(panels, ("0.15 m", "0.3 m"), strict=True):
        for colour, (attenuation, rows) in zip(plt.cm.viridis([0.85, 0.6, 0.35, 0.1]), found.items(), strict=True):
            for setting in sorted(settings):
                distance, share = np.array(rows[f"{setting}, {size}"]).T
                own = setting == "as it is"
                label = f"{attenuation} /m" if own else None
                axis.plot(
                    distance,
                    100 * share,
                    "-o" if own else "--",
                    ms=3,
                    lw=1.4 if own else 0.9,
                    color=colour,
                    label=label,
                )
        axis.set(xlabel="distance [m]", title=f"markers of {size}")
        axis.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("found [%]")
    panels[1].plot([], [], "--", color="0.5", lw=0.9, label="lower limits of contrast")
    panels[1].legend(frameon=False, fontsize=8, title="beam attenuation", title_fontsize=8, bbox_to_anchor=(1, 1))
    return figure


def chain_figure(keep: Path):
    """Chapter 8.1 again: forces over speeds, and the velocity of the track in the run of surge."""
    folder = keep / "surge"
    made = folder / "chain.json"
    data = json.loads(made.read_text(encoding="utf-8")) if made.is_file() else report("surge", run("surge", folder))
    figure = plt.figure(figsize=(10.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1, 1.4])
    speed, force, own = np.linspace(0.0, 0.33, 100), data["force"], data["methods"]["markers known"]
    left.plot(speed, damping(data["truth"], speed), color="0.2", lw=3, alpha=0.35, label="truth")
    left.plot(speed, damping(own["parameters"], speed), color=COLOURS["filter"], lw=1.3, label="identified here")
    left.plot(own["speed"], force, "o", color=COLOURS["filter"], ms=5, label="steady speeds of the track")
    left.plot(speed, damping(TABLE_8_2, speed), color=COLOURS["Luenberger, thesis"], lw=1.0, label="thesis, table 8.2")
    for marker, row, name in zip("xs", TABLE_8_1, ("ArUco", "'ground truth'"), strict=True):
        left.plot(row, force, marker, color=COLOURS["Luenberger, thesis"], mfc="none", ms=6, label=f"table 8.1, {name}")
    left.set(xlabel="speed [m/s]", ylabel="force [N]", title="damping in surge", xlim=(0, 0.34), ylim=(0, 22))
    truth, track = Log.read(folder / "log.mcap")["truth/eta"], Log.read(folder / "track.mcap")["track/velocity"]
    right.plot(truth.t, np.gradient(truth["x"], truth.t), color="0.2", lw=3, alpha=0.35, label="truth")
    right.plot(track.t, track["x"], color=COLOURS["filter"], lw=1.0, label="track from the pictures")
    right.set(xlabel="time [s]", ylabel="velocity north [m/s]", title="five forces, ahead and back")
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
        axis.legend(frameon=False, fontsize=8)
    return figure


def _port():
    cost = port_cost()
    return port_figure(cost.distance, cost.error)


def main() -> None:
    """Draws all figures, or one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--turbidity", type=Path)
    parser.add_argument("--chain", type=Path, default=Path("runs/chain"))
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    figures = {
        "port": _port,
        "track": lambda: track_figure(given.keep),
        "detection": detection_figure,
        "turbidity": lambda: turbidity_figure(given.turbidity),
        "chain": lambda: chain_figure(given.chain),
    }
    parser.add_argument("--only", choices=figures, nargs="*", default=list(figures))
    given = parser.parse_args()
    for name in given.only:
        figures[name]().savefig(given.out / f"positioning_{name}.png", dpi=70 if name == "detection" else 90)


if __name__ == "__main__":
    main()
