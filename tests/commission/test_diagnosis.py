"""What columns of pushes are put down to: made-up columns of several vehicles, with one mistake each and noise."""

import numpy as np
import pytest

from rovtwin.commission.dip.correction import corrected
from rovtwin.commission.dip.diagnosis import Verdict, verdicts
from rovtwin.commission.dip.response import Columns
from rovtwin.vehicle import load_vehicle

VEHICLES = ("double_blueye", "bluerov2_heavy", "bluerov2", "gladius_mini")


def columns_of(vehicle, change, seed=0, noise=0.02, wrong_masses=0.3):
    """Columns as pushes would give them, of a vehicle whose masses are not those of the file."""
    model, rng = load_vehicle(vehicle).model(), np.random.default_rng(seed)
    inverse, T = np.asarray(model.inertia_inverse), np.asarray(model.thrusters.configuration)
    expected = inverse @ T
    largest = np.abs(expected).max(axis=1, keepdims=True)
    scale = np.exp(rng.normal(0.0, wrong_masses, (6, 1)))
    measured = scale * change(expected.copy()) + noise * largest * rng.normal(size=expected.shape)
    return Columns(measured, np.broadcast_to(noise * largest, expected.shape), inverse, T, np.ones(6), 0.0)


def found(vehicle, change, **how):
    names = load_vehicle(vehicle).thruster_names
    return verdicts(columns_of(vehicle, change, **how), names)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_nothing_is_wrong_with_a_sound_vehicle_of_other_masses(vehicle):
    for seed in range(10):
        assert [one.what for one in found(vehicle, lambda c: c, seed=seed)] == ["ok"] * len(
            load_vehicle(vehicle).thruster_names
        )


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("factor, what", [(-1.0, "reversed"), (0.0, "dead"), (0.6, "weak")])
def test_each_thruster_is_named(vehicle, factor, what):
    for i, name in enumerate(load_vehicle(vehicle).thruster_names):

        def change(c, i=i):
            c[:, i] *= factor
            return c

        judged = found(vehicle, change, wrong_masses=0.1)
        # Where one thruster alone pushes an axis, its force and the mass there cannot be told apart.
        if what == "weak" and judged[i].what == "ok":
            assert alone(vehicle, i), name
            continue
        wrong = [(one.name, one.what) for one in judged if one.what != "ok"]
        assert wrong == [(name, what)], vehicle


def alone(vehicle, i):
    """Whether a thruster has no other that pushes its axes."""
    T = np.abs(np.asarray(load_vehicle(vehicle).model().thrusters.configuration))
    mine = T[:, i] > 1e-6
    return not np.delete(T, i, axis=1)[mine].any()


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_swapped_thrusters_are_named_where_they_differ(vehicle):
    names = load_vehicle(vehicle).thruster_names
    expected = columns_of(vehicle, lambda c: c, noise=0.0, wrong_masses=0.0).expected
    for i in range(len(names)):
        for k in range(i):
            unlike = expected[:, i] @ expected[:, k] / np.linalg.norm(expected[:, i]) / np.linalg.norm(expected[:, k])
            if unlike > 0.3:
                continue

            def change(c, i=i, k=k):
                c[:, [i, k]] = c[:, [k, i]]
                return c

            judged = found(vehicle, change, wrong_masses=0.05)
            assert {judged[i].what, judged[k].what} <= {"swapped", "reversed"}, (names[i], names[k])
            assert all(judged[j].what == "ok" for j in range(len(names)) if j not in (i, k)), (names[i], names[k])


def test_a_turned_thruster_comes_with_its_direction():
    model = load_vehicle("double_blueye").model()
    T = np.asarray(model.thrusters.configuration).copy()
    angle = np.radians(60.0)
    force = np.array([np.cos(angle), np.sin(angle), 0.0])
    place = np.array([0.0, -0.28, 0.0])
    T[:, 0] = np.concatenate([force, np.cross(place, force)])
    inverse = np.asarray(model.inertia_inverse)
    judged = found("double_blueye", lambda c: inverse @ T, noise=0.01, wrong_masses=0.0)
    assert judged[0].what == "rotated" and all(one.what == "ok" for one in judged[1:])
    assert judged[0].direction is not None
    x, y, _ = judged[0].direction
    assert abs(np.degrees(np.arctan2(y, x)) - 60.0) < 15.0


def test_axes_that_sensors_do_not_tell_are_no_verdict():
    columns = columns_of("double_blueye", lambda c: c, noise=2.0)
    assert {one.what for one in verdicts(columns, load_vehicle("double_blueye").thruster_names)} == {"unseen"}


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_the_corrected_file_is_the_vehicle_as_it_was_found(vehicle, tmp_path):
    one = load_vehicle(vehicle)
    names, before = one.thruster_names, np.asarray(one.model().thrusters.configuration)
    judged = [Verdict(name, "ok", 1.0, 1.0) for name in names]
    judged[0] = Verdict(names[0], "reversed", 1.0, -1.0)
    judged[1] = Verdict(names[1], "swapped", 1.0, 0.0, names[2])
    judged[2] = Verdict(names[2], "swapped", 1.0, 0.0, names[1])
    assert corrected(one, judged, tmp_path / "corrected.yaml")
    after = np.asarray(load_vehicle(tmp_path / "corrected.yaml").model().thrusters.configuration)
    np.testing.assert_allclose(after[:, 0], -before[:, 0], atol=1e-9)
    np.testing.assert_allclose(after[:, [1, 2]], before[:, [2, 1]], atol=1e-9)
    np.testing.assert_allclose(after[:, 3:], before[:, 3:], atol=1e-9)
    assert not corrected(one, [Verdict(name, "ok", 1.0, 1.0) for name in names], tmp_path / "none.yaml")
    assert not (tmp_path / "none.yaml").exists()
