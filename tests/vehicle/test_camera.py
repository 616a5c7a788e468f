"""Projection through lens and port, against OpenCV and against Snell's law."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import jnp
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.cameras import cameras_of
from rovtwin.vehicle.physics.camera import Port, lens_from, project, ray

# Thesis table 5.8, left camera, and a lens with everything in it.
LENSES = {
    "thesis": lens_from([1025, 1027], [987, 552], (1920, 1080), [0.31, 0.08, 0.0, 0.0, 0.03]),
    "rational": lens_from([900, 905], [955, 540], (1920, 1080), [-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.1, 0.02, 1e-3]),
    "pinhole": lens_from([800, 800], [639.5, 359.5], (1280, 720)),
}
PORTS = {"thin": Port.of(0.02), "thick": Port.of(0.03, 0.01)}


def pixels(lens):
    width, height = lens.size
    return np.stack(np.meshgrid(np.linspace(0, width - 1, 33), np.linspace(0, height - 1, 19)), axis=-1)


@pytest.mark.parametrize("name", LENSES)
def test_projection_is_that_of_opencv(name):
    cv2 = pytest.importorskip("cv2")
    lens = LENSES[name]
    rng = np.random.default_rng(1)
    p_c = np.c_[rng.uniform(-0.9, 0.9, 200), rng.uniform(-0.5, 0.5, 200), np.ones(200)] * rng.uniform(0.3, 8, (200, 1))
    expected, _ = cv2.projectPoints(p_c, np.zeros(3), np.zeros(3), lens.matrix, np.asarray(lens.distortion))
    assert np.abs(np.asarray(project(lens, jnp.asarray(p_c))) - expected[:, 0]).max() < 1e-9


@pytest.mark.parametrize("name", LENSES)
@pytest.mark.parametrize("port", [None, *PORTS])
@pytest.mark.parametrize("distance", [0.02, 1.0, 20.0])
def test_a_ray_leads_back_to_its_pixel(name, port, distance):
    lens = LENSES[name]
    lens = lens_from(lens.focal, lens.principal, lens.size, lens.distortion, PORTS[port] if port else None)
    point, direction = ray(lens, jnp.asarray(pixels(lens)))
    assert np.allclose(np.linalg.norm(direction, axis=-1), 1.0)
    assert np.abs(np.asarray(project(lens, point + distance * direction)) - pixels(lens)).max() < 1e-8


def test_far_away_a_port_makes_the_image_larger_by_the_index_of_water_near_the_axis():
    lens = LENSES["pinhole"]
    wet = lens_from(lens.focal, lens.principal, lens.size, (), Port.of(0.02))
    p_c = jnp.array([[0.05, 0.0, 10.0]])
    grown = (project(wet, p_c) - lens.principal)[0, 0] / (project(lens, p_c) - lens.principal)[0, 0]
    assert grown == pytest.approx(1.333, rel=2e-3)


def test_at_the_port_refraction_obeys_snell():
    lens = lens_from([800, 800], [639.5, 359.5], (1280, 720), (), PORTS["thick"])
    point, direction = ray(lens, jnp.array([1100.0, 359.5]))
    air = np.arctan((1100.0 - 639.5) / 800.0)
    assert np.arcsin(direction[0]) == pytest.approx(np.arcsin(np.sin(air) / 1.333))
    assert point[0] == pytest.approx(0.03 * np.tan(air) + 0.01 * np.tan(np.arcsin(np.sin(air) / 1.49)))
    assert point[2] == pytest.approx(0.04)


def test_what_lies_behind_is_no_number():
    assert np.isnan(project(LENSES["thesis"], jnp.array([0.1, 0.1, -1.0]))).all()


def test_half_the_pixels_show_the_same_scene():
    lens = LENSES["thesis"]
    small = lens.scaled(0.5)
    assert small.size == (960, 540)
    p_c = jnp.array([0.3, -0.2, 1.0])
    # The corner of the image, not the middle of the first pixel, is what both have in common.
    assert np.allclose(project(small, p_c) + 0.5, 0.5 * (project(lens, p_c) + 0.5))


def test_cameras_of_a_pair_look_ahead_from_where_table_5_9_has_them():
    left, right = cameras_of(load_vehicle("double_blueye_thesis"))
    assert np.allclose(left.position, [0.25, -0.29, -0.09])
    assert np.allclose(right.position, [0.25, 0.29, -0.09])
    assert np.allclose(left.R_bc @ [0, 0, 1], [1, 0, 0])  # along x
    assert np.allclose(left.R_bc @ [0, 1, 0], [0, 0, 1])  # image down is body down
    assert left.lens.size == (1920, 1080)


def test_a_port_in_the_vehicle_file_is_looked_through():
    data = load_vehicle("double_blueye").to_dict()
    dry = cameras_of(vehicle_from_dict(data, "dry"))[0].lens
    first = next(part for part in data["parts"] if part.get("cameras"))
    first["cameras"][0]["port"] = {"distance": 0.03, "thickness": 0.005}
    wet = cameras_of(vehicle_from_dict(data, "wet"))[0].lens
    corner = jnp.array([[0.5, 0.2, 1.0]])
    expected = project(lens_from(dry.focal, dry.principal, dry.size, dry.distortion, Port.of(0.03, 0.005)), corner)
    np.testing.assert_allclose(project(wet, corner), expected)
    assert np.linalg.norm(project(wet, corner) - project(dry, corner)) > 100.0


def test_a_port_that_cannot_be_is_refused():
    data = load_vehicle("double_blueye").to_dict()
    first = next(part for part in data["parts"] if part.get("cameras"))
    first["cameras"][0]["port"] = {"distance": -0.03, "water": 0.9}
    with pytest.raises(ConfigError) as error:
        vehicle_from_dict(data, "wrong")
    assert "port.distance" in str(error.value) and "port.water" in str(error.value)
