"""Smoother, fixes and track logs on projected corners."""

import functools
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.positioning.estimators.test_ekf import EYE, LAYOUT, cut, drive, frames_of, seen
from tests.positioning.tracks import Drive, camera, corners_seen, wall

from rovtwin.core.block import Start
from rovtwin.core.errors import LogError
from rovtwin.core.log import Channel, Log
from rovtwin.positioning.estimators.ekf import MarkerEkf
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.estimators.run import run_observer
from rovtwin.positioning.estimators.smoother import smooth
from rovtwin.positioning.images.camera_model import Eyes, see
from rovtwin.positioning.images.detection import Detections
from rovtwin.positioning.images.observations import Frames, sightings
from rovtwin.positioning.recording import Recording
from rovtwin.positioning.track import track
from rovtwin.positioning.track_log import track_log
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.physics.camera import Port

pytestmark = pytest.mark.system

N = 150
TUNING = SlamTuning.of(pixel=0.2, acceleration=0.07)


@functools.cache
def tracked(method):
    d = cut(drive(), N)
    recording = Recording(frames_of(d, seen()[:N]), seen()[:N], ())
    return track(recording, [EYE], method, tuning=TUNING, start=d.position[0]), d


def rms(a, b):
    return np.sqrt(((a - b) ** 2).sum(axis=1).mean())


@pytest.mark.slow
def test_smoothing_is_better_than_filtering():
    pytest.importorskip("gtsam")
    (online, d), (smoothed, _) = tracked("ekf"), tracked("smoother")
    assert rms(smoothed.position, d.position) < min(0.010, rms(online.position, d.position))
    assert rms(smoothed.velocity, d.velocity) < 0.008 < rms(online.velocity, d.velocity) < 0.020
    assert 0.15 < smoothed.pixel_rms < 0.22


@pytest.mark.slow
def test_the_smoother_knows_how_good_it_is():
    pytest.importorskip("gtsam")
    smoothed, d = tracked("smoother")
    e = np.concatenate([smoothed.position - d.position, smoothed.velocity - d.velocity], axis=1)
    assert 0.3 < np.mean((e[5:] / smoothed.std[5:]) ** 2) < 2.5
    assert (smoothed.std[N // 2, 3:] < tracked("ekf")[0].std[N // 2, 3:]).all()


def test_a_wrong_sighting_that_the_filter_took_is_left_out_by_the_smoother():
    pytest.importorskip("gtsam")
    d = cut(drive(), 60)
    found = list(seen()[:60])
    corners = found[30][0].corners.copy()
    corners[1] += 3.0
    found[30] = [Detections(found[30][0].ids, corners)]
    # The filter believes anything; the smoother, which shares its gate, is given the usual one.
    frames = frames_of(d, found)
    out = run_observer(MarkerEkf.of([EYE], SlamTuning.of(gate=1e9)), frames, Start.at(d.position[0]))
    smoothed = smooth(MarkerEkf.of([EYE], SlamTuning.of(pixel=0.2)), frames, out)
    assert (out.status[30] == 1).sum() == 3 and (smoothed.landmark[30] >= 0).sum() == 2
    assert rms(smoothed.position, d.position) < 0.01


@pytest.mark.parametrize("method", ["ekf", "smoother"])
def test_fixes_of_single_frames_have_independent_errors_of_the_size_they_say(method):
    if method == "smoother":
        pytest.importorskip("gtsam")
    result, d = tracked(method)
    e = result.fix - d.position
    e -= e.mean(axis=0)  # the map's own error is common to all
    assert 0.5 < np.mean((e / result.fix_std) ** 2) < 1.8
    together = (e[1:] * e[:-1]).mean(axis=0) / (e**2).mean(axis=0)
    assert np.abs(together).max() < 0.35
    assert np.abs(result.fix_std[:, 0]).max() < 0.02


def test_the_log_of_a_track_reads_as_that_of_a_vehicle_with_a_position_sensor(tmp_path):
    from rovtwin.identification.logs.readers.rovtwin_log import read_rovtwin
    from rovtwin.vehicle import load_vehicle

    result, d = tracked("ekf")
    vehicle = load_vehicle("blueye_pioneer")
    fields = tuple(vehicle.thruster_names)
    channels = [
        Channel("autopilot/command", fields, "1", ""),
        Channel("sensor/attitude", ("phi", "theta", "psi", "t_valid"), ("rad",) * 3 + ("s",), "n"),
        Channel("sensor/position", ("north", "east", "t_valid"), ("m", "m", "s"), "n"),
        Channel("truth/eta", ("x",), "m", "n"),
    ]
    data = {
        "autopilot/command": (d.t, np.zeros((N, len(fields)))),
        "sensor/attitude": (d.t, np.concatenate([np.zeros((N, 3)), d.t[:, None]], axis=1)),
        "sensor/position": (d.t, np.full((N, 3), 9.0)),
        "truth/eta": (d.t, np.zeros((N, 1))),
    }
    log = track_log(result, Log.from_arrays(channels, data, {"name": "x"}))
    assert "truth/eta" not in log
    raw = read_rovtwin(log.write(tmp_path / "track.mcap"), vehicle)
    values = raw.tables["sensor/position"].values
    assert rms(values, d.position[:, :2]) < 0.01
    assert np.allclose(raw.signals["horizontal"].sigma, np.median(result.fix_std[:, :2], axis=0))
    assert "attitude" in raw.signals


TURN = 0.05  # of the compass against the layout [rad]


@functools.cache
def tracked_with_offset(method):
    d = cut(drive(), N)
    c, s = np.cos(TURN), np.sin(TURN)
    off = Drive(d.t, d.position, d.velocity, d.R_nb, np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ d.R_meas)
    tuning = SlamTuning.of(pixel=0.2, acceleration=0.07, start_position=10.0, offset=[0.0, 0.0, 0.2])
    recording = Recording(frames_of(off, seen()[:N]), seen()[:N], ())
    return track(recording, [EYE], method, LAYOUT, tuning, start=d.position[0]), off


@pytest.mark.parametrize("method", ["ekf", "smoother"])
def test_the_attitude_in_the_log_has_the_north_of_the_positions(method):
    if method == "smoother":
        pytest.importorskip("gtsam")
    result, d = tracked_with_offset(method)
    assert result.offset[2] == pytest.approx(-TURN, abs=5e-3) and 0 < result.offset_std[2] < 5e-3
    angles = Rotation.from_matrix(d.R_meas).as_euler("ZYX")[:, ::-1]
    channel = Channel("sensor/attitude", ("phi", "theta", "psi", "t_valid"), ("rad",) * 3 + ("s",), "n")
    values = np.concatenate([angles, d.t[:, None]], axis=1)
    log = track_log(result, Log.from_arrays([channel], {channel.name: (d.t, values)}))
    e = log["sensor/attitude"].values[50:, :3] - log["track/eta"].values[50:, 3:]
    assert np.abs(e.mean(axis=0)).max() < 3e-3 and np.abs(e).max() < 8e-3
    assert np.array_equal(log["sensor/attitude"]["t_valid"], d.t)
    data = json.loads(log.metadata["track_attitude_offset"])
    assert data["rotation_vector_n"] == result.offset.tolist() and data["std"] == result.offset_std.tolist()


def test_the_sizes_that_the_poses_were_made_with_are_those_of_the_filter():
    """Markers twice as large as the thesis's, none at a known place."""
    big, d, rng = wall(size=0.3), cut(drive(), 20), np.random.default_rng(3)
    found = [[corners_seen(big, EYE, d.position[k], d.R_nb[k], rng)] for k in range(20)]
    sizes = np.full(1000, 0.3)
    rows = [sightings(one, [EYE], sizes, 8) for one in found]
    frames = Frames.of(d.t, frames_of(d, seen()[:20]).attitude, rows)
    result = track(Recording(frames, found, ()), [EYE], tuning=TUNING, sizes=sizes, start=d.position[0])
    assert (result.counts[:, 1] == 3).all() and (result.counts[:, 2] == 0).all()
    places = {m.id: m.position for m in result.markers}
    assert all(np.linalg.norm(places[m.id] - m.position) < 0.03 for m in big.markers)


def test_luenberger_holds_all_markers_and_says_what_it_does_not_do():
    d = cut(drive(), 3)
    corners = seen()[0][0].corners[0]
    many = [[Detections(np.arange(40), np.stack([corners + k for k in range(40)]))]] * 3
    recording = Recording(frames_of(d, many, slots=40), many, ("from the video",))
    result = track(recording, [EYE], "luenberger", LAYOUT, start=d.position[0])
    assert sorted(m.id for m in result.markers) == list(range(40))
    assert result.notes[0] == "from the video"
    assert any(note.startswith("luenberger does not use the layout") for note in result.notes)
    assert any("no sensor/position" in note for note in result.notes)
    assert "sensor/position" not in track_log(result)
    assert not any("layout" in note for note in track(recording, [EYE], "luenberger").notes)


@pytest.mark.slow
def test_a_camera_behind_a_port_beside_one_without():
    dry = camera(y=0.29)
    wet = Camera("wet", replace(dry.lens, port=Port.of(0.03, 0.005)), dry.position, dry.R_bc)
    both, alone = Eyes.of([wet, dry]), Eyes.of([dry])
    marker = LAYOUT.markers[0]
    where = np.array([0.8, -0.5, 0.75]), np.eye(3), np.array(marker.position), marker.R_nm, np.array(0.15)
    for field in ("pixels", "by_position", "by_offset", "by_noise", "by_marker"):
        mixed, own = (np.asarray(getattr(see(eye, *where), field)) for eye in (both[1], alone[0]))
        assert np.allclose(mixed, own, rtol=1e-6, atol=1e-3)
    assert np.abs(see(both[0], *where).pixels - see(both[1], *where).pixels).max() > 20


def test_without_any_marker_the_track_says_what_to_look_at():
    d = cut(drive(), 5)
    empty = Recording(frames_of(d, [[Detections.none()]] * 5), [], ())
    with pytest.raises(LogError, match="found no marker in any of 5 frames, expected some of DICT_4X4_50"):
        track(empty, [EYE])


def test_what_happened_on_the_way_is_reported():
    found = list(seen()[:N])
    found[40:80] = [[Detections.none()]] * 40
    (f,) = found[100]
    found[100] = [Detections(np.r_[f.ids, f.ids[0]], np.concatenate([f.corners, f.corners[:1] + 200.0]))]
    d = cut(drive(), N)
    notes = track(
        Recording(frames_of(d, found), found, ("from the video",)), [EYE], tuning=TUNING, start=d.position[0]
    ).notes
    assert "from the video" in notes
    assert any(note.startswith("no marker from 3.9 to 8 s") for note in notes)
    assert any("1 frames show an id twice" in note for note in notes)
    assert any("1 sightings that do not fit left out" in note for note in notes)
