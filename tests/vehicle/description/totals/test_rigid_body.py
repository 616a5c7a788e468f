"""Rigid body of assemblies: against clouds of point masses, and under moves of the whole vehicle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.core.arrays.rotations import rotation_from_euler
from rovtwin.vehicle import vehicle_from_dict
from rovtwin.vehicle.description.schema import Shape
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.totals.rigid_body import MassProperties, combine
from rovtwin.vehicle.physics.model import rigid_body_matrix
from rovtwin.vehicle.solids.placement import Placement

seeds = st.integers(0, 2**32 - 1)


def of_points(mass, points):
    """Mass, CG and tensor about CG by definition, from point masses (n,) at (n, 3)."""
    center = mass @ points / mass.sum()
    d = points - center
    inertia = sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for m, x in zip(mass, d, strict=True))
    return mass.sum(), center, inertia


def cloud(rng, size=12):
    """A random body as points: every such tensor is possible, products of inertia included."""
    return rng.uniform(0.1, 2.0, size), rng.normal(size=(size, 3)) * rng.uniform(0.05, 0.5, 3)


def M_RB(body):
    return np.asarray(rigid_body_matrix(body.mass, body.inertia, body.center_of_gravity))


def six(matrix):
    return [float(v) for v in (*np.diag(matrix), matrix[0, 1], matrix[0, 2], matrix[1, 2])]


@given(seeds)
def test_parts_add_up_to_the_cloud_of_their_points(seed):
    rng = np.random.default_rng(seed)
    parts, masses, points = [], [], []
    for i in range(rng.integers(1, 5)):
        mass, at = cloud(rng)
        total, center, inertia = of_points(mass, at)
        position, attitude = rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3)
        parts.append(
            {
                "name": f"p{i}",
                "mass": float(total),
                "center_of_gravity": center.tolist(),
                "inertia": six(inertia) if i % 2 else inertia.tolist(),
                "pose": {"position": position.tolist(), "attitude_deg": attitude.tolist()},
            }
        )
        masses.append(mass)
        points.append(position + at @ rotation_from_euler(np.radians(attitude)).T)
    expected = of_points(np.concatenate(masses), np.concatenate(points))
    solid = vehicle_from_dict({"name": "v", "description": "cloud", "parts": parts}).assembly.solid
    np.testing.assert_allclose(solid.mass, expected[0], rtol=1e-12)
    np.testing.assert_allclose(solid.center_of_gravity, expected[1], atol=1e-12)
    np.testing.assert_allclose(solid.inertia, expected[2], rtol=1e-9, atol=1e-11)


@given(seeds)
def test_nesting_changes_nothing(seed):
    """A part of a part of a part is the same as its points carried through all poses."""
    rng = np.random.default_rng(seed)
    mass, at = cloud(rng)
    total, center, inertia = of_points(mass, at)
    data = {"mass": float(total), "center_of_gravity": center.tolist(), "inertia": six(inertia)}
    points = at
    for depth in range(3):
        position, attitude = rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3)
        pose = {"position": position.tolist(), "attitude_deg": attitude.tolist()}
        data = {"parts": [{"name": f"level{depth}", "pose": pose, **data}]}
        points = position + points @ rotation_from_euler(np.radians(attitude)).T
    solid = vehicle_from_dict({"name": "v", "description": "nested", **data}).assembly.solid
    np.testing.assert_allclose(solid.center_of_gravity, of_points(mass, points)[1], atol=1e-12)
    np.testing.assert_allclose(solid.inertia, of_points(mass, points)[2], rtol=1e-9, atol=1e-11)


@given(seeds)
def test_kinetic_energy_is_that_of_the_points(seed):
    """M_RB at CO gives the energy of the points in any motion: it is right as a whole, signs included."""
    rng = np.random.default_rng(seed)
    mass, points = cloud(rng)
    total, center, inertia = of_points(mass, points)
    M = M_RB(MassProperties(total, center, inertia))
    nu = rng.normal(size=6)
    velocity = nu[:3] + np.cross(nu[3:], points)
    np.testing.assert_allclose(0.5 * nu @ M @ nu, 0.5 * np.sum(mass * np.sum(velocity**2, axis=1)), rtol=1e-10)


@given(seeds)
def test_moving_the_whole_vehicle_moves_M_by_the_same_transform(seed):
    rng = np.random.default_rng(seed)
    mass, points = cloud(rng)
    body = MassProperties(*of_points(mass, points))
    placement = Placement.of(rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3))
    H = placement.twist()
    np.testing.assert_allclose(M_RB(body.moved(placement)), H.T @ M_RB(body) @ H, rtol=1e-9, atol=1e-11)


def test_two_half_boxes_are_one_box():
    half = {"mass": 5.0, "shape": {"box": [0.4, 0.3, 0.2]}}
    parts = [
        {"name": "fore", "pose": {"position": [0.2, 0, 0]}, **half},
        # The other half is mounted backwards: a box does not care.
        {"name": "aft", "pose": {"position": [-0.2, 0, 0], "attitude_deg": [0, 0, 180]}, **half},
    ]
    two = vehicle_from_dict({"name": "two", "description": "halves", "parts": parts}).assembly
    one = vehicle_from_dict(
        {"name": "one", "description": "whole", "mass": 10.0, "shape": {"box": [0.8, 0.3, 0.2]}}
    ).assembly
    np.testing.assert_allclose(two.solid.inertia, one.solid.inertia, atol=1e-14)
    np.testing.assert_allclose(two.volume, one.volume)
    np.testing.assert_allclose(two.center_of_buoyancy, one.center_of_buoyancy, atol=1e-15)


@pytest.mark.parametrize(
    ("shape", "inertia"),
    [
        ({"box": [0.4, 0.3, 0.2]}, [0.13 / 12, 0.2 / 12, 0.25 / 12]),
        ({"cylinder": {"radius": 0.2, "length": 0.6}}, [0.02, 0.01 + 0.03, 0.01 + 0.03]),
        ({"sphere": 0.5}, [0.1, 0.1, 0.1]),
        ({"ellipsoid": [0.3, 0.2, 0.1]}, [0.01, 0.02, 0.026]),
    ],
)
def test_homogeneous_shapes(shape, inertia):
    """Per kilogram: m/12 (b^2 + c^2), m r^2 / 2 and m (3 r^2 + l^2) / 12, 2/5 m r^2, m/5 (b^2 + c^2)."""
    solid = Solid.of(Shape.model_validate(shape))
    np.testing.assert_allclose(np.diag(solid.homogeneous(1.0).inertia), inertia, rtol=1e-12)


def test_without_mass_there_is_nothing():
    assert combine([]).mass == 0.0


def test_the_thesis_formula_would_be_wrong():
    """(2.19) adds m |d|^2 of the whole offset: a mass 1 m ahead would add an inertia in roll that it does not have."""
    parts = [
        {"name": "ball", "mass": 2.0, "shape": {"sphere": 0.1}, "pose": {"position": [1.0, 0, 0]}},
        {"name": "twin", "mass": 2.0, "shape": {"sphere": 0.1}, "pose": {"position": [-1.0, 0, 0]}},
    ]
    inertia = vehicle_from_dict({"name": "v", "description": "dumb-bell", "parts": parts}).assembly.solid.inertia
    own = 2 / 5 * 2.0 * 0.1**2
    np.testing.assert_allclose(np.diag(inertia), [2 * own, 2 * own + 4, 2 * own + 4], rtol=1e-12)
