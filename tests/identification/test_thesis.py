"""The thesis derived again: what must come out of its own tables, and what is said where it does not."""

import json
import sys

import numpy as np
import pytest

import rovtwin.cli
from rovtwin.identification.thesis import rederive
from rovtwin.identification.thesis.comparison import largest_gap
from rovtwin.identification.thesis.decay import as_printed as decay_as_printed
from rovtwin.identification.thesis.found import printed
from rovtwin.identification.thesis.free_running import as_printed, bent, rms, rounding, rows, towed
from rovtwin.identification.thesis.simulation import speeds
from rovtwin.vehicle.physics.dynamics import speed_of_drag


@pytest.fixture(scope="module")
def study():
    return rederive()


@pytest.mark.parametrize(
    ("name", "linear", "quadratic"),
    [("yaw", 0.177, 8.502), ("heave", 22.11, 1179), ("surge", 54.16, 23.15), ("sway", 49.82, 0.0)],
)
def test_damping_that_follows_from_the_tables(name, linear, quadratic):
    assert as_printed(name) == pytest.approx([linear, quadratic], rel=4e-4, abs=5e-4)


def test_what_rounding_allows():
    """The printed surge pair lies outside of what its table allows, the heave pair inside."""
    (low, high), pair = rounding("surge"), printed("free_running")["surge"]["published"]
    assert low[0] == pytest.approx(54.06, abs=0.03) and high[0] == pytest.approx(54.26, abs=0.03)
    assert not low[0] <= pair["linear"] <= high[0]
    (low, high), pair = rounding("heave"), printed("free_running")["heave"]["published"]
    assert (low <= [pair["linear"], pair["quadratic"]]).all() and (high >= [pair["linear"], pair["quadratic"]]).all()


def test_no_fit_through_the_origin_gives_the_printed_sway():
    _, force, speed = rows("sway")
    assert (
        printed("free_running")["sway"]["published"]["linear"] < (force / speed).min() == pytest.approx(45.66, abs=0.01)
    )


@pytest.mark.parametrize(("axis", "added", "damping"), [("roll", 2.146, 3.772), ("pitch", 0.541, 1.361)])
def test_decay_as_printed(axis, added, damping):
    assert decay_as_printed(axis) == pytest.approx((added, damping), abs=6e-4)


@pytest.mark.parametrize(("axis", "added", "damping"), [("roll", 44.7, 37.0), ("pitch", 12.53, 13.35)])
def test_decay_with_weight_in_newtons(axis, added, damping):
    assert decay_as_printed(axis, 9.81) == pytest.approx((added, damping), rel=2e-3)


@pytest.mark.system
def test_decay_corrected_is_what_the_library_vehicle_has(study):
    from rovtwin.vehicle import load_vehicle

    hydrodynamics = load_vehicle("double_blueye").file.hydrodynamics
    assert hydrodynamics is not None
    for place, axis in ((3, "roll"), (4, "pitch")):
        assert study.line("decay", f"{axis}, added inertia").corrected == pytest.approx(
            hydrodynamics.added_mass[place], abs=0.006
        )
        assert study.line("decay", f"{axis}, linear damping").corrected == pytest.approx(
            hydrodynamics.linear_damping[place], abs=0.006
        )
    library = study.line("free_running", "yaw, quadratic damping, library").corrected
    assert library == pytest.approx(hydrodynamics.quadratic_damping[5], abs=0.03)


def test_surge_meets_its_own_towing_once_the_thrust_curve_may_bend():
    command, _, speed = rows("surge")
    assert rms(20 * command - towed("surge", speed)) == pytest.approx(3.45, abs=0.005)
    assert rms(20 * command**1.75 - towed("surge", speed)) == pytest.approx(0.74, abs=0.005)
    assert rms(bent("surge").force(command) - towed("surge", speed)) < 0.8


def test_free_running_errs_by_more_than_the_thesis_says():
    gap, share, _ = largest_gap("surge")
    assert gap > 4.35 and share > 0.6
    v = np.array([0.15])
    assert 55.76 * v + 23.67 * v**2 - 6.48 * v - 158.86 * v**2 == pytest.approx(4.35, abs=0.01)


def test_table_4_2_is_not_table_3_7(study):
    names = {line.name for line in study.sections[4].lines if line.where == "table 4.2"}
    assert names == {
        "roll, linear damping, free running", "roll, quadratic damping, free running",
        "pitch, linear damping, free running", "yaw, linear damping, free running",
        "yaw, linear damping, empirical", "yaw, quadratic damping, free running",
    }  # fmt: skip


def test_the_simulation_did_not_run_the_stated_model(study):
    force, _, ground = speeds()
    steady = speed_of_drag(55.76, 23.67, force)
    assert steady == pytest.approx([0.0697, 0.1357, 0.1985, 0.2586, 0.3162], abs=1e-4)
    assert (1 - ground / steady).min() > 0.13
    assert study.line("simulation", "surge, linear damping, ground truth").derived == pytest.approx(63.8, abs=0.05)
    assert study.line("simulation", "surge, quadratic damping, ground truth").derived == pytest.approx(43.8, abs=0.05)
    assert study.line("simulation", "surge, linear damping, ArUco").derived == pytest.approx(65.28, abs=0.02)


def test_the_empirical_method_says_what_follows_and_what_does_not(study):
    lines = {line.name: line for line in study.sections[0].lines}
    assert (
        lines["sway, added mass"].derived == pytest.approx(13.31, abs=0.01)
        and "8.95" in lines["sway, added mass"].reason
    )
    assert lines["pitch, added mass"].derived == pytest.approx(0.658, abs=0.001) and lines["pitch, added mass"].reason
    assert (
        lines["heave, added mass"].derived == pytest.approx(28.64, abs=0.01) and not lines["heave, added mass"].reason
    )


def test_without_pymoo_all_but_the_search_is_derived(monkeypatch):
    from rovtwin.identification.thesis import simulation

    monkeypatch.setattr(simulation, "installed", lambda name: False)
    line = simulation.simulation_section().lines[-1]
    assert line.derived is None and "rovtwin[nsga]" in line.reason


def test_the_thrust_on_its_bound_is_reported(study):
    assert "on the bound" in study.line("added_mass", "heave, thrust of the search").reason


def test_every_difference_has_a_reason(study):
    for section in study.sections:
        for line in section.lines:
            both = line.published is not None and line.derived is not None
            apart = both and abs(line.derived - line.published) > 0.03 * abs(line.published)
            if apart or line.corrected is not None:
                assert line.reason, line.name


@pytest.mark.system
def test_the_command_prints_and_writes_a_report(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["rovtwin", "thesis", "--json", "-o", str(tmp_path / "again")])
    with pytest.raises(SystemExit) as stopped:
        rovtwin.cli.main()
    assert stopped.value.code in (0, None)
    data = json.loads(capsys.readouterr().out)
    assert [s["key"] for s in data["sections"]][0] == "empirical"
    page = (tmp_path / "again" / "report.html").read_text()
    assert "49.82" in page and "Figure" in page
    assert (tmp_path / "again" / "figures" / "comparison.png").stat().st_size > 20_000
