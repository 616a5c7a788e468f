"""How well markers and tracks are found: `python -m tests.positioning.accuracy [detection|square]`.

Prints the tables of docs/positioning.md. `square --quick` runs on projected corners with noise, otherwise on rendered
images, which takes the better part of an hour; their corners are kept in --keep and used again.
"""

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.positioning.tracks import Drive, corners_seen, rotations, square

from rovtwin.core.block import Start
from rovtwin.core.frames import quaternion_from_rotation
from rovtwin.core.markers import Layout
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.positioning.estimators.ekf import MarkerEkf
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.estimators.luenberger import Gains, MarkerLuenberger
from rovtwin.positioning.estimators.run import run_observer, step
from rovtwin.positioning.estimators.single_frame import fixes
from rovtwin.positioning.estimators.smoother import smooth
from rovtwin.positioning.images.camera_model import Eyes
from rovtwin.positioning.images.detection import Detections, Detector
from rovtwin.positioning.images.observations import Frames, sightings
from rovtwin.simulation.camera.renderer import renderer
from rovtwin.simulation.camera.sensor import camera_named
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.cameras import Camera, cameras_of

quaternions = jax.jit(jax.vmap(quaternion_from_rotation))
FACE = 6.0  # where the marked side of the box is in `mclab`, north [m]
SIZES = np.full(1000, 0.15)
STRIP = 448  # columns of an image of the square that are drawn


def detection(distances: Sequence[float] = (1, 2, 3, 5, 8), poses: int = 8) -> None:
    """Found of 24, corner error, error of the position from one image with attitude and map known, time per image."""
    scene, camera = load_scene("mclab"), cameras_of(load_vehicle("double_blueye"))[0]
    eye, detector = renderer(scene, camera, kind="raycast"), Detector()
    print("distance [m], found, corner rms [px], position rms from all markers [mm], from one [mm], time [ms]")
    for distance in distances:
        rng, error, place, single, spent, shown = np.random.default_rng(distance), [], [], [], [], 0
        for k in range(poses):
            p = np.array([FACE - distance, 0.0, 0.75]) - camera.position + rng.uniform(-0.1, 0.1, 3) * [1, 1, 0.5]
            R = rotations(rng.uniform(-0.03, 0.03, (1, 3)))[0]
            truth = corners_seen(scene.layout, camera, p, R, rng, pixel=0.0)
            grey = cv2.cvtColor(eye.image(p, R, seed=100 * distance + k), cv2.COLOR_RGB2GRAY)
            begin = time.perf_counter()
            seen = detector(grey)
            spent.append(time.perf_counter() - begin)
            shown += len(truth.ids)
            right = {n: c for n, c in zip(truth.ids, truth.corners, strict=True)}
            error += [c - right[n] for n, c in zip(seen.ids, seen.corners, strict=True)]
            place.append(np.linalg.norm(from_one_image(scene.layout, camera, p, R, seen) - p))
            for row in range(len(seen.ids)):
                one = Detections(seen.ids[row : row + 1], seen.corners[row : row + 1])
                single.append(np.linalg.norm(from_one_image(scene.layout, camera, p, R, one) - p))
        rms = [np.sqrt(np.mean(np.square(values))) for values in (error, place, single)]
        print(
            f"{distance}, {len(error)} of {shown}, {rms[0]:.3f}, {1e3 * rms[1]:.2f}, {1e3 * rms[2]:.2f}, "
            f"{1e3 * np.median(spent):.1f}",
            flush=True,
        )


def from_one_image(layout, camera, near, R_nb, seen) -> np.ndarray:
    """Position from known markers, the attitude known, shape (3,)."""
    slots = 4
    row = sightings([seen], [camera], SIZES, slots=slots)
    frames = Frames.of(np.zeros(1), np.array([[1.0, 0, 0, 0]]), [row])
    by_id = {marker.id: marker for marker in layout.markers}
    markers = [
        by_id[int(number)] if there else layout.markers[0] for number, there in zip(row.ids, row.valid, strict=True)
    ]
    pose = np.array([[m.position for m in markers]]), np.array([[m.R_nm for m in markers]])
    tuning = SlamTuning.of(attitude=1e-6)
    start = near[None] + 0.01  # not where it is
    used = np.asarray(row.valid)[None]
    return fixes(Eyes.of([camera]), tuning, as_array(SIZES), frames, R_nb[None], start, *pose, used)[0][0]


def strip(camera: Camera, first: int) -> Camera:
    """The camera with STRIP of its columns."""
    lens = camera.lens
    part = replace(lens, principal=lens.principal - np.array([first, 0.0]), size=(STRIP, lens.size[1]))
    return replace(camera, lens=part)


def first_column(layout: Layout, camera: Camera, p_nb: np.ndarray, R_nb: np.ndarray) -> int:
    """Of the strip that has the markers in its middle, in steps, so that few strips are set up."""
    seen = corners_seen(layout, camera, p_nb, R_nb, np.random.default_rng(0), pixel=0.0).corners[..., 0]
    middle = 0.5 * (seen.min() + seen.max())
    return int(np.clip(64 * round((middle - STRIP / 2) / 64), 0, camera.lens.size[0] - STRIP))


def rendered(seed: int, keep: Path) -> list[Detections]:
    """Corners in rendered images of a seed's drive, each with its own noise and blur; kept in a folder.

    Drawn are the columns with the box, from top to bottom with what the surface mirrors; a third of the time of all.
    """
    drive, file = flight(seed), keep / f"square_{seed}.npz"
    if file.is_file():
        data = np.load(file)
        return [Detections(data[f"i{k}"], data[f"c{k}"]) for k in range(len(drive.t))]
    scene, camera = load_scene("mclab"), eye_of_square()
    eyes, detector, found = {}, Detector(), []
    for k in range(len(drive.t)):
        p, R = drive.position[k], drive.R_nb[k]
        first = first_column(scene.layout, camera, p, R)
        if first not in eyes:
            eyes[first] = renderer(scene, strip(camera, first), kind="raycast")
        image = eyes[first].image(p, R, velocity=R.T @ drive.velocity[k], seed=1000 * seed + k)
        whole = np.full(camera.lens.size[::-1], int(image.mean()), np.uint8)
        whole[:, first : first + STRIP] = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        found.append(detector(whole))
    keep.mkdir(parents=True, exist_ok=True)
    ids, corners = {f"i{k}": f.ids for k, f in enumerate(found)}, {f"c{k}": f.corners for k, f in enumerate(found)}
    np.savez_compressed(file, **ids, **corners)
    return found


@dataclass
class Run:
    """One drive: its truth, and what each method made of it."""

    drive: Drive
    results: dict[str, Any]
    spent: float


def eye_of_square() -> Camera:
    """The thesis's left camera at half its resolution: 960 x 540 pixels."""
    return camera_named(load_vehicle("double_blueye"), scale=0.5)


def flight(seed: int) -> Drive:
    """The square of thesis 6.3, 2 to 3 m before the box of `mclab`, five frames a second."""
    drive = square(rate=5.0, seed=seed)
    return replace(drive, position=drive.position + [2.0, 0.0, 0.0])


def run_square(seed: int, keep: Path | None, **tuning: Any) -> Run:
    """The square, the markers' places unknown; keep: None for projected corners."""
    scene, camera, drive = load_scene("mclab"), eye_of_square(), flight(seed)
    if keep is None:
        rng = np.random.default_rng(1000 + seed)
        where = zip(drive.position, drive.R_nb, strict=True)
        seen = [corners_seen(scene.layout, camera, p, R, rng, pixel=0.15) for p, R in where]
    else:
        seen = rendered(seed, keep)
    attitude = np.asarray(quaternions(jnp.asarray(drive.R_meas)))
    frames = Frames.of(drive.t, attitude, [sightings([found], [camera], SIZES, slots=8) for found in seen])
    start = Start.at(drive.position[0])
    filter = MarkerEkf.of([camera], SlamTuning.of(**tuning))
    out = run_observer(filter, frames, start)
    results = {"filter": out, "smoother": smooth(filter, frames, out)}
    for name, gains in (("Luenberger, thesis", Gains.thesis()), ("Luenberger, tuned", Gains.tuned())):
        results[name] = run_observer(MarkerLuenberger.of([camera], gains), frames, start)
    return Run(drive, results, step_time(filter, frames, start))


def track_square(seeds: int, keep: Path | None, jobs: int = 2, **tuning: Any) -> None:
    """On-line and smoothed errors on the square of thesis 6.3, each seed with a flight and pictures of its own."""
    if keep is not None:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            list(pool.map(rendered, range(seeds), [keep] * seeds))
    runs = [run_square(seed, keep, **tuning) for seed in range(seeds)]
    print("method, position rms [mm], velocity rms [mm/s]: mean (worst) of seeds")
    for name in runs[0].results:
        rows = []
        for run in runs:
            e, v = run.results[name].position - run.drive.position, run.results[name].velocity - run.drive.velocity
            rows.append([np.sqrt((e**2).sum(1).mean()), np.sqrt((v**2).sum(1).mean())])
        p, v = 1e3 * np.array(rows).T
        print(f"{name}, {p.mean():.1f} ({p.max():.1f}), {v.mean():.1f} ({v.max():.1f})")
    nees = [[squares(run.drive, run.results[name]) for name in ("filter", "smoother")] for run in runs]
    report_nees(np.array(nees), seeds)
    print(f"filter: {1e3 * np.median([run.spent for run in runs]):.2f} ms a frame (median)", flush=True)


def squares(drive: Drive, result: Any) -> np.ndarray:
    """Normalised errors squared of position, of velocity (3 degrees of freedom each) and of both (6), shape (n, 3)."""
    e = np.concatenate([result.position - drive.position, result.velocity - drive.velocity], axis=1)
    covariance, tiny = result.covariance, 1e-14 * np.eye(6)  # the start is known exactly
    six = np.einsum("ki,ki->k", e, np.linalg.solve(covariance + tiny, e[..., None])[..., 0])
    halves = []
    for part in (slice(0, 3), slice(3, 6)):
        three = np.linalg.solve((covariance + tiny)[:, part, part], e[:, part, None])[..., 0]
        halves.append(np.einsum("ki,ki->k", e[:, part], three))
    return np.stack([*halves, six], axis=1)


def report_nees(nees: np.ndarray, seeds: int) -> None:
    """Means of seeds against the 95 % bounds of a mean of so many; nees: shape (seeds, methods, n, 3)."""
    from scipy.stats import chi2

    for m, method in enumerate(("filter", "smoother")):
        for d, (what, dof) in enumerate((("position", 3), ("velocity", 3), ("both", 6))):
            low, high = chi2.ppf([0.025, 0.975], dof * seeds) / seeds
            mean = nees[:, m, 10:, d].mean(axis=0)
            inside = ((mean > low) & (mean < high)).mean()
            print(
                f"NEES of {method}, {what}: {mean.mean():.2f} on average, bounds {low:.2f} to {high:.2f}; "
                f"inside {100 * inside:.0f} % of the time"
            )


def step_time(filter: MarkerEkf, frames: Frames, start: Start) -> float:
    """Median time of a compiled step [s]."""
    memory, spent = filter.init(jax.random.key(0), start), []
    for k in range(60):
        begin = time.perf_counter()
        memory, out = step(filter, memory, frames.at(k), frames.dt[k])
        np.asarray(out.position)
        spent.append(time.perf_counter() - begin)
    return float(np.median(spent))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["detection", "square"], nargs="*", default=["detection", "square"])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument(
        "--acceleration", type=float, nargs="+", default=[0.1], help="that is believed in, 1 or 3 [m/s2]"
    )
    parser.add_argument("--keep", type=Path, default=Path("runs/square"))
    given = parser.parse_args()
    if "detection" in given.what:
        detection()
    if "square" in given.what:
        acceleration = np.broadcast_to(given.acceleration, 3)
        track_square(given.seeds, None if given.quick else given.keep, acceleration=acceleration)


if __name__ == "__main__":
    main()
