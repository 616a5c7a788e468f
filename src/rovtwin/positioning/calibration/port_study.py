"""What it costs to ignore the flat port that a camera looks through.

A flat port is no lens: how much it enlarges the image depends on how far away a thing is. Three ways of dealing with it
are put beside each other: none at all, with a lens calibrated in air; a lens calibrated in water at one distance, which
swallows the port; and the port as it is. Corners are exact, attitude and places of markers known: what is left is the
error of the model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovtwin.core.markers import Layout
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.core.vision import opencv
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.estimators.single_frame import fixes
from rovtwin.positioning.images.camera_model import Eyes
from rovtwin.positioning.images.detection import Detections
from rovtwin.positioning.images.observations import Frames, sightings
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.physics.camera import R_DEVICE_C, Lens, Port, lens_from, project, ray

AIR = lens_from([768.0, 768.0], [959.5, 539.5], (1920, 1080))  # enlarged by the water to the focal length of table 5.8
PORT = Port.of(0.03, 0.005)
CALIBRATED_AT = 1.0  # [m]
SIDE = 0.15  # of the markers [m]
_project = jax.jit(project)


@dataclass(frozen=True, eq=False)
class PortCost:
    """Position error of each way at each distance.

    Attributes:
        distance: From the camera to the wall of markers [m], shape (n,).
        error: rms over places across the wall [m], by the name of the way, shape (n,).
        in_water: The lens that a calibration in water gives.
        in_water_rms: Its residuals [px].
    """

    distance: np.ndarray
    error: dict[str, np.ndarray]
    in_water: Lens
    in_water_rms: float


def with_port(lens: Lens, port: Port | None) -> Lens:
    """The same lens behind a port."""
    return Lens(lens.focal, lens.principal, lens.distortion, port, lens.size)


def calibrated_in_water(lens: Lens, port: Port, distance: float = CALIBRATED_AT) -> tuple[Lens, float]:
    """Lens without a port that fits best what is seen through one at a distance, and the rms of what is left [px].

    From boards of exact corners that cover the image, flat and tilted, as `calibrate` would be given.
    """
    cv2 = opencv()
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 13), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2)
    # As large as the image is at that distance.
    _, direction = ray(with_port(lens, port), jnp.asarray([0.94 * lens.size[0], 0.94 * lens.size[1]]))
    half = distance * np.abs(np.asarray(direction[:2] / direction[2]))
    flat = np.concatenate([grid * half, np.zeros((len(grid), 1))], axis=1)
    boards, pictures = [], []
    for tilt in ([0, 0, 0], [0.25, 0, 0], [-0.25, 0, 0], [0, 0.25, 0], [0, -0.25, 0], [0.2, 0.2, 0.1]):
        R, _ = cv2.Rodrigues(np.array(tilt, float))
        pixels = np.asarray(_project(with_port(lens, port), jnp.asarray(flat @ R.T + [0, 0, distance])))
        inside = ((pixels > 0) & (pixels < np.array(lens.size) - 1)).all(axis=1)
        boards.append(flat[inside].astype(np.float32))
        pictures.append(pixels[inside].astype(np.float32)[:, None])
    rms, K, d, *_ = cv2.calibrateCamera(boards, pictures, lens.size, None, None)  # type: ignore[call-overload]  (None: not in its stubs)
    return lens_from([K[0, 0], K[1, 1]], [K[0, 2], K[1, 2]], lens.size, d), float(rms)


def port_cost(lens: Lens = AIR, port: Port = PORT, distances: Sequence[float] | None = None) -> PortCost:
    """Position errors against distance; by default from 0.5 to 5 m."""
    distance = np.geomspace(0.5, 5.0, 19) if distances is None else np.asarray(distances, float)
    wet, rms = calibrated_in_water(lens, port)
    ways = {
        "calibrated in air, port ignored": with_port(lens, None),
        f"calibrated in water at {CALIBRATED_AT:g} m": wet,
        "port modelled": with_port(lens, port),
    }
    error = {name: np.array([_error(with_port(lens, port), way, d) for d in distance]) for name, way in ways.items()}
    return PortCost(distance, error, wet, rms)


def _error(true: Lens, assumed: Lens, distance: float) -> float:
    """rms of the position error over five places before a wall of four markers [m]."""
    markers = [
        {"id": k, "size": SIDE, "position": [distance, east, down], "faces": [-1, 0, 0]}
        for k, (east, down) in enumerate([(-0.2, -0.1), (0.2, -0.1), (-0.2, 0.1), (0.2, 0.1)])
    ]
    layout = Layout.model_validate({"markers": markers})
    sideways = 0.15 * distance
    places = [np.array([0.0, east, down]) for east, down in ((0, 0), (1, 0), (-1, 0), (0, 0.5), (0, -0.5))]
    squares = [np.sum((_fix(true, assumed, layout, sideways * p) - sideways * p) ** 2) for p in places]
    return float(np.sqrt(np.mean(squares)))


def _fix(true: Lens, assumed: Lens, layout: Layout, place: np.ndarray) -> np.ndarray:
    """Where a camera at a place, looking north, seems to be."""
    eye, corners = Camera("camera", assumed, np.zeros(3), R_DEVICE_C), np.stack([m.corners for m in layout.markers])
    pixels = np.asarray(_project(true, jnp.asarray((corners - place) @ R_DEVICE_C)))
    sizes = np.full(len(layout.markers), SIDE)
    ids = np.array([m.id for m in layout.markers])
    row = sightings([Detections(ids, pixels)], [eye], sizes, slots=len(ids))
    frames = Frames.of(np.zeros(1), np.array([[1.0, 0, 0, 0]]), [row])
    order = np.asarray(row.ids)
    pose = (
        np.stack([layout.markers[k].position for k in order])[None],
        np.stack([layout.markers[k].R_nm for k in order])[None],
    )
    arguments = frames, np.eye(3)[None], place[None], *pose, np.asarray(row.valid)[None]
    return fixes(Eyes.of([eye]), SlamTuning.of(attitude=1e-6), as_array(sizes), *arguments)[0][0]
