import json
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from matplotlib.patches import Circle, Rectangle
from scipy.stats import chi2
from tests.report.synthetic import WAYPOINTS, synthetic

from rovtwin.core.log import Log
from rovtwin.report import figures
from rovtwin.report.flight import FaultSpan, Flight
from rovtwin.report.parts.style import _fault_labels, thin
from rovtwin.report.run.catalogue import CATALOGUE, left_out
from rovtwin.report.run.consistency import chi_square_range, consistency
from rovtwin.report.run.effort import _true_wrench
from rovtwin.report.run.motion import tracking
from rovtwin.report.series import beside, slow_mean, unwrapped

NAMES = [entry.name for entry in CATALOGUE]


@pytest.fixture(scope="module")
def log():
    return synthetic(dt=0.5)


@pytest.fixture(scope="module")
def coarse():
    return synthetic(dt=2.0)


@pytest.fixture(scope="module")
def drawn(log):
    return figures(log)


def without(log, *names, metadata=None):
    """The log without some channels (a name that ends in / stands for all below it)."""
    kept = {
        name: c
        for name, c in log.channels.items()
        if not any(name == n or (n.endswith("/") and name.startswith(n)) for n in names)
    }
    data = {name: (log[name].t, log[name].values) for name in kept}
    return Log.from_arrays(kept.values(), data, log.metadata if metadata is None else metadata)


def changed(log, change):
    """The log with every channel's values put through `change`."""
    data = {name: (log[name].t, change(np.array(log[name].values))) for name in log.channels}
    return Log.from_arrays(log.channels.values(), data, log.metadata)


def ylabels(figure):
    return [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()]


def test_all_figures_are_drawn(drawn):
    assert list(drawn) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_every_axis_has_a_unit(drawn, name):
    labels = [*ylabels(drawn[name]), *(a.get_xlabel() for a in drawn[name].axes if a.get_xlabel())]
    assert labels and all("[" in label and label.endswith("]") for label in labels)


def test_labels_of_the_degrees_of_freedom(drawn):
    assert set(ylabels(drawn["pose"])) == {
        "North [m]", "East [m]", "Depth [m]", "Roll [deg]", "Pitch [deg]", "Heading [deg]"
    }  # fmt: skip
    assert {"X [N]", "N [N m]"} <= {label.replace("$", "") for label in ylabels(drawn["forces"])}


def axes_of(figure, label):
    return next(axes for axes in figure.axes if axes.get_ylabel() == label)


def test_path_has_north_up_and_east_right_at_equal_scale(drawn, log):
    axes = axes_of(drawn["path"], "North [m]")
    assert axes.get_xlabel() == "East [m]" and axes.get_aspect() == 1.0
    (low_x, high_x), (low_y, high_y) = axes.get_xlim(), axes.get_ylim()
    assert low_x < high_x and low_y < high_y
    truth = log["truth/eta"]
    lines = [line for line in axes.lines if len(line.get_xdata()) > 100]
    assert any(np.allclose(line.get_xdata()[-1], truth["y"][-1], atol=0.2) for line in lines)
    centres = {tuple(np.round(p.center, 6)) for p in axes.patches if isinstance(p, Circle)}
    assert centres == {(y, x) for x, y, _ in WAYPOINTS}


def test_depth_axis_points_down(drawn):
    low, high = axes_of(drawn["pose"], "Depth [m]").get_ylim()
    assert low > high


def test_heading_is_drawn_without_jumps(drawn):
    # Set-points and truth cross 180 degrees in this mission.
    for line in axes_of(drawn["pose"], "Heading [deg]").lines:
        if len(line.get_ydata()) > 10:
            assert np.abs(np.diff(line.get_ydata())).max() < 60


def test_thruster_limits_are_drawn(drawn):
    axes = next(a for a in drawn["forces"].axes if a.get_title(loc="left") == "port surge")
    constant = {round(float(np.mean(line.get_ydata())), 6) for line in axes.lines if np.ptp(line.get_ydata()) == 0}
    assert constant == {-10.0, 10.0}


def test_errors_are_estimate_minus_truth(drawn, log):
    error = Flight(log).error
    assert error is not None
    k = 5
    expected = log["autopilot/eta"].values[:, k] - log["truth/eta"].values[:, k]
    expected = (expected + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(error[1][:, k], expected, atol=1e-9)
    line = max(axes_of(drawn["errors"], "Heading [deg]").lines, key=lambda one: len(one.get_ydata()))
    assert np.nanmax(np.abs(line.get_ydata())) == pytest.approx(np.degrees(np.abs(expected).max()))


def test_overconfidence_shows_in_nees():
    def mean(log):
        axes = consistency(Flight(log)).axes
        (title,) = (a.get_title(loc="right") for a in axes if a.get_title(loc="left") == "position (2 dof)")
        return float(title.split("mean ")[1].split(",")[0])

    honest, proud = mean(synthetic(dt=0.5)), mean(synthetic(dt=0.5, optimism=5.0))
    assert honest == pytest.approx(2, abs=0.8) and proud == pytest.approx(25 * honest, rel=0.02)


def test_chi_square_range_against_scipy_stats():
    low, high = chi_square_range(np.array([2, 12]))
    np.testing.assert_allclose(low, chi2.ppf(0.025, [2, 12]), rtol=1e-12)
    np.testing.assert_allclose(high, chi2.ppf(0.975, [2, 12]), rtol=1e-12)


def test_true_force_is_turned_into_the_world(log):
    t, wrench = _true_wrench(Flight(log))  # type: ignore[misc]
    k = len(t) // 2
    i = int(np.argmin(np.abs(log["truth/eta"].t - t[k])))
    psi, X, Y = log["truth/eta"]["psi"][i], *log["truth/external_wrench"].values[i, :2]
    # Roll and pitch are a few degrees at most.
    assert wrench[k, 0] == pytest.approx(np.cos(psi) * X - np.sin(psi) * Y, abs=0.1)
    assert wrench[k, 1] == pytest.approx(np.sin(psi) * X + np.cos(psi) * Y, abs=0.1)


def test_slow_mean_takes_a_wave_away_and_keeps_a_ramp():
    t = np.arange(0, 200, 0.1)
    slow = slow_mean(t, (0.01 * t + np.sin(2 * np.pi * t / 5))[:, None])[:, 0]
    middle = (t > 20) & (t < 180)
    np.testing.assert_allclose(slow[middle], 0.01 * t[middle], atol=0.02)


def test_a_run_that_only_keeps_station_shows_its_distance(coarse):
    values = np.array(coarse["score/cross_track"].values)
    values[:, 1] = 0
    data = {name: (coarse[name].t, coarse[name].values) for name in coarse.channels}
    data["score/cross_track"] = (coarse["score/cross_track"].t, values)
    figure = tracking(Flight(Log.from_arrays(coarse.channels.values(), data, coarse.metadata)))
    (line,) = (one for one in axes_of(figure, "Distance to way-point [m]").lines if len(one.get_ydata()) > 2)
    leg, eta = coarse["autopilot/leg"].values[-1], coarse["truth/eta"].values[-1]
    assert line.get_ydata()[-1] == pytest.approx(np.hypot(eta[0] - leg[3], eta[1] - leg[4]))


# Tethers, batteries, tank


def with_empty_port_battery(log):
    """The log with nothing left in battery port after half of the time."""
    data = {name: (log[name].t, np.array(log[name].values)) for name in log.channels}
    t, values = data["truth/battery"]
    values[t >= t[-1] / 2, 0] = 0.0
    table = {"batteries": [{"name": "port", "thrusters": ["port_surge"]}]}
    return Log.from_arrays(log.channels.values(), data, log.metadata | {"vehicle_table": json.dumps(table)})


def with_tank(log, north, east):
    return without(log, metadata=log.metadata | {"scenario": f"world:\n  tank: {{north: {north}, east: {east}}}\n"})


def test_tension_and_charge_are_drawn_as_logged(drawn, log):
    pull = log["truth/tether/port_tether"]["tension"]
    tensions, charges = (
        [np.asarray(line.get_ydata()) for line in axes_of(drawn[name], label).lines]
        for name, label in (("tethers", "Tension [N]"), ("batteries", "Charge [%]"))
    )
    assert len(tensions) == 2 and tensions[0].max() == pytest.approx(pull.max())
    assert [charge[-1] for charge in charges] == pytest.approx([60.0, 70.0])


def test_captions_say_the_largest_tension_and_what_is_left(log):
    text = {entry.name: entry.caption_of(Flight(log)) for entry in CATALOGUE}
    pull = max(log[f"truth/tether/{side}_tether"]["tension"].max() for side in ("port", "starboard"))
    assert f"Largest tether tension: {pull:.3g} N, " in text["tethers"]
    assert text["batteries"].endswith("Left at the end: port 60 %, starboard 70 %.")


def test_nobody_misses_tethers_that_a_run_did_not_have(log):
    assert left_out(without(log, "truth/tether/", "truth/tether_shape/", "truth/battery", "host/timing")) == []


def test_an_empty_battery_is_a_fault_of_its_thrusters(coarse):
    flight = Flight(with_empty_port_battery(coarse))
    (fault,) = flight.faults
    assert fault.what == "battery port empty" and fault.thrusters == ("port_surge",)
    assert fault.start == flight.emptied["port"] == pytest.approx(coarse.end / 2, abs=2.0)
    assert Flight(coarse).faults == []


def test_path_shows_the_tank_and_the_anchors(coarse):
    axes = axes_of(figures(with_tank(coarse, [-2.0, 9.0], [-3.0, 11.0]))["path"], "North [m]")
    (wall,) = (patch for patch in axes.patches if isinstance(patch, Rectangle))
    assert (wall.get_x(), wall.get_y(), wall.get_width(), wall.get_height()) == (-3.0, -2.0, 14.0, 11.0)
    assert axes.get_xlim()[0] < -3.0 and axes.get_ylim()[1] > 9.0
    points = {tuple(np.asarray(line.get_xydata())[0].tolist()) for line in axes.lines if line.get_marker() == "^"}
    assert points == {(-0.28, -1.0), (0.28, -1.0)}


def test_a_tank_much_larger_than_the_path_does_not_shrink_it(coarse):
    axes = axes_of(figures(with_tank(coarse, [-200.0, 900.0], [-300.0, 500.0]))["path"], "North [m]")
    assert axes.get_xlim()[0] > -10


def test_no_line_of_the_path_goes_on_after_its_end(coarse):
    data = {name: (coarse[name].t, coarse[name].values) for name in coarse.channels}
    eta = coarse["truth/eta"]
    half = len(eta) // 2
    data["truth/eta"] = (eta.t[:half], eta.values[:half])
    axes = axes_of(figures(Log.from_arrays(coarse.channels.values(), data, coarse.metadata))["path"], "North [m]")
    last = coarse["autopilot/eta"].values[half - 1, :2]
    drawn = [np.asarray(line.get_xydata()) for line in axes.lines]
    assert any(np.allclose(line[-1], last[::-1]) for line in drawn if len(line) > 20)


def test_fault_numbers_that_would_overlap_are_written_together():
    faults = [FaultSpan(k, "", start, 1500.0, ()) for k, start in enumerate((15, 60, 90, 120, 900, 930, 1400), start=1)]
    assert _fault_labels(faults, 1500.0) == [(120, "1–4"), (930, "5,6"), (1400, "7")]
    assert [label for _, label in _fault_labels(faults[:4], 200.0)] == ["1", "2", "3", "4"]


# Thinning and angles


def test_thin_keeps_peaks_and_is_short():
    t = np.arange(75_000) * 0.02
    y = np.sin(t)
    y[31_234] = 7.0
    a, b = thin(t, y, 1400)
    assert len(a) <= 1410 and (np.diff(a) > 0).all()
    assert b.max() == 7.0 and b.min() == pytest.approx(-1, abs=1e-4)


def test_thin_keeps_gaps():
    y = np.ones(10_000)
    y[4000:6000] = np.nan
    t, thinned = thin(np.arange(10_000.0), y, 500)
    assert np.isnan(thinned[(t > 4050) & (t < 5950)]).all() and (thinned[t < 3950] == 1).all()


def test_unwrapped_passes_over_nan():
    angle = np.linspace(0, 12, 200)
    wrapped = (angle + np.pi) % (2 * np.pi) - np.pi
    wrapped[50:53] = np.nan
    found = unwrapped(wrapped)
    good = np.isfinite(wrapped)
    np.testing.assert_allclose(found[good], angle[good], atol=1e-9)
    assert np.isnan(found[50:53]).all()


def test_beside_stays_within_half_a_turn():
    t = np.linspace(0, 10, 50)
    base = 4 * t
    np.testing.assert_allclose(beside((base + 0.3 + np.pi) % (2 * np.pi) - np.pi, t, base, t), base + 0.3)


# What is missing, broken or strange


@pytest.mark.parametrize("channel", sorted({name for entry in CATALOGUE for name in entry.wants}))
def test_a_missing_channel_is_named(log, channel):
    assert any(channel in line for line in left_out(without(log, channel)))


def test_nothing_is_named_when_all_is_there(log):
    assert left_out(log) == []


def test_real_vehicle_without_truth(log):
    real = without(log, "truth/", "score/")
    seven = {"path", "pose", "tracking", "velocity", "forces", "consistency", "disturbance"}
    assert set(figures(real)) == seven | {"timing"}
    assert any("Errors of the estimate" in line and "no truth/eta" in line for line in left_out(real))


def test_only_the_path_is_known(log):
    names = [name for name in log.channels if name != "truth/eta"]
    assert set(figures(without(log, *names, metadata={}))) == {"path", "pose"}


def test_empty_log():
    assert figures(Log.from_arrays([], {})) == {}


def test_channel_without_samples_counts_as_missing(log):
    data = {name: (log[name].t, log[name].values) for name in log.channels if name != "truth/eta"}
    hollow = Log.from_arrays(log.channels.values(), data, log.metadata)
    assert "errors" not in figures(hollow)


def paint(log):
    for figure in figures(log).values():
        figure.draw_without_rendering()


@pytest.mark.system
@pytest.mark.filterwarnings("error")
def test_nan_in_the_data(coarse):
    rng = np.random.default_rng(0)
    paint(changed(coarse, lambda values: np.where(rng.random(values.shape) < 0.3, np.nan, values)))


@pytest.mark.system
@pytest.mark.filterwarnings("error")
def test_run_that_diverged(coarse):
    def explode(values):
        values[len(values) // 2 :] = np.nan
        values[len(values) // 2 - 1] = 1e12
        return values

    paint(changed(coarse, explode))


@pytest.mark.system
@pytest.mark.filterwarnings("error")
def test_all_zero(coarse):
    paint(changed(coarse, lambda values: 0.0 * values))


@pytest.mark.system
@pytest.mark.filterwarnings("error")
def test_stopped_after_one_tick(log):
    data = {name: (log[name].t[:1], log[name].values[:1]) for name in log.channels}
    paint(Log.from_arrays(log.channels.values(), data, log.metadata))


@pytest.mark.parametrize(
    "text", ["", "not json", "[1, 2", "3", "null", "[[1]]", json.dumps([{"position": ["a", 1, 2]}])]
)
def test_metadata_that_cannot_be_read(log, text):
    keys = ("summary", "vehicle_table", "waves", "mission")
    flight = Flight(without(log, metadata={key: text for key in keys}))
    assert flight.summary == {} and flight.waypoints == [] and flight.wave_direction is None


@pytest.mark.system
def test_figures_in_threads(coarse):
    with ThreadPoolExecutor(2) as pool:
        for drawn in pool.map(figures, [coarse, coarse]):
            assert list(drawn) == NAMES
