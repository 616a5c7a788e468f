"""The joint estimate: a known vehicle is found again, what cannot be known is named, the result flies."""

from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import pytest
from tests.identification.calibration import flown
from tests.identification.synthetic import record, steps_command

from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.identification.diagnostics.reliance import doubts_about
from rovtwin.identification.diagnostics.remarks import about_scale, about_solution
from rovtwin.identification.diagnostics.validation import predict
from rovtwin.identification.identify import default_free, identify
from rovtwin.identification.joint.estimate import _not_astray, estimate
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.joint.model.nodes import NODE
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.result.overlay import to_yaml
from rovtwin.identification.joint.result.payload import predicted_change
from rovtwin.identification.joint.result.scale import scale_response, with_scale
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.joint.solver.segments import cut
from rovtwin.identification.joint.uncertainty.agreement import parts, stretches, widened
from rovtwin.identification.result import Identification
from rovtwin.report.identification.repeatability import repeatability_table
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

pytestmark = pytest.mark.system

DURATION = 30.0
ADDED = {
    "name": "extra",
    "mass": 2.5,
    "shape": {"box": [0.2, 0.1, 0.1]},
    "pose": {"position": [0.1, 0.05, 0.1]},
}


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


@pytest.fixture(scope="module")
def truth(vehicle):
    """A vehicle drawn from the prior: theta, model, and a record of it.

    Without couplings of damping, which take half a minute more to compile: `test_calibration` has them.
    """
    everything = catalogue(vehicle)
    free = [n for n in default_free(everything, []) if not ("damping" in n and place_of(n))]
    parameters = choose(everything, free)
    L = np.linalg.cholesky(default_prior(parameters, vehicle).covariance)
    return *flown(parameters, L, steps_command(vehicle, 3, DURATION), 3, DURATION), free


@pytest.fixture(scope="module")
def found(vehicle, truth):
    """Identified from one record, without any anchor."""
    return identify(vehicle, [truth[2]], free=truth[3])


def test_it_settles_and_finds_the_noise(found):
    assert found.solution.converged
    declared = np.concatenate([found.problem.segments.sigma[name] for name in found.problem.segments.levers])
    np.testing.assert_allclose(found.solution.noise.sigma, declared, rtol=0.12)


def test_it_is_to_be_relied_on_unless_it_has_not_settled_or_misses_a_signal(found):
    assert found.doubts == []

    def doubts(solution):
        return doubts_about(solution, found.problem, found.residuals, [])

    assert "has not settled" in doubts(replace(found.solution, converged=False))[0]
    noise = found.solution.noise
    loud = replace(found.solution, noise=replace(noise, sigma=10.0 * np.asarray(noise.sigma)))
    assert not any("gyro" in doubt for doubt in doubts(loud)), "ten times nearly nothing is nothing missed"
    wrong = replace(found.solution, noise=replace(noise, sigma=1e5 * np.asarray(noise.sigma)))
    assert "gyro.r by more than 5 times the declared noise, and by more than 5 %" in doubts(wrong)[0]


def test_a_flight_that_ended_after_seconds_is_not_to_be_relied_on(found):
    """Three seconds of a planned test that was aborted settle well, on nothing."""
    segments = found.problem.segments
    short = SimpleNamespace(segments=replace(segments, records=(segments.records[0].cut(0.0, 3.2),)))
    (doubt,) = doubts_about(found.solution, short, found.residuals, [])
    assert "last 3.2 s in all, expected at least 10 s: if a flight ended early, see why" in doubt


def test_the_truth_lies_within_the_widths(found, truth):
    z = (found.theta - truth[0]) / found.std
    assert np.max(np.abs(z)) < 4.5
    assert np.sqrt(np.mean(z**2)) < 1.8


def test_motion_alone_does_not_tell_the_scale_of_forces(found, truth):
    """Thrust, masses, drag and restoring times a factor give the same motion: named, and wide."""
    assert found.blind and "the scale of all forces" in found.blind[0].text
    assert found.blind[0].information < 1e-3
    rows = [i for i, n in enumerate(found.parameters.names) if ".force_" in n]
    assert found.std[rows].min() > 0.05
    assert any("common scale" in finding for finding in found.findings)


def test_ratios_are_known_much_better_than_the_scale(found, truth):
    names = found.parameters.names
    i, j = names.index("quadratic_damping.surge"), names.index("thrusters.surge.force_ahead")
    a = np.zeros(len(names))
    a[i], a[j] = 1.0, -1.0
    std = float(np.sqrt(a @ found.covariance @ a))
    assert std < 0.02
    assert abs(a @ (found.theta - truth[0])) < 4 * std


def test_the_file_loads_and_is_the_estimate(found, tmp_path):
    path = tmp_path / "identified.yaml"
    path.write_text(to_yaml(found.file(), "rovtwin identify double_blueye log.mcap"))
    again = load_vehicle(path)
    for name in ("added_mass", "linear_damping_ahead", "quadratic_damping_astern", "center_of_buoyancy", "buoyancy"):
        np.testing.assert_allclose(
            np.asarray(getattr(again.model(), name)), np.asarray(getattr(found.model(), name)), rtol=1e-6, atol=1e-7
        )
    np.testing.assert_allclose(again.model().thrusters.exponent, found.model().thrusters.exponent, rtol=1e-6)
    same = identify(again, [], old=again, free=found.parameters.names)
    np.testing.assert_allclose(same.covariance, found.covariance, rtol=1e-5, atol=1e-10)


def test_what_was_saved_predicts_what_the_run_did(found, tmp_path):
    again = Identification.load(found.save(tmp_path / "identified.nc"))
    assert any(np.any(offset) for offset in again.offsets.values())
    for name in ("theta", "covariance"):
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
    np.testing.assert_array_equal(again.solution.unknowns.offsets, found.solution.unknowns.offsets)
    np.testing.assert_array_equal(again.residuals["gyro.p"].normalised, found.residuals["gyro.p"].normalised)
    (prediction,) = again.predict(found.problem.segments.records)
    for name, series in prediction.readings.items():
        for one, of_the_run in zip(series, found.fitted[0].readings[name], strict=True):
            np.testing.assert_array_equal(one, of_the_run)


def test_a_file_whose_parts_were_changed_is_refused(found):
    data = found.file()
    data["parts"][3]["mass"] = 9.0
    with pytest.raises(ConfigError, match=r"identified.made_with: found .*rovtwin identify NEW --prior"):
        vehicle_from_dict(data, "identified.yaml").model()


def test_a_new_part_gives_a_prediction_with_wider_intervals(found, vehicle):
    old = vehicle_from_dict(found.file(), "identified.yaml")
    data = vehicle.to_dict()
    data["parts"].append(ADDED)
    new = vehicle_from_dict(data, "with_extra.yaml")
    change = predicted_change(old, new)
    net = [float(m.buoyancy - m.weight) for m in (old.model(), change.model)]
    assert net[1] - net[0] == pytest.approx(9.81 * (1000 * 0.002 - 2.5))
    assert change.displaced == pytest.approx(9.81 * 2.0)
    result = identify(new, [], old=old, free=found.parameters.names)
    assert np.all(result.std >= found.std * 0.5)
    surge = result.parameters.names.index("added_mass.surge")
    kg = [found.values["added_mass.surge"] * found.std[surge], result.values["added_mass.surge"] * result.std[surge]]
    assert kg[1] > kg[0]
    assert result.model().weight == pytest.approx(old.model().weight + 2.5 * 9.81)
    assert result.values["added_mass.surge"] > found.values["added_mass.surge"]
    # A tenth of the part's own volume, though its weight nearly cancels its buoyancy.
    assert result.std[result.parameters.names.index("restoring.net_buoyancy")] > 0.19 * 9.81


def test_other_thrusters_are_no_change_ofparts(found):
    old = vehicle_from_dict(found.file(), "identified.yaml")
    with pytest.raises(IdentificationError, match="same vehicle with other parts"):
        identify(load_vehicle("bluerov2"), [], old=old)


def test_gradients_agree_with_differences(found):
    """Columns of the normal equations: the slope of the cost along a random direction, off the minimum."""
    problem, noise = found.problem, found.solution.noise
    direction = found.std * np.random.default_rng(0).standard_normal(len(found.theta))
    here = replace(found.solution.unknowns, theta=found.theta + 0.01 * direction)

    def cost(h):
        return problem.cost(replace(here, theta=here.theta + h * direction), noise)

    arrow = problem.assembled(problem.blocks(here, noise), here, noise)
    slope = -2.0 * arrow.b_corner[: len(direction)] @ direction
    h = 1e-4
    assert abs(slope) > 100.0
    assert slope == pytest.approx((cost(h) - cost(-h)) / (2 * h), rel=1e-3)


def test_derivatives_of_the_ends_of_segments(found):
    """Against differences of the integration; much closer along equal motion, or its scale would seem known."""
    problem, here = found.problem, found.solution.unknowns
    shooting, n = problem.shooting, len(found.theta)
    columns = problem.blocks(here, found.solution.noise).defect_jacobian[:, :, NODE : NODE + n]

    def by_differences(direction, h=1e-4):
        ends = [
            shooting.residuals(found.theta + x * direction, here.offsets, here.nodes, problem.segments.arrays)[1]
            for x in (h, -h)
        ]
        return np.asarray(ends[0] - ends[1]) / (2 * h)

    one_sd = found.std * np.random.default_rng(1).standard_normal(n)
    equal_motion = np.asarray(shooting.scale_tangent(found.theta))
    for direction, share in ((one_sd, 1e-3), (equal_motion, 1e-7)):
        terms = np.abs(columns) @ np.abs(direction)
        np.testing.assert_allclose(columns @ direction, by_differences(direction), atol=share * terms.max())


def test_a_node_goes_no_further_in_a_step_than_readings_can_be_wrong():
    small, wild = np.full(NODE, 0.01), np.full(NODE, 0.01)
    wild[6] = 2.0  # m/s
    np.testing.assert_allclose(_not_astray(np.stack([small, wild])), [small, 0.1 * wild])


@pytest.mark.slow
def test_records_predicted_side_by_side_are_those_predicted_alone(found):
    (record,) = found.problem.segments.records
    records = [record, record.cut(record.start, record.start + 7.3)]
    together = predict(found.parameters, found.theta, records)
    for record, prediction in zip(records, together, strict=True):
        (alone,) = predict(found.parameters, found.theta, [record])
        assert alone.excited == prediction.excited
        for name, (t, measured, predicted) in alone.readings.items():
            np.testing.assert_allclose(prediction.readings[name][0], t)
            np.testing.assert_allclose(prediction.readings[name][1], measured)
            np.testing.assert_allclose(prediction.readings[name][2], predicted, atol=1e-9)


def test_an_error_of_scale_moves_the_estimate_as_foretold(found):
    """All positions 0.5 % longer: what an estimate from them says otherwise is what the widened covariance knows of.

    As a whole: each parameter moves by a tenth of a width anyway, as steps end where little is gained.
    """
    problem, share = found.problem, 0.005
    (record,) = problem.segments.records
    unsure, shooting = copy(problem), copy(problem.shooting)
    unsure.segments = replace(problem.segments, records=(replace(record, scale_std=share),))
    response = scale_response(unsure, found.solution)
    place = record.signals["horizontal"]
    longer = record.signals | {"horizontal": replace(place, value=(1 + share) * place.value)}
    shooting.segments = cut([replace(record, signals=longer)], problem.segments.grid)
    moved = (estimate(Problem(shooting, problem.prior)).unknowns.theta - found.theta) / found.std
    foretold = response / found.std
    assert np.abs(foretold).max() > 0.2
    assert moved @ foretold / (foretold @ foretold) == pytest.approx(1.0, abs=0.15)
    assert np.corrcoef(moved, foretold)[0, 1] > 0.85
    wider = with_scale(found.solution, response)
    np.testing.assert_allclose(np.diag(wider.covariance), found.std**2 + response**2)
    assert not scale_response(problem, found.solution).any()


def test_what_rests_on_the_scale_is_reported(found):
    solution, response = found.solution, 0.1 * found.std
    records = [replace(r, scale_std=0.005) for r in found.problem.segments.records]
    assert about_scale(found.parameters, records, solution, response) == []
    response[0] = 3.0 * found.std[0]
    (text,) = about_scale(found.parameters, records, with_scale(solution, response), response)
    assert "known to 0.5 %" in text and found.parameters.names[0] in text and found.parameters.names[1] not in text


def test_records_of_another_vehicle_are_refused(vehicle, found):
    wrong = load_vehicle("bluerov2_heavy")
    with pytest.raises(IdentificationError, match="another number of thrusters"):
        identify(wrong, [found.problem.segments.records[0]])


def test_the_model_is_a_pytree_of_finite_numbers(found):
    for leaf in jax.tree.leaves(found.model()):
        assert not np.any(np.isnan(np.asarray(leaf, dtype=float)))


@pytest.fixture(scope="module")
def at_the_maximum(found):
    """Blocks and normal equations of everything, where the estimate ended before it went to the middle."""
    problem, noise = found.problem, found.solution.noise
    blocks = problem.blocks(found.solution.unknowns, noise)
    return problem, noise, blocks, problem.assembled(blocks, found.solution.unknowns, noise)


def test_stretches_add_up_to_what_the_readings_tell(at_the_maximum):
    problem, noise, blocks, arrow = at_the_maximum
    _, information = parts(blocks, noise, arrow)
    n, factored = len(problem.prior.mean), arrow.factor()
    own = np.zeros_like(factored.corner)  # of prior and offsets, and of starts, which belong to no stretch
    own[:n, :n] = problem.information
    own[n:, n:] = np.diag(problem.offset_information)
    follow = factored.follow()
    own += np.einsum("sdm,d,sdk->mk", follow[:1], problem.start_information(noise)[0], follow[:1])
    np.testing.assert_allclose(
        information.sum(axis=0) + own, factored.corner, atol=1e-7 * np.abs(factored.corner).max()
    )


def test_stretches_that_agree_widen_next_to_nothing(found):
    wider = found.solution.widening
    assert wider.min() >= 1.0
    assert np.mean(wider > 1.0) < 0.15, "a few of them by chance, and what goes with these"
    assert found.solution.stretches == 16


def test_a_thruster_that_gives_less_for_half_of_the_test_widens_its_interval(found, truth):
    """The model is broken on purpose: commands of the second half are a third larger than what was flown."""
    log = truth[2]
    late = log.t_command > 0.5 * DURATION
    wrong = replace(log, command=np.where(late[:, None], 1.3 * log.command, log.command))
    shooting = copy(found.problem.shooting)
    shooting.segments = cut([wrong], found.problem.segments.grid)
    solution = estimate(Problem(shooting, found.prior))
    assert np.median(solution.widening) > 2.0
    off = (solution.unknowns.theta - truth[0]) / np.sqrt(np.diag(solution.covariance))
    bare = off * solution.widening
    assert np.sqrt(np.mean(off**2)) < 0.5 * np.sqrt(np.mean(bare**2))
    assert np.mean(np.abs(off) < 1.96) > np.mean(np.abs(bare) < 1.96) + 0.2


def test_halves_of_a_log_differ_by_what_is_reported(found):
    """The model is exact: differences over their widths are 1 on average, and the table counts them."""
    halves = found.solution.halves
    assert found.solution.apart is None and halves.names == ("first half", "second half")
    before = np.sqrt(np.diag(found.prior.covariance))
    informed = np.any(halves.std < 0.9 * before, axis=0)
    assert 0.5 < np.sqrt(np.mean(halves.gaps()[0, 1, informed] ** 2)) < 1.5
    table = repeatability_table(found)
    assert table.head == ["Parameter", "Unit", "first half", "second half", "Largest difference"]
    assert f"of {informed.sum()} differences are below 2" in table.note
    assert "added_mass.surge" in [row[0] for row in table.rows]


def test_a_test_of_three_segments_is_not_divided(found):
    segments = cut([found.problem.segments.records[0].cut(0.0, 3.0)], found.problem.segments.grid)
    shooting = copy(found.problem.shooting)
    shooting.segments = segments
    short = Problem(shooting, found.prior)
    assert short.segments.count == 3 and stretches(short, short.guess) == []
    text = about_solution(
        found.parameters, found.prior, replace(found.solution, stretches=0), found.residuals, [], [], [], False
    )
    assert any("too short to be divided" in finding for finding in text)


@pytest.mark.slow
def test_what_a_log_says_by_itself_is_what_it_gives_alone(vehicle):
    """To first order, from one fit of both; the second was flown with a fifth more added mass in surge."""
    free = ["added_mass.surge", "added_mass.yaw", "quadratic_damping.surge", "quadratic_damping.yaw"]
    parameters = choose(catalogue(vehicle), free)
    heavier = parameters.model_at(parameters.thetas({"added_mass.surge": 1.2 * parameters.free[0].base}))[0]
    flights = [(vehicle.model(), 1), (heavier, 2)]
    logs = [replace(record(m, *steps_command(vehicle, k, 20.0), 20.0, seed=k), name=f"log_{k}") for m, k in flights]
    both = identify(vehicle, logs, free=free)
    assert both.solution is not None and both.solution.apart is not None
    apart = both.solution.apart
    for k, log in enumerate(logs):
        alone = identify(vehicle, [log], free=free)
        np.testing.assert_allclose(apart.theta[k, :2], alone.theta[:2], atol=0.02)
        np.testing.assert_allclose(apart.theta[k], alone.theta, atol=0.15)
        assert alone.solution is not None and alone.solution.apart is None
    assert apart.disagreeing()[0] == (0, 1)
    assert apart.difference_covariance is not None
    differences = np.diagonal(apart.difference_covariance, axis1=2, axis2=3)
    np.testing.assert_allclose(np.sqrt(differences[0, 1]), apart.difference_std[0, 1])
    assert both.verdicts[0] == "contradicted"
    assert any("logs disagree beyond their widths" in f and "added_mass.surge" in f for f in both.findings)
    same = [logs[0], replace(record(vehicle.model(), *steps_command(vehicle, 4, 20.0), 20.0, seed=4), name="log_4")]
    agreed = identify(vehicle, same, free=free)
    assert agreed.solution is not None and agreed.solution.apart is not None
    assert agreed.solution.apart.disagreeing() == {} and "contradicted" not in agreed.verdicts


def test_wider_intervals_know_nothing_better_than_before():
    """A common scale that is known to 2 %, ratios to 1e-4: what widths are multiplied by must not tell the scale."""
    rng = np.random.default_rng(0)
    scale = np.array([1.0, 1.0, 2.1, 2.6])
    covariance = 0.02**2 * np.outer(scale, scale) + 1e-8 * np.eye(4)
    wider = np.array([1.0, 1.3, 1.1, 1.5])
    grown = widened(covariance, wider)
    np.testing.assert_allclose(np.sqrt(np.diag(grown) / np.diag(covariance)), wider)
    for _ in range(20):
        x = rng.standard_normal(4)
        assert x @ np.linalg.solve(grown, x) <= x @ np.linalg.solve(covariance, x) * (1 + 1e-9)
    known = np.sqrt(1.0 / (scale @ np.linalg.solve(grown, scale)))
    assert known == pytest.approx(0.02, rel=1e-3)
    rotated = covariance * np.outer(wider, wider)  # scaling rows and columns makes it known to 0.03 %
    assert np.sqrt(1.0 / (scale @ np.linalg.solve(rotated, scale))) < 0.001
