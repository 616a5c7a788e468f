"""Pictures per second of both renderers at three sizes, and how far corners lie from where projection has them."""

import statistics
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.timing import in_turns, rates
from rovtwin.core.errors import ConfigError
from rovtwin.positioning.images.detection import Detector
from rovtwin.simulation.camera.renderer import renderer
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.cameras import cameras_of
from rovtwin.vehicle.physics.camera import Port, project

SIZES = {"360p": 1 / 3, "720p": 2 / 3, "1080p": 1.0}
VIEWS = {"mclab": (3.0, 0.3, 0.7), "pool": (2.0, 0.1, 0.9), "seabed": (0.0, 0.0, 10.7)}
KINDS = ("raycast", "gl")
MIRRORED = 20.0  # further than this from projection it is another thing with the same id [px]


def _left():
    """The thesis's left camera, table 5.8."""
    return cameras_of(load_vehicle("double_blueye_thesis"))[0]


def _made(scene, camera, kind):
    try:
        return renderer(scene, camera, kind)
    except ConfigError:  # no OpenGL on this machine, or a scene that is not for the ray-caster
        return None


def rendering(quick: bool) -> dict[str, Any]:
    """Pictures per second of processor time (all threads together), and wall-clock time of one, by scene and size."""
    sizes, scenes, rounds = (("360p",), ("pool",), 2) if quick else (SIZES, VIEWS, 7)
    results: dict[str, Any] = {}
    for name in scenes:
        scene = load_scene(name)
        for size in sizes:
            camera = replace(_left(), lens=_left().lens.scaled(SIZES[size]))
            for kind in KINDS:
                drawn = _made(scene, camera, kind)
                if drawn is None:
                    continue

                def picture(drawn=drawn, at=VIEWS[name]):
                    drawn.image(at, np.eye(3), seed=1)

                times = in_turns({"picture": picture}, rounds)["picture"]
                results[f"{name} {size} {kind}"] = {
                    "pictures_per_s": rates(times, 1.0),
                    "wall_s": statistics.median(_wall(picture) for _ in range(rounds)),
                }
    return results


def _wall(action) -> float:
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def corners(quick: bool, distances: Sequence[float] = (1.0, 2.0, 3.0, 5.0, 8.0)) -> dict[str, Any]:
    """Of markers in the pool at 1080p, by distance to the wall: found, and corners against projection [px].

    As `positioning.images.detection` finds them. `rms` counts all there is; `middle` is the mean of the four corners
    of a marker.
    """
    scene, lens = load_scene("pool"), _left().lens
    if quick:
        lens = lens.scaled(1 / 3)
    lenses = {
        "": lens,
        " port": type(lens)(lens.focal, lens.principal, lens.distortion, Port.of(0.02, 0.005), lens.size),
    }
    results: dict[str, Any] = {}
    for what, one in lenses.items():
        camera = replace(_left(), lens=one)
        drawn = {kind: made for kind in KINDS if (made := _made(scene, camera, kind)) is not None}
        for distance in (2.0,) if quick else distances:
            at = np.array([6.0 - distance - camera.position[0], 0.1, 0.9])
            found = {
                kind: _direct(scene, camera, at, detected(made.image(at, np.eye(3)))) for kind, made in drawn.items()
            }
            for kind, markers in found.items():
                results[f"{distance:g} m{what} {kind}"] = _against(markers)
            if len(found) == 2 and (both := set(found["raycast"]) & set(found["gl"])):
                apart = np.concatenate([found["raycast"][i][0] - found["gl"][i][0] for i in both])
                results[f"{distance:g} m{what} apart"] = {"found": len(both), "rms": _rms(apart)}
    return results


def _direct(scene, camera, at, found) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Corners found and as projected, by id; what the surface mirrors is left out."""
    eye, near = at + camera.position, {}
    for marker in scene.layout.markers:
        true = np.asarray(project(camera.lens, (marker.corners - eye) @ camera.R_bc))
        if marker.id in found and np.abs(found[marker.id] - true).max() < MIRRORED:
            near[marker.id] = (found[marker.id], true)
    return near


def _against(found) -> dict[str, Any]:
    if not found:
        return {"found": 0}
    off = np.array([corners - true for corners, true in found.values()])
    return {"found": len(off), "rms": _rms(off), "middle": _rms(off.mean(axis=1))}


def _rms(off: np.ndarray) -> float:
    return float(np.sqrt((off**2).sum(axis=-1).mean()))


def detected(picture: np.ndarray) -> dict[int, np.ndarray]:
    """Corners (4, 2) [px] of the markers found, by id."""
    found = Detector()(picture)
    return dict(zip(found.ids.tolist(), found.corners, strict=True))
