"""The report of an identification: what it must say, for results that are made up and for one that is estimated."""

import html
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.vehicle.discrepancies import block, random_part

from rovtwin.cli.identification.identify import as_object
from rovtwin.identification.diagnostics.reliance import doubts_about
from rovtwin.identification.diagnostics.remarks import about_thrust
from rovtwin.identification.diagnostics.validation import Prediction, Score
from rovtwin.identification.diagnostics.verdict import Blind, verdicts
from rovtwin.identification.diagnostics.whiteness import Residuals, autocorrelation
from rovtwin.identification.discrepancy.acceptance import Acceptance
from rovtwin.identification.identify import Identification, identify
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.solver.problem import Noise
from rovtwin.identification.joint.solver.segments import Grid
from rovtwin.identification.joint.uncertainty.apart import Apart
from rovtwin.report.identification.html import curves_of, write_identification_report
from rovtwin.report.identification.tables import between, correlated_table, estimated, parameter_table, percent
from rovtwin.report.identification.words import assumptions, excitation, is_coupling, not_learnt, verdict
from rovtwin.report.parts.curves import Subject, curves, speed_grid
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.schema import LearnedDiscrepancy

FREE = ["added_mass.surge", "linear_damping.surge", "quadratic_damping.surge", "quadratic_damping.roll",
        "thrusters.surge.*"]  # fmt: skip
T = np.arange(0.0, 20.0, 0.1)


def residual_series(coloured=False, seed=0):
    z = np.random.default_rng(seed).standard_normal(len(T))
    z = np.convolve(z, np.ones(20), "same") if coloured else z
    record = np.zeros(len(T), int)
    return Residuals(T, record, z, 0.01, autocorrelation(z, record), 0.5 if coloured else 0.05, 15.0 if coloured else 1)


def prediction(name, window=None, fit=90.0, excited=True):
    read = np.stack([np.sin(T), 0.1 * np.cos(T), 0.0 * T], axis=1)
    scores = {f"gyro.{c}": Score(fit, 0.1, 0.7, 0.7) for c in "pqr"}
    return Prediction(name, window, {"gyro": (T, read, read + 0.05)}, scores, dict.fromkeys(scores, excited))


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


@pytest.fixture(scope="module")
def result(vehicle):
    """Surge is known, but linear and quadratic damping only as a sum; roll was never moved."""
    parameters = choose(catalogue(vehicle), FREE)
    n, names = len(parameters), parameters.names
    prior = Gaussian(np.zeros(n), 0.25 * np.eye(n))
    information = 1e4 * np.eye(n)
    expected = ("linear_damping.surge", "quadratic_damping.surge", "quadratic_damping.roll")
    i, j, roll = (names.index(name) for name in expected)
    information[i, i] = information[j, j] = 1e4
    information[i, j] = information[j, i] = 9.9999e3
    information[roll, roll] = 0.0
    covariance = np.linalg.inv(information + prior.information)
    noise = Noise(np.array([0.01] * 3), np.array([1e-4] * 6 + [1e-3] * 12))
    std = np.tile(0.1 * np.sqrt(np.diag(prior.covariance)), (2, 1))
    between = np.tile(np.sqrt(2.0) * std[0], (2, 2, 1))
    halves = Apart(("first half", "second half"), 0.1 + np.array([[0.7], [-0.7]]) * std, std, between)
    solution: Any = SimpleNamespace(
        converged=True, steps=9, noise=noise, information=information, covariance=covariance,
        unknowns=SimpleNamespace(offsets=np.zeros(3)), offset_std=np.full(3, 1e-3), apart=None, halves=halves,
    )  # fmt: skip
    segments: Any = SimpleNamespace(
        groups=[("gyro", k) for k in range(3)], sigma={"gyro": np.array([0.01, 0.01, np.nan])},
        grid=Grid(0.02, 250, 20.0), records=(),
    )  # fmt: skip
    problem: Any = SimpleNamespace(segments=segments)
    records = [
        {"name": name, "use": use, "duration": 20.0, "source": "log.mcap", "signals": {"gyro": 200},
         "water_density": 1025.0, "tether_length": None, "notes": ["0.4 s cut"]}
        for name, use in (("one", "fit"), ("two", "held out"))
    ]  # fmt: skip
    blind = [Blind((names[i], names[j]), (1.0, -0.9), 0.01, "surge: only their sum is known")]
    return Identification(
        vehicle, parameters, prior, np.full(n, 0.1), covariance, verdicts(prior, solution), blind, [],
        records, solution, [prediction("one")], [prediction("two"), prediction("two", 5.0)],
        {f"gyro.{c}": residual_series(seed=k) for k, c in enumerate("pqr")}, problem, 12.0,
        {"surge": (-0.2, 0.3), "thrusters.surge": (-0.5, 0.6)},
    )  # fmt: skip


@pytest.fixture(scope="module")
def page(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    path = write_identification_report(result, folder)
    return path, words_of(path)


def words_of(path):
    text = re.sub(r"data:image[^\"]*", "", path.read_text())
    text = re.sub(r"</t[dh]>", "|", text[text.index("<body>") :])
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", text)))


@pytest.mark.system
def test_the_page_has_all_its_parts_and_its_figures_lie_beside_it(page):
    path, text = page
    assert path.name == "report.html"
    for part in ("Do the tests repeat?", "are below 2 standard deviations, rms 0.99.", "What the 95 % intervals assume",
                 "Damping forces", "Not separable", "Held-out tests", "Offset found",
                 "Disturbance", "fingerprint of its parts", "0.4 s cut", "1025"):  # fmt: skip
        assert part in text, part
    pictures = {p.stem for p in (path.parent / "figures").glob("*.png")}
    assert pictures == {
        "damping", "thrust", "added_mass", "correlation", "fit_1", "held_out_1", "whiteness"
    }  # fmt: skip
    assert all((path.parent / "figures" / f"{name}.svg").exists() for name in pictures)


@pytest.mark.system
def test_the_verdict_comes_first_and_says_what_was_learnt_and_what_not(page, result):
    _, text = page
    learnt = result.verdicts.count("learnt")
    assert f"{learnt} of {len(result.verdicts)} parameters learnt from 20 seconds of 1 test" in text
    assert text.index("parameters learnt") < text.index("Damping forces")
    assert "Known from the prior only: quadratic damping (roll)" in text
    found_text = verdict(result, curves_of(result)[0])
    assert any(
        s.startswith("Damping force at the fastest speed tested") and "surge ±" in s for s in found_text.sentences
    )
    assert any("every one is better" in s for s in found_text.sentences)


@pytest.mark.system
def test_what_did_not_settle_or_was_not_held_out_is_bad_news(result):
    now = curves_of(result)[0]

    def judged(**changes: Any) -> Any:
        changed = replace(result, **changes)
        doubts = doubts_about(changed.solution, changed.problem, changed.residuals, changed.held_out)
        return replace(changed, doubts=doubts)

    unsettled: Any = SimpleNamespace(**vars(result.solution) | {"converged": False})
    bad = verdict(judged(solution=unsettled), now)
    assert bad.good is False and "has not settled" in bad.headline
    loud: Any = SimpleNamespace(**vars(result.solution) | {"noise": Noise(np.array([0.01, 0.06, 9.0]), np.ones(12))})
    assert "misses gyro.q by more than 5 times" in verdict(judged(solution=loud), now).headline
    astray = judged(held_out=[prediction("two", fit=-20.0)])
    assert "worse than their mean" in verdict(astray, now).headline
    assert any("No test was held out" in s for s in verdict(replace(result, held_out=[]), now).sentences)
    still = replace(result, held_out=[prediction("two", excited=False)])
    assert any("they validate nothing" in s for s in verdict(still, now).sentences)
    worse = replace(result, held_out=[replace(prediction("two"), scores={"gyro.p": Score(-9, 0.8, 0.7, 0.9)})])
    assert any("no better than holding the first reading" in s and "gyro.p of two" in s
               for s in verdict(worse, now).sentences)  # fmt: skip


def test_the_heading_tells_a_good_model_from_a_weak_one(result):
    """Both were headed "Not to be relied on", the one that predicts and the one that does not."""
    now = curves_of(result)[0]

    def headed(rms, doubts=("the model misses gyro.q by more than 5 times the declared noise",), verdicts=None):
        held = prediction("two")
        scores = {c: Score(60.0, rms, 0.7, 0.7) for c in held.scores}
        return verdict(
            replace(
                result,
                doubts=list(doubts),
                held_out=[replace(held, scores=scores)],
                verdicts=verdicts or result.verdicts,
            ),
            now,
        )

    good, weak = headed(0.14), headed(0.9)
    n = len(result.verdicts)
    assert good.headline.startswith("Predicts, but not to be relied on beyond that: ")
    assert f"{result.verdicts.count('learnt')} of {n} parameters learnt from 20 seconds of 1 test" in good.headline
    assert (
        "held-out error 0.2 times that of the better of 'held' and 'none' (median), smaller in 3 of 3" in good.headline
    )
    assert "misses gyro.q" in good.headline and good.good is None
    assert weak.headline.startswith("Not to be relied on: ") and weak.good is False
    assert "held-out error 1.3 times" in weak.headline and "smaller in 0 of 3 components" in weak.headline
    sound = headed(0.14, doubts=(), verdicts=["learnt"] * (n - 1) + ["contradicted"])
    assert (
        sound.headline.startswith(f"{n - 1} of {n} parameters learnt")
        and ", 1 contradicted; held-out" in sound.headline
    )
    unsettled: Any = SimpleNamespace(**vars(result.solution) | {"converged": False})
    lost = replace(result, solution=unsettled, doubts=["the estimate has not settled"])
    assert verdict(lost, now).headline.startswith("Not to be relied on: "), "however well it predicts"


def test_excitation_distinguishes_what_never_moved_from_what_cannot_be_separated(result):
    text = dict(zip(result.parameters.names, excitation(result), strict=True))
    assert text["added_mass.surge"] == "excited"
    assert text["quadratic_damping.roll"] == "not excited"
    flat = replace(result, blind=[], covariance=_widened(result))
    text = dict(zip(flat.parameters.names, excitation(flat), strict=True))
    assert text["linear_damping.surge"] == "excited, not separable from quadratic_damping.surge (-0.95)"


def test_many_parameters_that_are_not_learnt_are_one_line_few_have_one_each(result):
    """A prediction printed 33 lines and more that nobody read."""
    named = [name for name in result.parameters.names if not is_coupling(name)]
    few = replace(result, verdicts=["prior only" if name == named[0] else "learnt" for name in result.parameters.names])
    assert (
        not_learnt(few)[0].startswith(f"prior only: {named[0]}: excited; it takes doublets")
        and len(not_learnt(few)) == 1
    )
    (line,) = not_learnt(replace(result, verdicts=["prior only"] * len(result.verdicts), solution=None))
    assert line.startswith(f"prior only: {len(named)} of {len(named)} parameters: added mass (surge); linear damping (")
    assert "thrust exponent (surge)" in line and "no tests" in line and "--json" in line


def test_json_says_of_each_parameter_what_the_tests_did_for_it(result):
    rows = {row["name"]: row for row in as_object(replace(result, fitted=[], held_out=[]))["parameters"]}
    assert rows["quadratic_damping.roll"]["excitation"] == "not excited"
    assert rows["quadratic_damping.roll"]["taught_by"].startswith("fast steps") and len(rows) == len(result.verdicts)


def _widened(result):
    """The same, with the sum of surge's damping told and nothing else of it."""
    C, names = result.covariance.copy(), result.parameters.names
    i, j = names.index("linear_damping.surge"), names.index("quadratic_damping.surge")
    std = np.sqrt(np.diag(result.prior.covariance))
    C[i, i], C[j, j] = std[i] ** 2, std[j] ** 2
    C[i, j] = C[j, i] = -0.95 * std[i] * std[j]
    return C


def test_parameters_known_together_only_are_grouped(result):
    assert correlated_table(replace(result, covariance=np.diag(np.diag(result.covariance)))).rows == []
    (row,) = correlated_table(replace(result, covariance=_widened(result))).rows
    assert row == ["linear damping (surge) against quadratic damping (surge)", "make good for each other"]


def test_the_parameter_table_agrees_with_the_result(result):
    rows = {row[0]: row for row in parameter_table(result, False).rows}
    coupled = {row[0]: row for row in parameter_table(result, True).rows}
    assert sorted([*rows, *coupled]) == sorted(result.parameters.names)
    assert all(is_coupling(name) for name in coupled) and not any(is_coupling(name) for name in rows)
    row = rows["added_mass.surge"]
    assert float(row[1]) == pytest.approx(result.values["added_mass.surge"], rel=1e-3)
    low, high = (float(x) for x in row[2].split(" to "))
    assert (low, high) == pytest.approx(result.interval("added_mass.surge"), rel=0.02)


def test_report_and_estimate_mean_the_same_by_a_coupling():
    for name in catalogue(load_vehicle("double_blueye")).names:
        assert is_coupling(name) == (place_of(name) is not None), name


def test_coloured_residuals_widen_the_intervals(result):
    assert "every reading counts as one" in assumptions(result)[-1]
    coloured = replace(result, residuals={"gyro.p": residual_series(coloured=True)})
    assert "15 readings of gyro.p count as one" in assumptions(coloured)[-1]
    assert "3.9 times as wide" in assumptions(coloured)[-1]


@pytest.mark.system
def test_without_tests_it_says_so(result, tmp_path):
    empty = replace(
        result, solution=None, fitted=[], held_out=[], residuals={}, records=[], blind=[], tested={},
        theta=result.prior.mean, covariance=result.prior.covariance, problem=None,
        verdicts=["prior only"] * len(result.verdicts),
    )  # fmt: skip
    text = words_of(write_identification_report(empty, tmp_path))
    assert "No tests: " in text and "No test was held out" in text and "no tests" in text


def test_the_band_of_a_force_is_that_of_its_sum_not_of_its_terms(vehicle):
    """Coefficients of correlation -0.99: their sum is known far better than each."""
    parameters = choose(catalogue(vehicle), ["linear_damping.surge", "quadratic_damping.surge"])
    model = parameters.model
    v = 0.3
    terms = np.array([model.linear_damping_ahead[0, 0] * v, model.quadratic_damping_ahead[0, 0] * v**2])
    std = 0.2 * terms.sum() / terms / 2
    C = np.array([[1.0, -0.999], [-0.999, 1.0]]) * np.outer(std, std)
    speeds = {d: np.array([-v, 0.0, v]) for d in ("surge", "sway", "heave", "roll", "pitch", "yaw")}
    subject = Subject("x", lambda theta: parameters.model_at(theta)[0], np.zeros(2), 1e-4 * C, {"all": (0,)}, {})
    curve = curves(subject, speeds, np.linspace(-1, 1, 3)).damping["surge"]
    assert curve.y[2] == pytest.approx(terms.sum())
    exact = 1.96 * 1e-2 * np.sqrt((terms * std) @ [[1, -0.999], [-0.999, 1]] @ (terms * std)) / terms.sum()
    assert curve.half_width[2] == pytest.approx(exact, rel=0.15)
    assert curve.half_width[2] < 0.1 * 1.96e-2 * std[1] * terms[1] / terms.sum()
    assert curve.y[1] == 0.0


def test_what_is_not_known_with_a_width_has_no_band(vehicle):
    model = vehicle.model()
    speeds = {d: np.linspace(-0.1, 0.1, 3) for d in ("surge", "sway", "heave", "roll", "pitch", "yaw")}
    found = curves(Subject("x", lambda _: model, np.zeros(0), None, {"all": (0,)}, {}), speeds, np.array([-1.0, 1.0]))
    assert np.all(np.isnan(found.damping["yaw"].low)) and found.thrust["all"].y[1] > 0 > found.thrust["all"].y[0]
    assert found.added_mass["heave"].y[0] == pytest.approx(model.added_mass[2, 2])


def test_forces_are_shown_of_directions_that_were_estimated(vehicle):
    """All six where nothing was, as in a plain vehicle file."""
    parameters = choose(catalogue(vehicle), ["linear_damping.sway", "quadratic_damping.yaw"])
    speeds = {d: np.linspace(-0.1, 0.1, 3) for d in ("surge", "sway", "heave", "roll", "pitch", "yaw")}
    subject = Subject(
        "x", lambda theta: parameters.model_at(theta)[0], np.zeros(2), 1e-4 * np.eye(2), {"all": (0,)}, {}
    )
    assert curves(subject, speeds, np.array([-1.0, 1.0])).estimated == [1, 5]
    assert curves(replace(subject, covariance=None), speeds, np.array([-1.0, 1.0])).estimated == [0, 1, 2, 3, 4, 5]


def test_thrust_that_was_taken_as_exact_is_named(vehicle):
    every = catalogue(vehicle)
    (text,) = about_thrust(choose(every, ["added_mass.surge", "*_damping.surge"]))
    assert "taken as exact" in text and "anchors" in text
    assert about_thrust(choose(every, ["*.surge", "thrusters.*"])) == []
    assert about_thrust(choose(every, ["restoring.*"])) == []


@pytest.mark.parametrize("ranges", [[(-0.2, 0.3)], [(-0.1, 0.3), (-0.2, 0.1)], [(0.0, 0.3)], []])
def test_speeds_hold_zero_and_both_ends(ranges):
    v = speed_grid(ranges, (-0.5, 0.5), points=81)
    assert len(v) == 81 and 0.0 in v and np.all(np.diff(v) > 0)
    if ranges:
        assert v[0] == min(0.0, *(r[0] for r in ranges)) and v[-1] == 0.3


@pytest.mark.parametrize(
    ("ends", "shown"),
    [((28.93, 33.8), "28.9 to 33.8"), ((1.36, 31.2), "1.4 to 31"), ((1.32971, 1.33046), "1.32971 to 1.33046"),
     ((-8.4e-7, 3.3e-7), "-8.4e-07 to 3.3e-07"), ((4.9567e-4, 4.9569e-4), "0.00049567 to 0.00049569"),
     ((np.nan, 1.0), "-")],
)  # fmt: skip
def test_intervals_have_as_many_digits_as_they_need(ends, shown):
    assert between(*ends) == shown


@pytest.mark.parametrize(
    ("value", "ends", "shown"),
    [(31.2074, (28.93, 33.8), "31.21"), (1.330084, (1.32971, 1.33046), "1.33008"), (0.5, (0.5, 0.5), "0.5"),
     (4.9568e-4, (4.9567e-4, 4.9569e-4), "0.00049568")],
)  # fmt: skip
def test_an_estimate_differs_from_the_ends_of_its_interval(value, ends, shown):
    assert estimated(value, *ends) == shown


def test_large_shares_are_no_powers_of_ten():
    assert [percent(x) for x in (0.041, 1.1, np.nan)] == ["4.1 %", "110 %", "-"]


@pytest.mark.slow
def test_the_report_of_a_real_estimate(vehicle, tmp_path):
    from tests.identification.synthetic import record, steps_command

    tests = [record(vehicle.model(), *steps_command(vehicle, s, 30.0), 30.0, seed=s) for s in (1, 2)]
    found = identify(vehicle, tests[:1], validate=tests[1:], options={"window": 5.0})
    text = words_of(write_identification_report(found, tmp_path))
    assert "measured anew every 5 s" in text and "sha256" not in text
    assert set(found.tested) == {"surge", "sway", "heave", "roll", "pitch", "yaw"} | {
        f"thrusters.{g}" for g in ("surge", "sway", "heave")
    }


@pytest.mark.system
def test_a_learned_wrench_has_a_section_with_its_comparison(result, tmp_path):
    part = random_part(np.random.default_rng(0), "sway", "thrust")
    words = "learned wrench changes the error of predictions over 5 s by -37.6 % +- 6.9: taken"
    made = Acceptance(-0.47, 0.1, 8, {"velocity.v": (0.023, 0.0067)}, True, words)
    learned = LearnedDiscrepancy.model_validate(block([part]))
    page = write_identification_report(replace(result, acceptance=made, discrepancy=learned), tmp_path).read_text()
    assert "Learned beside the equations" in page and words[1:] in page
    assert "-71 %" in page and "velocity and thrust" in page and "8 blocks" in page
    without = write_identification_report(result, tmp_path / "without").read_text()
    assert "Learned beside the equations" not in without
