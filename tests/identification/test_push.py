"""What pushes a vehicle and is in no model: it is separated from sensor noise; with an exact model it is nothing."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.identification.broken import Broken, axis_steps, record

from rovtwin.identification.diagnostics.remarks import about_effects, about_segments
from rovtwin.identification.identify import identify
from rovtwin.identification.joint.estimate import estimate
from rovtwin.identification.joint.model.nodes import FADES
from rovtwin.identification.joint.solver.options import MOST_SEGMENTS, Options
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.joint.solver.segments import EFFECTS, cut
from rovtwin.identification.joint.uncertainty.agreement import MOTIONS, _by_motion
from rovtwin.identification.joint.uncertainty.unmodelled import Effects, _at_full_force, _tether, known_of
from rovtwin.report.identification.tables import disturbance_table
from rovtwin.vehicle import load_vehicle

pytestmark = pytest.mark.system

VEHICLE = load_vehicle("double_blueye")
FREE = ["added_mass.surge", "quadratic_damping.surge", "restoring.net_buoyancy"]
CURRENT, GUST = 0.06, 6.0  # of the water [m/s], and how long it lasts [s]


def log_of(broken, duration=40.0):
    t, u = axis_steps(VEHICLE, 0, duration)
    return record(VEHICLE.model(), broken, t, u, duration, signals=("horizontal", "depth", "attitude", "gyro"))


@pytest.fixture(scope="module")
def pushed():
    return identify(VEHICLE, [log_of(Broken(current=CURRENT, gust=GUST))], free=FREE)


def test_water_that_moves_is_not_put_down_to_the_sensors(pushed):
    """But for the gyro: what rolls and pitches the vehicle changes within a second."""
    for (name, i), sigma in zip(pushed.problem.groups, pushed.solution.noise.sigma, strict=True):
        assert name == "gyro" or sigma == pytest.approx(pushed.problem.segments.sigma[name][i], rel=0.25)
    assert pushed.solution.converged


def test_it_is_a_push_along_the_hull_of_the_size_that_it_had(pushed):
    """Water that moves by c changes the drag by (2 X_uu |u| + X_u) c."""
    push = pushed.solution.noise.push(pushed.problem.segments.grid.span)
    model = VEHICLE.model()
    matrices = model.inertia, model.linear_damping_ahead, model.quadratic_damping_ahead
    M, D, D_q = (float(np.asarray(x)[0, 0]) for x in matrices)
    speed = np.abs(np.asarray(pushed.solution.unknowns.nodes.nu)[:, 0])
    expected = np.sqrt(np.mean((2.0 * D_q * speed + D) ** 2)) * CURRENT / M
    assert 0.5 < push[0] / expected < 2.0
    assert push[2] < 0.2 * push[0], "no water moved up and down"
    assert any("pushes for seconds at a time" in line and "N in surge" in line for line in pushed.findings)
    row = next(row for row in disturbance_table(pushed).rows if row[0] == "surge")
    assert float(row[1].split()[0]) == pytest.approx(M * push[0], rel=0.2)


def test_with_an_exact_model_nothing_pushes(pushed):
    shooting, grid = copy(pushed.problem.shooting), pushed.problem.segments.grid
    shooting.segments = cut([log_of(Broken())], grid)
    exact = estimate(Problem(shooting, pushed.prior))
    assert exact.noise.push(grid.span).max() < 2e-3
    std = np.sqrt(np.diag(exact.covariance))
    assert np.all(std < 0.3 * pushed.std), "water that moves makes intervals wide"
    assert np.all(np.abs(exact.unknowns.theta) < 3.0 * std), "the file's values"
    assert np.all(np.abs(exact.effects.size) < 3.0 * exact.effects.std)
    assert np.all(exact.effects.std < 0.01), "nothing is late, and nothing lost"


def test_drag_that_comes_late_is_named_and_covered(pushed):
    """Drag that the tests show is not that of a steady speed."""
    shooting = copy(pushed.problem.shooting)
    shooting.segments = cut([log_of(Broken(memory=0.3, lag=0.6))], pushed.problem.segments.grid)
    problem = Problem(shooting, pushed.prior)
    found = estimate(problem)
    effects = found.effects
    assert 0.1 < effects.size[0] < 0.4 and effects.size[0] > 5.0 * effects.std[0]
    assert 0.1 < effects.size[1] < 0.4 and effects.size[1] > 5.0 * effects.std[1]
    assert np.all(np.abs(found.unknowns.theta) < 1.96 * np.sqrt(np.diag(found.covariance)))
    lines = " ".join(about_effects(pushed.parameters, found))
    assert "drag in translation that comes late" in lines and "of the quadratic drag" in lines


def test_an_effect_like_a_parameter_cannot_be_known(pushed):
    """With the very force of a parameter: the tests know nothing of it, and it moves that one alone."""
    problem, here, noise = pushed.problem, pushed.solution.unknowns, pushed.solution.noise
    k = pushed.parameters.names.index("quadratic_damping.surge")
    path = problem.shooting.trajectories(here.theta, here.nodes, problem.segments.arrays)
    u = np.asarray(path.nu)[..., 0]
    drag = float(np.asarray(pushed.parameters.model_at(here.theta)[0].quadratic_damping_ahead)[0, 0])
    loads = np.zeros((*u.shape, 6, EFFECTS))
    loads[..., 0, 0] = -drag * u * np.abs(u)
    arrow = problem.assembled(problem.blocks(here, noise), here, noise)
    _, covariance, shift = known_of(problem, here, noise, arrow, loads, np.ones(EFFECTS))
    std = np.sqrt(np.diag(covariance))
    # Beforehand it is 1; forces between grid points, as of an effect and of a parameter, differ by parts in a million.
    assert 0.3 < std[0] <= 1.0 and std[1:] == pytest.approx(1.0)
    assert shift[:, 0] == pytest.approx(-1.0 * (np.arange(3) == k), abs=0.15), "the prior holds it back a little"


def test_no_interval_is_wider_than_what_was_known_before(pushed):
    solution, prior = pushed.solution, np.diag(pushed.prior.covariance)
    bound = prior + (solution.unknowns.theta - pushed.prior.mean) ** 2
    assert np.all(np.diag(solution.covariance) <= 1.01 * bound)


def test_what_an_effect_adds_is_limited():
    effects = Effects(("drag",), ("1",), np.array([2.0]), np.array([[0.01]]), np.array([[1.0], [-0.1]]))
    square = 2.0**2 + 0.1**2
    found = effects.of_theta(np.ones(2), np.array([False, False]))
    np.testing.assert_allclose(np.diag(found), [1.0, 0.01 * square])
    np.testing.assert_allclose(found[0, 1], -0.1 * np.sqrt(square))
    none = Effects.none(2).of_theta(np.ones(2), np.array([True, False]))
    assert none.shape == (2, 2) and not none.any()


def test_what_is_off_by_most_of_itself_may_be_nearly_nothing():
    """Half of a value that is an effect's: the value is half as large, its logarithm lower by log 2, not by a half."""
    effects = Effects(("drag",), ("1",), np.array([1.0]), np.zeros((1, 1)), np.array([[-0.5], [-2.0], [-0.5]]))
    grown = np.sqrt(np.diag(effects.of_theta(np.full(3, 100.0), np.array([True, True, False]))))
    np.testing.assert_allclose(grown, [np.log(2.0), np.log(20.0), 0.5])


@pytest.mark.slow
def test_a_tether_at_the_stern_is_named_and_covered():
    """It ties surge, sway and yaw together, which no drag of the hull does."""
    drag = float(np.asarray(VEHICLE.model().quadratic_damping_ahead)[0, 0])
    free = [*FREE, *(f"{law}_damping.{axis}" for law in ("linear", "quadratic") for axis in ("sway", "yaw"))]
    found = identify(
        VEHICLE, [log_of(Broken(tether=0.1 * drag, stern=-0.5))], free=[*free, "quadratic_damping.sway_yaw"]
    )
    lines = " ".join(found.findings)
    assert (
        "the moment of a tether that is fixed half a hull's length astern" in lines
        and "of the hull's along surge" in lines
    )
    assert np.all(np.abs(found.solution.unknowns.theta) < 1.96 * np.sqrt(np.diag(found.solution.covariance)))


def test_starts_that_are_measured_go_without(pushed):
    measured = Problem(pushed.problem.shooting, pushed.prior, measured_starts=True)
    found = estimate(measured, max_steps=15)
    assert np.abs(found.unknowns.nodes.push).max() < 3e-3 * np.abs(pushed.solution.unknowns.nodes.push).max()


def test_derivatives_by_a_push_are_those_of_the_simulation(pushed):
    problem = pushed.problem
    theta, offsets, arrays = np.zeros(3), np.zeros(len(problem.groups)), problem.segments.arrays
    sigma = np.ones(len(problem.groups))
    found = np.asarray(problem.shooting.blocks(theta, offsets, problem.guess, sigma, arrays).defect_jacobian)

    def ends(axis, size):
        push = np.zeros((problem.segments.count, 6))
        push[0, axis] = size
        moved = problem.guess._replace(push=push)
        return np.asarray(problem.shooting.residuals(theta, offsets, moved, arrays)[1])[0]

    for axis in range(6):
        exact = (ends(axis, 1e-4) - ends(axis, -1e-4)) / 2e-4
        np.testing.assert_allclose(found[0, :, 12 + axis], exact, atol=2e-3 * np.abs(exact).max())
        assert exact[12 + axis] == pytest.approx(-np.exp(-1.0 / FADES), rel=1e-6)


def test_segments_are_a_second_unless_there_are_too_many_of_them_or_somebody_says():
    assert Options.read({}).grid(60.0).steps == Options.read({}).grid(600.0).steps == 50
    long = Options.read({}).grid(3600.0)
    assert 3600.0 / long.span == pytest.approx(MOST_SEGMENTS)
    odd = Options.read({}).grid(661.0)
    assert odd.steps == 60 and 661.0 / odd.span <= MOST_SEGMENTS, "661 s: 1.102 s is 1.2 s, not 55 or 56 steps"
    assert Options.read({"segment": 5.0}).grid(60.0).steps == 250


def test_divisions_by_motion_put_like_motion_together():
    rng = np.random.default_rng(0)
    nu, linked = rng.standard_normal((64, 6)), np.ones(64)
    linked[-1] = 0.0
    divisions = _by_motion(nu, linked)
    assert len(divisions) == 12 * len(MOTIONS)
    middle = np.concatenate([0.5 * (nu[:-1] + nu[1:]), nu[-1:]])
    for column, stretch in zip(np.concatenate([middle, np.abs(middle)], axis=1).T, divisions[:12], strict=True):
        assert np.bincount(stretch).tolist() == [16] * 4
        assert all(column[stretch == k].max() < column[stretch == k + 1].min() for k in range(3))
    assert _by_motion(nu[:15], linked[:15]) == []


def test_a_push_at_the_start_is_as_large_as_any_later(pushed):
    """Its process is stationary: what fades within a segment is what the disturbance of a segment makes up for."""
    problem, noise = pushed.problem, pushed.solution.noise
    width = problem.start_information(noise)[0, 12:] ** -0.5
    fading = np.exp(-problem.segments.grid.span / FADES)
    np.testing.assert_allclose(fading**2 * width**2 + noise.defect[12:] ** 2, width**2)
    assert np.all(problem.start_information(noise)[1:, 12:] == 0.0), "later ones follow from the one before"


def test_segments_that_outlast_a_push_are_a_finding():
    assert about_segments(1.0, True) == [] == about_segments(6.0, False)
    assert "segments last 6.0 s" in about_segments(6.0, True)[0]


@pytest.mark.parametrize(("length", "pulls"), [(None, True), (0.0, False), (10.0, True)])
def test_a_tether_that_is_stated_to_be_absent_has_no_effect(pushed, length, pulls):
    record = replace(log_of(Broken(), 10.0), tether_length=length)
    segments = cut([record], pushed.problem.segments.grid)
    problem = copy(pushed.problem)
    problem.segments = segments
    nu_r = np.ones((len(segments.arrays["tether"]), 3, 6))
    for load in _tether(problem, VEHICLE.model(), nu_r):
        assert np.any(load.at_grid) == pulls


def test_a_loss_seen_at_small_forces_is_larger_at_full_force():
    """A law that gives 0.4 of the loss where the tests are takes 2.5 times of it at full force; drag stays."""
    names = ("thrusters.surge.inflow_loss", "quadratic_damping.surge")
    parameters = SimpleNamespace(names=names, values=lambda theta: np.array([0.1, 100.0]))
    problem = SimpleNamespace(shooting=SimpleNamespace(parameters=parameters))
    found = _at_full_force(problem, np.zeros(2), np.array([0.06, 0.06]))
    np.testing.assert_allclose(found, [0.15, 0.06])
