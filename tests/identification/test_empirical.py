"""Eidsvik's method: the published numbers, what does not follow from it, physics, limits, and how wide it must be."""

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.priors.empirical import DOUBLE_BLUEYE, SINGLE_BLUEYE, against_thesis, estimate
from rovtwin.identification.priors.outline import Outline, full_box, outline_of
from rovtwin.identification.priors.widths import LogNormal, prior_widths
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.constants import AXES


def test_a_single_blueye_to_the_printed_digits():
    found = estimate(SINGLE_BLUEYE, 1025.0).added_mass[:3]
    assert [f"{value:.4f}" for value in found] == ["5.2171", "19.8729", "11.2643"]


def test_the_double_blueye_to_the_printed_digits():
    found = estimate(DOUBLE_BLUEYE, 1000.0).added_mass
    assert [f"{value:.2f}" for value in found[:3]] == ["21.19", "13.31", "28.64"]
    assert [f"{value:.3f}" for value in found[3:]] == ["1.744", "0.658", "1.504"]


def test_drag_of_the_double_blueye_as_printed():
    """(3.4), (3.5), translations; (3.5) cuts 14.488 off after two digits."""
    found = estimate(DOUBLE_BLUEYE, 1000.0)
    assert [f"{value:.2f}" for value in found.quadratic_damping[:3]] == ["90.55", "46.58", "194.05"]
    np.testing.assert_allclose(found.linear_damping[:3], [14.48, 7.45, 31.05], atol=0.01)


def test_what_the_thesis_prints_and_does_not_follow_is_named():
    wrong = {(row.quantity, row.axis) for row in against_thesis() if not row.follows}
    turning = {("quadratic_damping", axis) for axis in AXES[3:]} | {("linear_damping", axis) for axis in AXES[3:]}
    assert wrong == {("added_mass", "sway"), ("added_mass", "pitch")} | turning
    assert len(against_thesis()) == 18


def test_everything_scales_with_the_water_and_the_size():
    """Added mass goes with the cube and the fifth power of the size, drag with the square and the fifth."""
    small = estimate(DOUBLE_BLUEYE)
    large = estimate(Outline(2 * DOUBLE_BLUEYE.size, 4 * DOUBLE_BLUEYE.areas), 2000.0)
    np.testing.assert_allclose(large.added_mass / small.added_mass, 2 * np.array([8.0] * 3 + [32.0] * 3))
    np.testing.assert_allclose(large.quadratic_damping / small.quadratic_damping, 2 * np.array([4.0] * 3 + [32.0] * 3))
    assert large.scaling == pytest.approx(small.scaling)


def test_an_open_frame_carries_and_drags_less():
    closed, half = full_box(np.array([0.6, 0.4, 0.4])), np.array([0.08, 0.12, 0.12])
    less, full = estimate(Outline(closed.size, half)), estimate(closed)
    assert (less.added_mass < full.added_mass).all()
    np.testing.assert_allclose(less.quadratic_damping[:3], 0.5 * full.quadratic_damping[:3])


def test_linear_damping_in_rotation_needs_inertia_and_stiffness():
    assert np.isnan(estimate(DOUBLE_BLUEYE).linear_damping[3:]).all()
    assert "linear_damping.roll" not in estimate(DOUBLE_BLUEYE).priors()
    inertia, stiffness = np.array([2.69, 0.85]), np.array([7.4, 7.4])
    found = estimate(DOUBLE_BLUEYE, 1000.0, inertia, stiffness)
    critical = 2 * np.sqrt(stiffness * (inertia + found.added_mass[3:5]))
    np.testing.assert_allclose(found.linear_damping[3:5] / critical, 0.025)
    assert np.isnan(estimate(DOUBLE_BLUEYE, 1000.0, inertia, np.zeros(2)).linear_damping[3:]).all()


@pytest.mark.parametrize("size", [(0.05, 0.5, 0.5), (3.0, 0.2, 0.2), (0.5, 0.5, 0.02)])
def test_plates_and_torpedoes_are_refused(size):
    with pytest.raises(IdentificationError, match="expected a box-like"):
        estimate(full_box(np.array(size)))


def test_areas_that_cannot_be_are_refused():
    with pytest.raises(IdentificationError, match="looks like mm2"):
        Outline(DOUBLE_BLUEYE.size, np.array([173964.0, 140366.0, 301998.0]))
    with pytest.raises(IdentificationError, match="front area"):
        Outline(DOUBLE_BLUEYE.size, np.array([0.5, 0.14, 0.3]))
    with pytest.raises(IdentificationError, match="three lengths"):
        Outline(np.array([0.5, 0.0, 0.3]), np.array([0.1, 0.1, 0.1]))


def test_the_outline_of_two_hulls_counts_what_covers_once():
    """Side by side they double the front and the top, not the side."""
    hull = {"box": [0.4, 0.2, 0.3]}
    parts = [
        {"name": name, "mass": 5.0, "shape": hull, "pose": {"position": [0, y, 0]}}
        for name, y in (("a", -0.3), ("b", 0.3))
    ]
    found = outline_of(vehicle_from_dict({"name": "v", "description": "", "parts": parts}))
    np.testing.assert_allclose(found.size, [0.4, 0.8, 0.3])
    np.testing.assert_allclose(found.areas, [0.12, 0.12, 0.16], rtol=5e-3)


@pytest.mark.system
def test_the_outline_of_a_sphere_is_a_disc():
    vehicle = vehicle_from_dict({"name": "v", "description": "", "mass": 5.0, "shape": {"sphere": 0.25}})
    np.testing.assert_allclose(outline_of(vehicle).areas, np.pi * 0.25**2, rtol=0.02)


def test_a_vehicle_without_shapes_is_named():
    with pytest.raises(IdentificationError, match=r"bluerov2.yaml: no part has a 'shape'"):
        outline_of(load_vehicle("bluerov2"))


def test_a_log_normal_holds_a_factor():
    prior = LogNormal("added_mass.surge", 20.0, 0.5, "kg", "test")
    low, high = prior.interval
    assert low * high == pytest.approx(20.0**2) and high / 20.0 == pytest.approx(np.exp(0.98))
    assert prior.deviation(20.0 * np.exp(1.0)) == pytest.approx(2.0)
    assert prior.deviation(0.0) == -np.inf


# What tests and the panel method say of the Double Blueye: towing (4.3) to (4.4), decay and yaw tests fitted again.
MEASURED = {
    "added_mass.surge": 31.3,
    "added_mass.sway": 57.2,
    "added_mass.heave": 44.6,
    "added_mass.roll": 2.48,
    "added_mass.pitch": 0.83,
    "added_mass.yaw": 2.53,
    "linear_damping.roll": 3.04,
    "linear_damping.pitch": 1.34,
    "linear_damping.surge": 6.48,
    "linear_damping.sway": 3.12,
    "linear_damping.heave": 22.75,
    "quadratic_damping.surge": 158.86,
    "quadratic_damping.sway": 146.38,
    "quadratic_damping.yaw": 7.7,
}


def test_the_prior_holds_what_was_measured_and_is_not_idly_wide():
    """95 % of what was measured lies inside; and the deviations are not all tiny, which would say it is too wide."""
    priors = estimate(DOUBLE_BLUEYE, 1000.0, np.array([2.69, 0.85]), np.array([7.36, 7.36])).priors()
    deviations = np.array([priors[name].deviation(value) for name, value in MEASURED.items()])
    assert np.abs(deviations).max() < 1.96
    assert 0.5 < np.sqrt(np.mean(deviations**2)) < 1.2


def test_widths_by_what_is_known():
    names = {f"{q}.{a}" for q in ("added_mass", "linear_damping", "quadratic_damping") for a in AXES}
    shaped, bare = prior_widths(load_vehicle("double_blueye")), prior_widths(load_vehicle("bluerov2"))
    assert set(shaped) == set(bare) == names
    assert all(0.2 < width < 2.5 for width in (*shaped.values(), *bare.values()))
    assert np.mean([np.log(bare[name] / shaped[name]) for name in names]) > 0.1


def test_an_open_hull_is_known_less():
    def of(volume):
        return vehicle_from_dict(
            {"name": "v", "description": "", "mass": 20.0, "volume": volume, "shape": {"box": [0.5, 0.4, 0.3]}}
        )

    closed, flooded = prior_widths(of(0.06)), prior_widths(of(0.02))
    assert closed["added_mass.surge"] == pytest.approx(0.3)
    assert flooded["added_mass.surge"] == pytest.approx(np.hypot(0.3, 0.5 * np.log(3)))
    assert flooded["linear_damping.surge"] == closed["linear_damping.surge"]


def test_the_panel_method_is_worth_more_than_formulas():
    vehicle = load_vehicle("double_blueye")
    assert prior_widths(vehicle, panel=True)["added_mass.surge"] < prior_widths(vehicle)["added_mass.surge"]
