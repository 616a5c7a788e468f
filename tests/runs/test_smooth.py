"""A finished run, smoothed: the filter over its log is the filter that flew, and the smoother knows better."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.frames import euler_from_quaternion
from rovtwin.core.log import Log
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.fly import fly
from rovtwin.runs.smooth import began, smooth_run
from rovtwin.scenario.files import load_scenario

pytestmark = pytest.mark.system

SETTLED = 20.0  # [s]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("smooth") / "run"
    changes = ["autopilot=model_based", "duration=70", "log.rate=50"]
    fly(load_scenario("lawnmower_waves", changes, seed=5), folder)
    return folder


@pytest.fixture(scope="module")
def smoothed(run):
    return smooth_run(run)


@pytest.mark.slow
def test_the_filter_over_the_log_is_the_one_that_flew(run, smoothed):
    flown = Log.read(run / "log.mcap")["autopilot/eta"].values
    n = min(len(flown), len(smoothed.track.t))
    np.testing.assert_allclose(smoothed.track.filtered[:n], flown[:n], atol=1e-6)


@pytest.mark.slow
def test_the_last_instant_is_the_filters(smoothed):
    np.testing.assert_allclose(smoothed.track.eta[-1], smoothed.track.filtered[-1], atol=1e-9)


def test_it_knows_better_and_says_how_well(run, smoothed):
    truth = Log.read(run / "log.mcap")["truth/eta"].values
    track, n = smoothed.track, min(len(truth), len(smoothed.track.t))
    inside = (track.t[:n] > SETTLED) & (track.t[:n] < track.t[-1] - SETTLED)
    rms = [np.sqrt(np.mean((eta[:n] - truth[:n])[inside, :2] ** 2)) for eta in (track.filtered, track.eta)]
    assert rms[1] < 0.8 * rms[0]  # one run; ten of them in the slow set
    z = (track.eta[:n] - truth[:n])[inside, :3] / track.std[:n][inside, :3]
    assert 0.1 < np.mean(z[:, :2] ** 2) < 4.0
    velocity = Log.read(run / "log.mcap")["truth/nu"].values[:n, :3]
    assert np.sqrt(np.mean((track.nu[:n, :3] - velocity)[inside] ** 2)) < 0.02


def test_the_command_writes_a_log_and_overwrites_nothing(run):
    data = CliRunner().invoke(app, ["smooth", str(run), "--json"])
    assert data.exit_code == 0 and '"smoothed_rms_m"' in data.output
    log = Log.read(run / "smoothed.mcap")
    assert {"smoothed/eta", "smoothed/nu", "smoothed/std", "smoothed/covariance"} <= set(log)
    keys = KeyFrames.load(run / "smoothed_keys.nc")
    assert keys.constants == ("attitude.heading",)
    variance = np.diag(keys.joint()[:-1, :-1]).reshape(-1, 6)
    at = np.searchsorted(log["smoothed/std"].t, keys.t - 1e-9)
    np.testing.assert_allclose(np.sqrt(variance), log["smoothed/std"].values[at, :6], rtol=1e-6)
    with pytest.raises(ConfigError, match="smoothed.mcap"):
        CliRunner().invoke(app, ["smooth", str(run)], catch_exceptions=False, standalone_mode=False)


def test_what_is_missing_is_named(run, tmp_path):
    (tmp_path / "log.mcap").write_bytes((run / "log.mcap").read_bytes())
    with pytest.raises(ConfigError, match="scenario.yaml"):
        smooth_run(tmp_path)
    (tmp_path / "scenario.yaml").write_text((run / "scenario.yaml").read_text())
    bare = Log.read(run / "log.mcap")
    kept = [name for name in bare if not name.startswith("sensor/")]
    (tmp_path / "log.mcap").unlink()
    Log.from_arrays(
        [bare.channels[name] for name in kept], {n: (bare[n].t, bare[n].values) for n in kept}, bare.metadata
    ).write(tmp_path / "log.mcap")
    with pytest.raises(LogError, match="sensor/position"):
        smooth_run(tmp_path)


def test_a_flight_over_a_link_began_where_the_filter_found_itself(run):
    """Not where the scenario starts: over a link the vehicle was somewhere else, and so sure of it was the filter."""
    flown, scenario = Log.read(run / "log.mcap"), load_scenario(run / "scenario.yaml")
    data = {name: (flown[name].t[:1], flown[name].values[:1].copy()) for name in ("autopilot/eta", "autopilot/std")}
    data["autopilot/eta"][1][:] = [7.0, -4.0, 2.0, 0.0, 0.0, 0.5]
    data["autopilot/std"][1][:, :2] = 0.3
    log = Log.from_arrays([flown.channels[name] for name in data], data, flown.metadata | {"live": "true"})
    start = began(log, scenario, vehicle_of(scenario).model())
    np.testing.assert_allclose(start.position, [7.0, -4.0, 2.0])
    np.testing.assert_allclose(euler_from_quaternion(start.attitude), [0.0, 0.0, 0.5], atol=1e-12)
    assert float(start.position_std) == pytest.approx(0.3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lawnmower_calm", "lawnmower_hard", "lawnmower_dropout"])
def test_over_whole_missions_the_error_is_two_thirds_of_the_filters_at_most(name, tmp_path):
    errors = []
    for seed in range(1, 6):
        fly(load_scenario(name, ["autopilot=model_based"], seed=seed), tmp_path / str(seed))
        errors.append(smooth_run(tmp_path / str(seed)).errors)
    rms = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    assert rms[1] < 0.65 * rms[0]


@pytest.mark.slow
def test_a_compass_that_is_off_is_in_the_covariance_and_is_found(tmp_path):
    """One degree put into the compass's readings of a flight with a Doppler log: the track turns against positions."""
    folder, off = tmp_path / "run", np.radians(1.0)
    fly(load_scenario("lawnmower_calm_dvl", ["autopilot=model_based"], seed=4), folder)
    log = Log.read(folder / "log.mcap")
    data = {name: (log[name].t, log[name].values.copy()) for name in log}
    data["sensor/attitude"][1][:, 2] += off
    (folder / "log.mcap").unlink()
    channels = [log.channels[name] for name in log]
    Log.from_arrays(channels, data, log.metadata).write(folder / "log.mcap")
    truth = log["truth/eta"]

    def nees(smoothed):
        track = smoothed.track
        at = np.clip(np.searchsorted(track.t, truth.t - 1e-9), 0, len(track.t) - 1)
        e, P = (track.eta[at] - truth.values)[:, :2], track.covariance[at][:, :2, :2]
        late = truth.t > SETTLED
        return np.mean(np.einsum("ni,nij,nj->n", e, np.linalg.inv(P), e)[late])

    trusting = smooth_run(folder, {"heading": 0.0, "dvl_yaw": 0.0, "dvl_scale": 0.0})
    doubting = smooth_run(folder)
    keys = doubting.track.keys
    assert nees(trusting) > 15.0 and nees(doubting) < 6.0
    assert abs(keys.constants_value[0] - off) < 3.0 * np.sqrt(keys.constants_covariance[0, 0])
    assert (keys.nonlinearity < 0.05).all()


def test_a_smoothing_that_made_nothing_better_is_named(smoothed):
    worse = replace(smoothed, errors=np.array([[0.02, 0.01], [0.022, 0.01]]))
    (remark,) = worse.remarks()
    assert "no better: 0.024 m rms, the filter 0.022 m" in remark
    assert not replace(smoothed, errors=np.array([[0.02, 0.01], [0.01, 0.01]])).remarks()
    assert not replace(smoothed, errors=None).remarks()
