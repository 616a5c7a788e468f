"""Added mass and damping computed from shapes: exact cases, panel results, moves, energy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.schema import Shape
from rovtwin.vehicle.description.totals.added_mass import Solid, added_mass, move_matrix
from rovtwin.vehicle.description.totals.drag import (
    CROSSOVER_SPEED,
    Damping,
    DragElements,
    coupling_load,
    drag_elements,
    tamed,
)
from rovtwin.vehicle.description.totals.validation import driving_velocity
from rovtwin.vehicle.solids.placement import Placement

seeds = st.integers(0, 2**32 - 1)
RHO = 1000.0


def solid(**shape):
    return Solid.of(Shape.model_validate(shape))


def random_shape(rng):
    kind = rng.choice(["box", "cylinder", "sphere", "ellipsoid"])
    size = rng.uniform(0.05, 0.6, 3)
    values = {
        "box": size.tolist(),
        "cylinder": {"radius": float(size[0]), "length": float(size[1])},
        "sphere": float(size[0]),
        "ellipsoid": size.tolist(),
    }
    return {kind: values[kind], "attitude_deg": rng.uniform(-180, 180, 3).tolist()}


def random_vehicle(rng):
    parts = [
        {
            "name": f"p{i}",
            "mass": 1.0,
            "shape": random_shape(rng),
            "pose": {
                "position": rng.uniform(-0.5, 0.5, 3).tolist(),
                "attitude_deg": rng.uniform(-180, 180, 3).tolist(),
            },
        }
        for i in range(rng.integers(1, 4))
    ]
    hull = {"name": "hull", "mass": 20.0, "shape": {"box": rng.uniform(0.3, 0.8, 3).tolist()}}
    return {"name": "v", "description": "random", "parts": [hull, *parts]}


def test_sphere_is_exact():
    """Half the displaced mass, nothing in rotation."""
    M = added_mass(solid(sphere=0.3), RHO)
    half = 0.5 * RHO * 4 / 3 * np.pi * 0.3**3
    np.testing.assert_allclose(M, np.diag([half, half, half, 0, 0, 0]), rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("ratio", [1.1, 1.5, 2.0, 4.0, 10.0, 40.0])
def test_prolate_spheroids_agree_with_lambs_closed_form(ratio):
    """Lamb (1932), sec. 114 and 115: k1, k2 on the displaced mass, k' on its moment of inertia."""
    a, b = ratio * 0.1, 0.1
    M = added_mass(solid(ellipsoid=[a, b, b]), RHO).diagonal()
    mass = RHO * 4 / 3 * np.pi * a * b * b
    inertia = mass * (a * a + b * b) / 5
    e = np.sqrt(1 - 1 / ratio**2)
    log = np.log((1 + e) / (1 - e))
    alpha, beta = 2 * (1 - e**2) / e**3 * (log / 2 - e), 1 / e**2 - (1 - e**2) / (2 * e**3) * log
    turning = e**4 * (beta - alpha) / ((2 - e**2) * (2 * e**2 - (2 - e**2) * (beta - alpha)))
    along, across = alpha / (2 - alpha), beta / (2 - beta)
    np.testing.assert_allclose(M[:3] / mass, [along, across, across], rtol=1e-7)
    np.testing.assert_allclose(M[3:] / inertia, [0, turning, turning], rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize(
    ("size", "panels"),
    # Panel method (capytaine, unbounded water, unit density), uniform panels of 8 % of the length or less; the limit of
    # fine panels (docs/scripts/priors.py) is 2 to 4 % lower in translation, up to 10 % in rotation.
    [
        ((1, 1, 1), (0.655, 0.655, 0.655, 0.0431, 0.0431, 0.0431)),
        ((1, 1, 0.5), (0.230, 0.230, 0.620, 0.0259, 0.0259, 0.0188)),
        ((1, 0.5, 0.25), (0.0307, 0.0701, 0.2022, 0.0018, 0.0106, 0.0042)),
        ((1, 0.53, 0.73), (0.1641, 0.3913, 0.2456, 0.0088, 0.0136, 0.0179)),
        ((2, 1, 0.4), (0.1755, 0.3928, 1.6045, 0.0586, 0.3415, 0.0991)),
    ],
)
def test_boxes_agree_with_the_panel_method(size, panels):
    M = added_mass(solid(box=[float(s) for s in size]), 1.0).diagonal()
    np.testing.assert_allclose(M, panels, rtol=0.12)


def test_long_cylinder_carries_its_own_volume_across():
    M = added_mass(solid(cylinder={"radius": 0.05, "length": 5.0}), RHO).diagonal()
    displaced = RHO * np.pi * 0.05**2 * 5.0
    np.testing.assert_allclose(M[1:3], displaced, rtol=0.02)
    # Plane flow: rho pi r^2 per length, turned about the middle.
    np.testing.assert_allclose(M[4:], displaced * 5.0**2 / 12, rtol=0.1)
    assert M[3] == 0.0
    assert M[0] < 0.02 * displaced


@given(seeds)
def test_a_moved_part_carries_the_same_energy(seed):
    """nu' M' nu = nu_part' M nu_part: what the part itself feels."""
    rng = np.random.default_rng(seed)
    M = added_mass(solid(**random_shape(rng)), RHO)
    placement = Placement.of(rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3))
    nu = rng.normal(size=6)
    R, r = placement.rotation, placement.position
    local = np.concatenate([R.T @ (nu[:3] + np.cross(nu[3:], r)), R.T @ nu[3:]])
    np.testing.assert_allclose(nu @ move_matrix(M, placement) @ nu, local @ M @ local, rtol=1e-10)


@given(seeds)
def test_moving_the_whole_vehicle_moves_its_hydrodynamics(seed):
    """Mounted as one part at a pose, the vehicle has the same matrices seen from elsewhere."""
    rng = np.random.default_rng(seed)
    data = random_vehicle(rng)
    pose = {"position": rng.uniform(-1, 1, 3).tolist(), "attitude_deg": rng.uniform(-180, 180, 3).tolist()}
    inner = {key: value for key, value in data.items() if key != "description"}
    moved = vehicle_from_dict(
        {"name": "outer", "description": "moved", "parts": [{**inner, "name": "inner", "pose": pose}]}
    )
    placement = Placement.of(pose["position"], pose["attitude_deg"])
    still = vehicle_from_dict(data).assembly
    np.testing.assert_allclose(
        moved.assembly.added_mass, move_matrix(still.added_mass, placement), rtol=1e-9, atol=1e-9
    )
    # Linear drag is a matrix like any other.
    np.testing.assert_allclose(
        moved.assembly.damping().linear_ahead,
        move_matrix(still.damping().linear_ahead, placement),
        rtol=1e-9,
        atol=1e-9,
    )


@given(seeds)
def test_drag_from_shapes_takes_energy(seed):
    damping = vehicle_from_dict(random_vehicle(np.random.default_rng(seed))).assembly.damping()
    assert driving_velocity(damping) is None


@pytest.mark.parametrize("kind", ["box", "cylinder", "ellipsoid"])
def test_drag_is_half_rho_cd_area(kind):
    shapes = {
        "box": ({"box": [0.6, 0.4, 0.2]}, [0.08, 0.12, 0.24]),
        "cylinder": ({"cylinder": {"radius": 0.1, "length": 0.5}}, [np.pi * 0.01, 0.1, 0.1]),
        "ellipsoid": ({"ellipsoid": [0.3, 0.2, 0.1]}, [np.pi * 0.02, np.pi * 0.03, np.pi * 0.06]),
    }
    shape, areas = shapes[kind]
    damping = drag_elements(solid(**shape, drag_coefficient=[1.0, 1.5, 2.0]), RHO).damping()
    expected = 0.5 * RHO * np.array([1.0, 1.5, 2.0]) * areas
    np.testing.assert_allclose(np.diag(damping.quadratic_ahead)[:3], expected, rtol=1e-9)
    np.testing.assert_allclose(np.diag(damping.linear_ahead)[:3], CROSSOVER_SPEED * expected, rtol=1e-9)


def test_a_turning_plate_feels_the_cube_of_its_lever():
    """A thin plate of length L and height h turning about its middle: 1/2 rho C_D h L^4 / 32."""
    plate = solid(box=[1.0, 1e-6, 0.2], drag_coefficient=[0.0, 1.2, 0.0])
    damping = drag_elements(plate, RHO).damping()
    np.testing.assert_allclose(damping.quadratic_ahead[5, 5], 0.5 * RHO * 1.2 * 0.2 / 32, rtol=5e-3)


def test_drag_of_a_disc_has_the_lever_of_a_disc():
    """Tilting a disc about a diameter: integral of |x|^3 over it is 8 R^5 / 15."""
    disc = solid(cylinder={"radius": 0.3, "length": 1e-6}, drag_coefficient=[1.0, 0.0, 0.0])
    damping = drag_elements(disc, RHO).damping()
    np.testing.assert_allclose(damping.quadratic_ahead[4, 4], 0.5 * RHO * 8 * 0.3**5 / 15, rtol=0.05)


def test_two_hulls_side_by_side_damp_yaw_by_their_lever():
    """What the Double Blueye's outriggers do: each hull is dragged along its own axis at +-y r."""
    y = 0.28
    hull = Damping(*(np.diag([80.0, 0, 0, 0, 0, 0]) for _ in range(4)))
    both = hull.moved(Placement.of([0, y, 0])) + hull.moved(Placement.of([0, -y, 0]))
    np.testing.assert_allclose(np.diag(both.quadratic_ahead)[[0, 5]], [160.0, 160.0 * y**3])
    np.testing.assert_allclose(np.diag(both.linear_ahead)[[0, 5]], [160.0, 160.0 * y**2])
    # Port and starboard cancel what couples surge and yaw.
    np.testing.assert_allclose(both.quadratic_ahead[0, 5], 0.0, atol=1e-12)


def test_one_hull_off_the_middle_turns_the_vehicle():
    """Dragged on starboard (+y), moving ahead turns the nose to starboard: N > 0, so damping's row is negative."""
    hull = Damping(*(np.diag([80.0, 0, 0, 0, 0, 0]) for _ in range(4)))
    moved = hull.moved(Placement.of([0, 0.3, 0]))
    np.testing.assert_allclose(moved.quadratic_ahead[5, 0], -80.0 * 0.3)
    # D(nu) nu is subtracted from the equations of motion.
    np.testing.assert_allclose(-moved.quadratic_ahead[5, 0], 24.0)


def test_ahead_and_astern_swap_when_a_part_is_turned_round():
    ahead, astern = np.diag([1.0, 0, 0, 0, 0, 0]), np.diag([7.0, 0, 0, 0, 0, 0])
    part = Damping(ahead, astern, 2 * ahead, 2 * astern)
    turned = part.moved(Placement.of([0, 0, 0], [0, 0, 180]))
    np.testing.assert_allclose(turned.linear_ahead, astern, atol=1e-12)
    np.testing.assert_allclose(turned.linear_astern, ahead, atol=1e-12)
    np.testing.assert_allclose(turned.quadratic_ahead, 2 * astern, atol=1e-12)


def test_coupled_damping_that_drives_is_found():
    linear = np.diag([5.0, 5, 5, 1, 1, 1])
    linear[0, 1] = linear[1, 0] = 6.0
    found = driving_velocity(Damping(linear, linear, np.zeros((6, 6)), np.zeros((6, 6))))
    assert found is not None
    nu, power = found
    assert power > 0
    assert nu @ linear @ nu < 0
    # Skew coupling turns but does no work.
    linear[1, 0] = -6.0
    assert driving_velocity(Damping(linear, linear, np.zeros((6, 6)), np.zeros((6, 6)))) is None


def random_drag(rng, pieces):
    """Flat pieces anywhere: what no vehicle looks like, but what every drag is made of."""
    normal = rng.normal(size=(pieces, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return DragElements(rng.uniform(-1, 1, (pieces, 3)), normal, rng.uniform(1, 100, pieces))


@given(seeds, st.integers(1, 8))
def test_tamed_damping_never_drives(seed, pieces):
    """Even one plate far off the axes, whose matrix would: searched for, not only bounded."""
    rng = np.random.default_rng(seed)
    raw = random_drag(rng, pieces).damping()
    safe = tamed(raw)
    nu = rng.normal(size=(20000, 6)) * 10 ** rng.uniform(-2, 1, (20000, 1))
    s = np.abs(nu) * nu
    power = np.sum(nu * (s @ safe.quadratic_ahead.T), axis=1)
    assert power.min() >= -1e-9 * np.abs(power).max()
    # What is right for each direction alone stays.
    np.testing.assert_allclose(np.diag(safe.quadratic_ahead), np.diag(raw.quadratic_ahead))
    np.testing.assert_allclose(safe.linear_ahead, raw.linear_ahead)


def test_a_lone_plate_off_all_axes_needs_taming():
    """Three motions that meet at one plate: its matrix for single motions drives it, the search finds that."""
    raw = DragElements(np.array([[1.0, 1.0, 1.0]]), np.array([[1.0, 0.0, 0.0]]), np.array([100.0])).damping()
    strong = Damping(np.zeros((6, 6)), np.zeros((6, 6)), raw.quadratic_ahead, raw.quadratic_astern)
    assert driving_velocity(strong) is not None
    assert driving_velocity(tamed(strong)) is None


def test_weak_couplings_are_left_alone():
    damping = load_vehicle("double_blueye").assembly
    parts = sum((e.damping() for e in damping.elements), damping.measured)
    np.testing.assert_array_equal(tamed(parts).quadratic_ahead, parts.quadratic_ahead)
    # Two motions at one plate are the limit, exactly.
    plate = Damping(*(np.diag([80.0, 0, 0, 0, 0, 0]) for _ in range(4))).moved(Placement.of([0, 0.3, 0]))
    np.testing.assert_allclose(coupling_load(plate.quadratic_ahead, plate.quadratic_astern, 2)[[0, 5]], 1.0)
    np.testing.assert_allclose(tamed(plate).quadratic_ahead, plate.quadratic_ahead)


def test_water_density_scales_what_the_water_does():
    vehicle = vehicle_from_dict(random_vehicle(np.random.default_rng(3)))
    fresh, sea = vehicle.assembly, vehicle.assembly.in_water(1025.0)
    np.testing.assert_allclose(sea.added_mass, 1.025 * fresh.added_mass)
    np.testing.assert_allclose(sea.damping().quadratic_ahead, 1.025 * fresh.damping().quadratic_ahead)
    assert sea.volume == fresh.volume
    assert sea.density == 1025.0
