"""Chessboards drawn through a known lens, and the lens that comes back."""

import functools

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jax, jnp
from rovtwin.positioning.calibration.camera_file import as_data, choose, read_lens
from rovtwin.positioning.calibration.lens import calibrate
from rovtwin.report.cameras.lens import residual_figure
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.camera import Port, lens_from, ray

cv2 = pytest.importorskip("cv2")
LENS = lens_from([520, 523], [322, 238], (640, 480), [0.12, -0.05, 1e-3, -5e-4, 0.0])
SQUARE, BOARD = 0.025, (9, 6)


SAMPLES = 2


@functools.cache
def rays():
    """Directions of SAMPLES times SAMPLES rays a pixel, shape (rows, columns, 3)."""
    step = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    xs, ys = ((np.arange(n)[:, None] + step).ravel() for n in LENS.size)
    return np.asarray(jax.jit(ray)(LENS, jnp.asarray(np.stack(np.meshgrid(xs, ys), axis=-1)))[1])


def board_picture(turn, shift):
    """A chessboard of 10 x 7 squares with a white margin, by rays through the lens."""
    width, height = LENS.size
    direction = rays()
    R, _ = cv2.Rodrigues(np.array(turn, float))
    normal = R[:, 2]
    hit = direction * (normal @ shift / (direction @ normal))[..., None] - shift
    at = hit @ R[:, :2] / SQUARE + [5.0, 3.5]  # in squares from the board's corner
    cell = np.floor(at).astype(int)
    inside = ((at >= 0) & (at < [10, 7])).all(axis=-1)
    sheet = ((at >= -1) & (at < [11, 8])).all(axis=-1)
    grey = np.where(inside & (cell.sum(axis=-1) % 2 == 0), 25.0, np.where(sheet, 225.0, 120.0))
    image = grey.reshape(height, SAMPLES, width, SAMPLES).mean(axis=(1, 3))
    return np.round(cv2.GaussianBlur(image, (0, 0), 0.7)).astype(np.uint8)


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    folder = tmp_path_factory.mktemp("boards")
    poses = [
        ([0, 0, 0], [0.0, 0.0, 0.3]), ([0.4, 0, 0], [-0.08, 0.05, 0.34]), ([-0.4, 0.1, 0.1], [0.08, -0.05, 0.34]),
        ([0, 0.5, 0], [0.07, 0.05, 0.33]), ([0.1, -0.4, -0.1], [-0.06, -0.03, 0.36]),
    ]  # fmt: skip
    paths = []
    for k, (turn, shift) in enumerate(poses):
        paths.append(folder / f"{k}.png")
        cv2.imwrite(str(paths[-1]), board_picture(turn, np.array(shift)))
    return paths


@pytest.mark.system
def test_the_lens_comes_back(images, tmp_path):
    result = calibrate(images, BOARD, SQUARE)
    assert len(result.used) == 5 and result.rms < 0.15
    values = np.r_[np.asarray(result.lens.focal), np.asarray(result.lens.principal)]
    assert np.abs(values - [520, 523, 322, 238]).max() < 3.0
    assert np.abs(np.asarray(result.lens.distortion)[:2] - [0.12, -0.05]).max() < 0.05
    points, residuals = np.concatenate(result.points), np.concatenate(result.residuals)
    residual_figure(result.lens, points, residuals).savefig(tmp_path / "residuals.png")
    assert (tmp_path / "residuals.png").stat().st_size > 5000


@pytest.mark.system
def test_a_camera_file_is_read_as_it_was_written_and_takes_the_place_of_the_vehicles_lens(images, tmp_path):
    import yaml

    path = tmp_path / "camera.yaml"
    path.write_text(yaml.safe_dump(as_data("camera", LENS, "drawn")))
    lens = read_lens(path)
    assert (
        lens.size == (640, 480)
        and np.allclose(lens.focal, LENS.focal)
        and np.allclose(lens.distortion, LENS.distortion)
    )
    whole = lens_from([520, 523], [322, 238], (640, 480), 0.01 * np.arange(1, 9), Port.of(0.03, 0.005, 1.5, 1.34))
    path.write_text(yaml.safe_dump(as_data("camera", whole, "drawn")))
    again = read_lens(path)
    assert np.allclose(again.distortion, whole.distortion) and again.port is not None and whole.port is not None
    for part in ("distance", "thickness", "glass", "water"):
        assert np.allclose(getattr(again.port, part), getattr(whole.port, part))
    path.write_text(yaml.safe_dump(as_data("camera", LENS, "drawn")))
    (chosen,) = choose(load_vehicle("double_blueye"), ["port"], [path])
    assert chosen.lens.size == (640, 480) and chosen.position[1] < 0
    path.write_text(path.read_text() + "port: {distance: 0.03, thickness: 0.005}\n")
    assert read_lens(path).port is not None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: c\nfocal_length: [500, 500]\n", "resolution: missing"),
        ("name: c\nresolution: [640, 480]\nfocal: [500, 500]\n", "focal: no such key. Known: distortion, focal_length"),
        ("name: c\nresolution: [640, 480]\nport: {distance: -1}\n", "port.distance"),
    ],
)
def test_a_camera_file_that_cannot_be_used_is_named(tmp_path, text, message):
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        read_lens(path)


def test_cameras_are_chosen_by_name():
    vehicle = load_vehicle("double_blueye")
    assert len(choose(vehicle, [], [])) == 2
    with pytest.raises(ConfigError, match="camera 'camera': found several"):
        choose(vehicle, ["camera"], [])
    with pytest.raises(ConfigError, match="camera 'prot': found none"):
        choose(vehicle, ["prot"], [])


def test_too_few_boards_and_pictures_of_two_sizes_are_named(images, tmp_path):
    with pytest.raises(ConfigError, match="found a board of 7 x 5 inner corners in 0 of 2 pictures"):
        calibrate(images[:2], (7, 5), SQUARE)
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.zeros((240, 320), np.uint8))
    with pytest.raises(ConfigError, match="found 320 x 240 pixels, but the pictures before have 640 x 480"):
        calibrate([images[0], other], BOARD, SQUARE)
