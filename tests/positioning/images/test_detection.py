"""Markers found in drawn images, where they are to a fraction of a pixel."""

import cv2
import numpy as np
import pytest
from tests.positioning.pictures import picture
from tests.positioning.tracks import LENS, camera, corners_seen, rotations, wall

from rovtwin.core.frames import rotation_from_vector
from rovtwin.core.numerics import jax, jnp
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.images.camera_model import Eyes, see
from rovtwin.positioning.images.detection import Detections, Detector, poses
from rovtwin.positioning.images.observations import sightings
from rovtwin.positioning.images.print_fit import fitted
from rovtwin.vehicle.physics.camera import Port, lens_from

SMALL = lens_from([500, 501], [319, 241], (640, 480), [0.31, 0.08, 0.0, 0.0, 0.03])


def view(distance, lens=SMALL, seed=0, **options):
    """A picture, what is in it, and where from."""
    layout, eye = wall([(-0.12, 0.68), (0.12, 0.76)], **options), camera(lens, y=0.0)
    rng = np.random.default_rng(seed)
    p = np.array([4.0 - distance, 0.0, 0.75]) + rng.uniform(-0.05, 0.05, 3)
    R = rotations(rng.uniform(-0.1, 0.1, (1, 3)))[0]
    image = picture(layout, lens, p + R @ eye.position, R @ eye.R_bc, seed)
    return image, corners_seen(layout, eye, p, R, rng, pixel=0.0), layout, eye, p, R


@pytest.mark.system
@pytest.mark.parametrize("distance", [1.0, 2.0])
def test_corners_are_found_to_a_fraction_of_a_pixel(distance):
    image, truth, *_ = view(distance)
    found = Detector(tone=1.0)(image)
    assert sorted(found.ids) == sorted(truth.ids) == [0, 1]
    for number, corners in zip(found.ids, found.corners, strict=True):
        assert np.abs(corners - truth.corners[list(truth.ids).index(number)]).max() < 0.35


@pytest.mark.system
@pytest.mark.parametrize("distance", [2.5, 3.5, 5.0])
def test_corners_of_small_markers_are_as_good_as_the_filter_assumes(distance):
    """Sides of 34, 23 and 16 pixels; what pulls all corners inwards would make the marker seem further away."""
    outwards = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    error = []
    for seed in range(6):
        image, truth, *_ = view(distance, seed=seed)
        found = Detector(tone=1.0)(image)
        order = [list(truth.ids).index(number) for number in found.ids]
        error += list(found.corners - truth.corners[order])
    assert len(error) >= 6
    assert np.sqrt(np.mean(np.square(error))) < float(SlamTuning.of().pixel)
    assert abs(np.mean(error * outwards)) < 0.06


def test_a_print_is_fitted_from_a_pixel_beside_it_and_not_from_where_it_is_not():
    image, truth, *_ = view(3.5)
    number, corners = int(truth.ids[0]), truth.corners[0]
    found = fitted(cv2, image, "DICT_4X4_50", number, corners + [0.8, -0.8])
    assert found is not None and np.abs(found - corners).max() < 0.15
    assert fitted(cv2, image, "DICT_4X4_50", number, corners - corners.min(axis=0)) is None  # a corner of the image


@pytest.mark.system
def test_a_tone_curve_that_is_not_undone_makes_markers_smaller():
    image, truth, *_ = view(1.0)
    toned = np.round(255.0 * (image / 255.0) ** (1 / 2.2)).astype(np.uint8)
    inward = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])

    def shrunk(tone):
        found = Detector(tone=tone)(toned)
        order = [list(truth.ids).index(number) for number in found.ids]
        return ((found.corners - truth.corners[order]) * inward).mean()

    assert shrunk(1.0) > 0.1 > 0.07 > abs(shrunk(2.2))


def test_what_opencv_overlooks_is_read_from_its_square():
    """Near, a black cell that stands alone is a square in a square to the threshold, and OpenCV may stop at it."""
    detector, image = Detector(), np.full((300, 300), 180, np.uint8)
    cells = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    image[70:230, 60:220] = cv2.aruco.generateImageMarker(cells, 0, 160) // 2 + 50
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    corners = np.array([[59.5, 69.5], [219.5, 69.5], [219.5, 229.5], [59.5, 229.5]])
    for turned in range(4):
        ((number, found),) = detector._overlooked(image, [np.roll(corners, turned, axis=0)], [])
        assert number == 0 and np.array_equal(found, corners)
    assert detector._overlooked(image, [corners], [(0, corners + 1.0)]) == []  # found already
    paper, cell = corners + [[-25, -25], [25, -25], [25, 25], [-25, 25]], 0.2 * corners + [100, 100]
    assert detector._overlooked(image, [paper, cell, corners[::-1]], []) == []
    image[110, 80:200] = 10
    image[100:120, 140:180] = 60  # a bit that is wrong
    assert detector._overlooked(image, [corners], []) == []


def test_an_empty_image_and_one_without_markers_give_none():
    noise = np.random.default_rng(0).integers(0, 255, (120, 160), dtype=np.uint8)
    for image in (np.zeros((120, 160), np.uint8), noise):
        assert len(Detector()(image).ids) == 0


@pytest.mark.system
def test_a_copy_of_a_marker_is_flagged():
    image, *_ = view(1.0)
    twice = np.concatenate([image, image], axis=1)
    found = Detector(tone=1.0)(twice)
    assert sorted(found.ids) == [0, 0, 1, 1] and found.duplicated.all()


@pytest.mark.system
@pytest.mark.parametrize("port", [None, Port.of(0.03, 0.005)])
def test_pose_of_a_marker_is_exact_for_exact_corners(port):
    lens = lens_from(LENS.focal, LENS.principal, LENS.size, LENS.distortion, port)
    eye, layout = camera(lens, y=0.0), wall([(-0.3, 0.6), (0.3, 0.9), (0.0, 0.7)])
    p, R = np.array([2.2, 0.1, 0.8]), rotations(np.array([[0.1, -0.05, 0.08]]))[0]
    truth = corners_seen(layout, eye, p, R, np.random.default_rng(0), pixel=0.0)
    found = poses(lens, truth.corners, np.full(3, 0.15))
    for k, marker in enumerate(layout.markers):
        expected = ((marker.position - p) @ R - eye.position) @ eye.R_bc
        assert np.abs(found.t_cm[k, 0] - expected).max() < 1e-6
        assert np.abs(found.R_cm[k, 0] - (R @ eye.R_bc).T @ marker.R_nm).max() < 1e-6
    assert (found.ambiguity < 0.01).all()


def test_a_small_marker_far_away_is_ambiguous_and_a_near_one_is_not():
    eye = camera(y=0.0)
    rng = np.random.default_rng(3)
    reports = []
    for north in (1.5, 9.0):
        layout = wall([(0.4, 0.75)], north=north)
        seen = [corners_seen(layout, eye, np.array([0, 0, 0.75]), np.eye(3), rng, 0.2) for _ in range(20)]
        reports.append(np.median([poses(eye.lens, s.corners, np.full(1, 0.15)).ambiguity[0] for s in seen]))
    assert reports[0] < 0.3 < 0.6 < reports[1]


def test_corners_that_form_no_square_give_a_pose_with_a_large_error_and_no_exception():
    bent = np.array([[[100, 100], [101, 100], [300, 260], [100, 400]], [[5, 5], [5, 5], [5, 5], [5, 5.0]]])
    found = poses(LENS, bent, np.full(2, 0.15))
    assert np.isfinite(found.t_cm[0]).all() and found.error[0, 0] > 1.0


def test_derivatives_of_what_is_seen_are_those_of_differences():
    eye = Eyes.of([camera()])[0]
    p, R, marker = jnp.array([1.0, 0.2, 0.8]), jnp.asarray(rotations(np.array([[0.1, 0.2, 0.3]]))[0]), wall().markers[1]
    place, turn = jnp.asarray(marker.position), jnp.asarray(marker.R_nm)

    @jax.jit
    def at(e):
        attitude = rotation_from_vector(e[3:6]) @ R @ rotation_from_vector(e[6:9])
        return see(eye, p + e[:3], attitude, place + e[9:12], turn @ rotation_from_vector(e[12:]), 0.15)

    seen = at(jnp.zeros(15))
    ours = np.concatenate([seen.by_position, seen.by_offset, seen.by_noise, seen.by_marker], axis=1)
    assert seen.visible
    for k, step in enumerate(1e-6 * np.eye(15)):
        difference = (at(jnp.asarray(step)).pixels - at(jnp.asarray(-step)).pixels) / 2e-6
        assert np.allclose(ours[:, k], difference, rtol=1e-5, atol=1e-3)
    assert not at(jnp.zeros(15).at[0].set(5.0)).visible


def test_of_more_markers_than_slots_the_largest_are_kept():
    layout = wall([(-0.6 + 0.3 * k, 0.75) for k in range(5)])
    near = layout.model_copy(
        update={"markers": [m.model_copy(update={"size": 0.05 + 0.02 * m.id}) for m in layout.markers]}
    )
    eye = camera(y=0.0)
    seen = corners_seen(near, eye, np.array([1.5, 0, 0.75]), np.eye(3), np.random.default_rng(0), 0.0)
    slots = sightings([seen], [eye], np.array([0.05 + 0.02 * k for k in range(5)]), slots=3)
    assert slots.valid.all() and sorted(slots.ids) == [2, 3, 4]
    none = sightings([Detections.none()], [eye], np.full(5, 0.15), slots=3)
    assert not np.asarray(none.valid).any()
