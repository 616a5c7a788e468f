"""Pictures per second of both renderers at three sizes, and how far corners lie from where projection has them."""

import statistics
import time
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.timing import in_turns, rates
from rovtwin.core.errors import ConfigError
from rovtwin.simulation.camera import renderer
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.camera import Port, cameras_of, project

SIZES = {"360p": 1 / 3, "720p": 2 / 3, "1080p": 1.0}
VIEWS = {"mclab": (3.0, 0.3, 0.7), "pool": (2.0, 0.1, 0.9), "seabed": (0.0, 0.0, 10.7)}
KINDS = ("raycast", "gl")


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


def corners(quick: bool) -> dict[str, Any]:
    """Of markers in the pool at 1080p, by distance to the wall: found, and corners against projection [px].

    OpenCV's detector with its sub-pixel refinement. `rms` counts all there is; `middle` is the mean of a marker's four
    corners, to which what the refinement does to each corner of a dark square adds nothing.
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
        for distance in (2.0,) if quick else (1.0, 2.0, 3.0, 5.0, 8.0):
            at = np.array([6.0 - distance - camera.position[0], 0.1, 0.9])
            found = {kind: detected(made.image(at, np.eye(3))) for kind, made in drawn.items()}
            for kind, markers in found.items():
                results[f"{distance:g} m{what} {kind}"] = _against(scene, camera, at, markers)
            if len(found) == 2 and (both := set(found["raycast"]) & set(found["gl"])):
                apart = np.concatenate([found["raycast"][i] - found["gl"][i] for i in both])
                results[f"{distance:g} m{what} apart"] = {"found": len(both), "rms": _rms(apart)}
    return results


def _against(scene, camera, at, found) -> dict[str, Any]:
    eye, off = at + camera.position, []
    for marker in scene.layout.markers:
        if marker.id in found:
            off.append(found[marker.id] - np.asarray(project(camera.lens, (marker.corners - eye) @ camera.R_bc)))
    if not off:
        return {"found": 0}
    return {"found": len(off), "rms": _rms(np.concatenate(off)), "middle": _rms(np.array(off).mean(axis=1))}


def _rms(off: np.ndarray) -> float:
    return float(np.sqrt((off**2).sum(axis=-1).mean()))


def detected(picture: np.ndarray) -> dict[int, np.ndarray]:
    """Corners (4, 2) [px] of the markers that OpenCV finds, by id."""
    import cv2

    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    settings = detector.getDetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector.setDetectorParameters(settings)
    found, ids, _ = detector.detectMarkers(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    return {int(i): c[0].astype(float) for i, c in zip([] if ids is None else ids.ravel(), found, strict=False)}
