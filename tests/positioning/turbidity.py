"""From how far markers are found in turbid water: `python -m tests.positioning.turbidity [--keep FILE]`.

Rendered pictures of the thesis's left camera, 1920 x 1080, cropped to the markers from 2 m on. Prints shares found.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from tests.positioning.tracks import corners_seen, rotations

from rovtwin.core.markers import Layout
from rovtwin.positioning.images.detection import Detector
from rovtwin.simulation.camera.renderer import renderer
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.cameras import Camera, cameras_of

ATTENUATION = (0.3, 0.6, 1.0, 1.5)  # beam attenuation [1/m]
SIZES = (0.15, 0.3)  # of markers [m]
DEPTHS = np.arange(1.2, 3.7, 0.3)  # distances in optical depths: what is nearer is found
FACE = 5.99  # just before the marked side of the box in `mclab`, north [m]
# East and depth of three markers of each size, small ones below.
PLACES = {0.3: [(-0.45, 0.5), (0.0, 0.5), (0.45, 0.5)], 0.15: [(-0.3, 0.95), (0.0, 0.95), (0.3, 0.95)]}
FIRST = {0.3: 0, 0.15: 3}  # ids
# `Detector` as it is, with OpenCV's limits of contrast, and with lower ones [grey levels].
SETTINGS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "lower limits": {"adaptiveThreshConstant": 4.0, "minOtsuStdDev": 3.0},
}
CAMERA_DEPTH, POSES = 0.7, 4  # of the camera [m]; views of a distance


def layout() -> Layout:
    """Both sizes on the yellow box."""
    markers = [
        {"id": FIRST[size] + k, "size": size, "position": [FACE, east, depth], "faces": [-1, 0, 0]}
        for size, places in PLACES.items()
        for k, (east, depth) in enumerate(places)
    ]
    return Layout.model_validate({"markers": markers})


def cropped(camera: Camera, distance: float) -> Camera:
    """The camera with only the middle of its picture, where the markers of a distant box are."""
    lens = camera.lens
    divisor = 1 if distance < 2.0 else (2 if distance < 4.0 else 4)
    if divisor == 1:
        return camera
    size = np.array(lens.size) // divisor
    corner = (np.array(lens.size) - size) // 2
    part = replace(lens, principal=lens.principal - corner, size=(int(size[0]), int(size[1])))
    return replace(camera, lens=part)


def count(attenuation: float, distance: float, poses: int = POSES) -> dict[str, tuple[int, int]]:
    """Markers found and in view, by setting and size, of some views from a distance, the vehicle a little aside."""
    scene = load_scene("mclab").with_layout(layout()).with_water(beam_attenuation=attenuation)
    camera = cropped(cameras_of(load_vehicle("double_blueye"))[0], distance)
    eye, rng = renderer(scene, camera), np.random.default_rng(int(100 * distance))
    detectors = {name: Detector(**setting) for name, setting in SETTINGS.items()}
    counts = {_key(name, size): (0, 0) for name in SETTINGS for size in SIZES}
    for k in range(poses):
        p = np.array([FACE - distance, 0.0, CAMERA_DEPTH]) - camera.position + rng.uniform(-0.1, 0.1, 3) * [1, 1, 0.5]
        R = rotations(rng.uniform(-0.03, 0.03, (1, 3)))[0]
        shown = corners_seen(scene.layout, camera, p, R, rng, pixel=0.0).ids
        grey = cv2.cvtColor(eye.image(p, R, seed=k), cv2.COLOR_RGB2GRAY)
        for name, detector in detectors.items():
            ids = set(detector(grey).ids.tolist())
            for size in SIZES:
                own = {number for number in shown if FIRST[size] <= number < FIRST[size] + len(PLACES[size])}
                found, there = counts[_key(name, size)]
                counts[_key(name, size)] = found + len(own & ids), there + len(own)
    return counts


def _key(setting: str, size: float) -> str:
    return f"{setting}, {size:g} m"


def ranges(keep: Path | None = None) -> dict[str, dict[str, list[list[float]]]]:
    """By attenuation, then setting and size: distances [m] with shares, to where nothing is found; kept in a file."""
    if keep is not None and keep.is_file():
        return json.loads(keep.read_text(encoding="utf-8"))
    out: dict[str, dict[str, list[list[float]]]] = {}
    for attenuation in ATTENUATION:
        rows, nothing = {}, 0
        for distance in np.round(DEPTHS / attenuation, 2).tolist():
            counts = count(attenuation, distance)
            for key, (found, there) in counts.items():
                rows.setdefault(key, []).extend([[distance, found / there]] if there else [])
            print(f"{attenuation}, {distance}: {counts}", flush=True)
            nothing = nothing + 1 if not any(found for found, _ in counts.values()) else 0
            if nothing == 2:
                break
        out[str(attenuation)] = rows
    if keep is not None:
        keep.write_text(json.dumps(out), encoding="utf-8")
    return out


def half_way(rows: list[list[float]]) -> float:
    """Distance at which the share found falls through a half, between two that were looked at [m]."""
    distance, share = np.array(rows).T
    last = int(np.flatnonzero(share >= 0.5)[-1])
    if last + 1 == len(share):
        return float(distance[last])
    step = (share[last] - 0.5) / (share[last] - share[last + 1])
    return float(distance[last] + step * (distance[last + 1] - distance[last]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path)
    found = ranges(parser.parse_args().keep)
    print("beam attenuation [1/m], setting, marker: half of them found out to [m]")
    for attenuation, rows in found.items():
        for what, row in rows.items():
            print(f"{attenuation}, {what}: {half_way(row):.1f}")


if __name__ == "__main__":
    main()
