"""The model-based autopilot in closed loop, scored as docs/scenarios.md says; ten seeds of everything are slow."""

import functools

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.runs.batch import mean_over, score_batch, score_seeds
from rovtwin.scenario.files import load_scenario

LIMITS = {  # duration [s], error over bound, control's share of the cross-track error [m]
    "lawnmower_calm": (250, 1.15, 0.05),
    "lawnmower_waves": (250, 1.15, 0.05),
    "lawnmower_sea": (250, 1.15, 0.05),
    "lawnmower_dropout": (250, 2.0, None),
    "lawnmower_mismatch": (300, 1.5, 0.12),
    "lawnmower_hard": (300, 1.5, 0.12),
}
# The bound knows the drag and that there is no current; the filter allows for both. Ten seeds: 1.14, 1.19, 1.14 bounds.
MISSED = {"lawnmower_waves": pytest.mark.xfail(reason="wanted, not reached")}


def scenario(name, *changes):
    return load_scenario(name, ["autopilot=model_based", *changes])


# In the quick set are 70 s of a flight in waves (test_smoothing.py) and whole missions in calm water, over links.
@pytest.fixture(scope="module")
def in_waves():
    return score_seeds(scenario("lawnmower_waves"), (1, 2, 3))


@pytest.mark.slow
def test_the_mission_is_completed_in_time_and_depth_is_kept(in_waves):
    assert all(run["completed"] and run["duration_s"] < 200 for run in in_waves)
    assert mean_over(in_waves, "depth_rms_m") < 5e-3


@pytest.mark.slow
def test_the_path_is_kept_as_well_as_it_is_known(in_waves):
    """Three seeds: the error of a mean over three is a quarter of it."""
    bound = mean_over(in_waves, "bound_position_m")
    assert mean_over(in_waves, "position_error_rms_m") < 1.4 * bound
    assert mean_over(in_waves, "cross_track_rms_m") < 1.4 * np.hypot(bound, 0.05)


@pytest.mark.slow
def test_the_filter_is_about_as_wrong_as_it_says(in_waves):
    assert 0.8 < mean_over(in_waves, "nees_position_mean") < 3.5


@pytest.mark.slow
def test_with_good_positions_the_path_is_kept_to_a_centimetre():
    changes = ("sensors.position.noise=0.002", "sensors.position.rate_hz=20", "duration=80")
    run = score_seeds(scenario("lawnmower_calm", *changes), (1,))[0]
    assert run["cross_track_rms_m"] < 0.01 and run["cross_track_max_m"] < 0.03


@pytest.mark.slow
def test_a_batch_is_the_same_as_one_after_the_other():
    short = scenario("lawnmower_calm", "duration=40")
    for one, other in zip(score_seeds(short, (1, 2)), score_batch(short, (1, 2)), strict=True):
        assert one["position_error_rms_m"] == pytest.approx(other["position_error_rms_m"], rel=1e-6)


@pytest.fixture(scope="module")
def ten_seeds():
    return functools.cache(lambda name: score_seeds(scenario(name), range(1, 11)))


@pytest.mark.slow
@pytest.mark.parametrize("name", LIMITS)
def test_ten_seeds(name, ten_seeds):
    duration, _, control = LIMITS[name]
    runs = ten_seeds(name)
    assert all(run["completed"] and run["duration_s"] <= duration for run in runs)
    if control is not None:
        # Legs are followed ahead: off them is sway, whose bound it is. 2 % for ten seeds.
        sideways = np.mean([run["bound_position_m"][1] for run in runs])
        assert mean_over(runs, "cross_track_rms_m") <= 1.02 * np.hypot(sideways, control)


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=MISSED.get(name, ())) for name in LIMITS])
def test_the_error_is_near_its_bound(name, ten_seeds):
    runs = ten_seeds(name)
    assert mean_over(runs, "position_error_rms_m") <= LIMITS[name][1] * mean_over(runs, "bound_position_m")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=pytest.mark.xfail(reason="1.3: no disturbance came")) if "dropout" in n else n
        for n in LIMITS
    ],
)
def test_the_filter_is_consistent(name, ten_seeds):
    assert 1.5 <= mean_over(ten_seeds(name), "nees_position_mean") <= 2.6


@pytest.mark.slow
def test_without_positions_in_disturbed_water_the_filter_is_consistent():
    """In calm water it believes in more than comes (NEES 1.3); where it comes, it is right."""
    gone = "sensors.position={blackouts: [[80, 140]], outlier: 0.05, outlier_size: 5}"
    runs = score_seeds(scenario("lawnmower_hard", gone), range(1, 11))
    assert 1.5 <= mean_over(runs, "nees_position_mean") <= 2.6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lawnmower_calm_dvl", "lawnmower_hard_dvl", "lawnmower_sea_dvl"])
def test_with_a_doppler_log(name):
    runs = score_seeds(scenario(name), (1, 2, 3, 4))
    assert all(run["completed"] for run in runs) and mean_over(runs, "cross_track_rms_m") <= 0.05
    # From a start that is known: the bound is where the error goes to in five minutes.
    assert mean_over(runs, "position_error_rms_m") <= mean_over(runs, "bound_position_m")


def test_what_cannot_be_is_reported_where_it_stands():
    with pytest.raises(ConfigError, match=r"autopilot.model_based.navigation.drag_std|autopilot.navigation.drag_std"):
        scenario("lawnmower_calm", "autopilot.navigation.drag_std=-1")
    with pytest.raises(ConfigError, match="bandwidth"):
        scenario("lawnmower_calm", "autopilot.control.bandwidth=[1,2]")
