"""Lines of a scene: where rays end, how much light comes back, what the detector makes of it."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from tests.imaging.helper import DOWN, data, imager
from tests.simulation.imager.helper import LAMP, flat, path, scan

from rovtwin.core.errors import ConfigError, LogError
from rovtwin.imaging.path import PosePath
from rovtwin.imaging.schema import Clock
from rovtwin.imaging.spectra.light import lamp_exponent
from rovtwin.simulation.imager.detector import DetectorModel
from rovtwin.simulation.imager.ground import Ground
from rovtwin.simulation.imager.hits import Hits
from rovtwin.simulation.imager.radiance import radiometry_of
from rovtwin.simulation.imager.scan import BLOCK
from rovtwin.simulation.scene import load_scene, scene_from_dict

HILLS = {"height": 0.4, "length": 3.0, "seed": 2, "size": 20.0}


# Geometry


@pytest.mark.parametrize("euler", [(0.0, 0.0, 0.0), (0.1, -0.15, 0.7), (-0.2, 0.1, -2.5)])
def test_ground_points_of_a_level_floor_are_those_of_the_closed_form_to_a_nanometre(euler):
    found = scan(euler=euler)
    floor, hits, position, R_ns = found.middles(found.t)
    point, direction = found.imager.rays()
    R = Rotation.from_euler("ZYX", euler[::-1]).as_matrix()
    for k in (0, 17, 39):
        place = np.array([0.2 * found.t[k], 0.3, 3.4])
        origin = place + (R @ found.mount.position) + point @ (R @ DOWN).T
        along = direction @ (R @ DOWN).T
        expected = origin + ((5.0 - origin[:, 2]) / along[:, 2])[:, None] * along
        assert np.abs(hits.point[k] - expected).max() < 1e-9
        assert np.allclose(position[k], place + R @ found.mount.position, atol=1e-12)
        assert np.allclose(R_ns[k], R @ DOWN, atol=1e-12)
    assert np.allclose(hits.normal, [0.0, 0.0, -1.0]) and (hits.standing == -1).all()
    assert np.abs(found.floor_below() - 5.0).max() < 1e-9


def test_rays_end_on_the_hills_that_the_world_has():
    found = scan(flat(relief=HILLS), euler=(0.1, 0.1, 0.4))
    _, hits, _, _ = found.middles(found.t)
    depth = found.scene.floor.depth_and_slope(hits.point[..., :2])[0]
    assert np.abs(depth - hits.point[..., 2]).max() < 1e-9 and np.ptp(depth) > 0.02


def test_what_is_seen_beside_the_slits_middle_is_within_some_micrometres():
    from rovtwin.imaging.floor import floor_hits
    from rovtwin.simulation.imager.hits import beside

    found = scan(flat(relief=HILLS))
    middle = found.middles(found.t)[0]
    origin, direction, _, _ = found._rays(found.t + 0.015, 0.375)
    near, true = beside(middle, origin, direction), floor_hits(found.scene.floor, origin, direction, 9.0)
    away = np.linalg.norm(true.point - middle.point, axis=-1)
    assert 0.001 < away.min() and np.abs(near.point - true.point).max() < 0.02 * away.max()


def test_a_plate_is_seen_where_it_stands():
    plate = {
        "name": "p",
        "plane": [0.2, 0.3],
        "pose": {"position": [0.3, 0.4, 4.9]},
        "surface": {"material": "black_3"},
    }
    found = scan(flat(objects=[plate]))
    _, hits, _, _ = found.middles(found.t)
    on = (np.abs(hits.point[..., 0] - 0.3) <= 0.1) & (np.abs(hits.point[..., 1] - 0.4) <= 0.15)
    assert on.sum() > 20 and (hits.standing[on & (hits.standing == 0)] == 0).any()
    assert np.allclose(hits.point[hits.standing == 0][:, 2], 4.9) and on[hits.standing == 0].all()
    bright = np.concatenate([block.counts for block in found.blocks()])[..., 2].astype(float)
    inside = hits.standing == 0
    no_floor = scan(flat(depth=40.0)).block(0).counts[..., 2].mean()  # the dark, and what the water scatters back
    assert bright[inside].mean() - no_floor < 0.3 * (bright[~inside].mean() - no_floor)


def test_nothing_is_seen_of_a_floor_that_is_too_deep():
    found = scan(flat(depth=40.0))
    assert np.isnan(found.floor_below()).all()
    counts = found.block(0).counts
    assert counts.max() < 110  # the veil, and the dark
    with pytest.raises(ConfigError, match="neither bottom nor tank"):
        scan(scene_from_dict({"name": "open"}))


# Light


def lit(scene, albedo: float, height: float = 1.5, **given):
    """Radiance of a line over a level floor, and its hits; the imager at the origin, looking down."""
    small = imager(**given)
    model = radiometry_of(small, scene.file, 12.0)
    point, direction = (x @ DOWN.T for x in small.rays())
    way = (height - point[:, 2]) / direction[:, 2]
    at = point + way[:, None] * direction
    hits = Hits(way, at, np.tile([0.0, 0.0, -1.0], (12, 1)), np.full(12, -1), np.zeros(12))
    white = np.full((12, len(small.wavelengths)), albedo, np.float32)
    return model, hits, model.radiance(white, hits, np.zeros(3), DOWN)


def test_light_of_a_lamp_falls_off_with_both_ways_as_beer_and_lambert_have_it():
    model, hits, bright = lit(flat(), 0.5, lamps=[LAMP])
    dark = lit(flat(), 0.0, lamps=[LAMP])[2]
    lamp = np.array([0.0, 0.3, 0.0])
    far = np.linalg.norm(hits.point - lamp, axis=1)
    cosine = (hits.point[:, 2] - lamp[2]) / far
    share = cosine ** (1.0 + lamp_exponent(model.imager.file.lamps[0])) / far**2
    expected = 0.5 / np.pi * share[:, None] * model.intensities[0]
    expected = expected * np.exp(-np.multiply.outer(far + hits.way, model.water.beam))
    assert np.allclose(bright - dark, expected, rtol=2e-4)


def test_radiance_is_linear_in_reflectance_and_lamps_add():
    both = [LAMP, LAMP | {"name": "two", "position": [0.0, -0.3, 0.0]}]
    sums = [lit(flat(), 0.4, lamps=[lamp])[2] for lamp in both]
    assert np.allclose(lit(flat(), 0.4, lamps=both)[2], sums[0] + sums[1], rtol=1e-5)
    levels = [lit(flat(0.5), rho, lamps=[LAMP])[2] for rho in (0.0, 0.3, 0.6)]
    assert np.allclose(levels[2] - levels[0], 2.0 * (levels[1] - levels[0]), rtol=1e-4)


def test_the_veil_of_a_lamp_is_the_integral_along_the_ray():
    model, hits, veil = lit(flat(), 0.0, lamps=[LAMP])
    c, back = float(model.water.beam[2]), float(model.water.backscattering[2]) / (2 * np.pi)
    point, direction = model.imager.rays()
    exponent = lamp_exponent(model.imager.file.lamps[0])

    def integrand(s: float) -> float:
        to = point[4] + s * direction[4] - [0.0, 0.3, 0.0]
        far = np.linalg.norm(to)
        return back * max(to[0] / far, 0.0) ** exponent / far**2 * np.exp(-c * (far + s))

    expected = quad(integrand, 0.0, hits.way[4])[0] * model.intensities[0, 2]
    assert veil[4, 2] == pytest.approx(expected, rel=0.02)


def test_daylight_falls_off_with_depth_and_no_light_gives_none():
    near, far = (lit(flat(1.0), 0.5, height=h, lamps=[])[2] for h in (1.0, 2.0))
    model, hits, _ = lit(flat(1.0), 0.5, lamps=[])
    assert (far < near).all() and (lit(flat(), 0.5, lamps=[])[2] == 0.0).all()
    white = lit(flat(1.0), 0.5, height=1e-3 + 0.025, lamps=[])[2][5]
    day = model.day * (0.35 + 0.65 * 0.5 * 1.925)
    assert np.allclose(white, 0.5 / np.pi * day * np.exp(-0.026 * model.water.diffuse), rtol=3e-3)


# Counts


def test_noise_is_that_of_shot_dark_current_read_out_and_rounding():
    model = DetectorModel(imager(detector=data()["detector"] | {"uniformity": 0.0}), 5)
    given, lines = model.imager.file, 3000
    for electrons in (0.0, 300.0, 9000.0):
        radiance = (electrons / given.exposure / model.response).astype(np.float32)
        counts = np.array([model.counts(radiance.copy(), k) for k in range(lines)], float)
        dark = given.detector.dark_current * given.exposure
        mean = given.detector.offset + (electrons + dark) / model.gain
        variance = (electrons + dark + given.detector.read_noise**2) / model.gain**2 + 1.0 / 12.0
        n = counts.size
        assert counts.mean() == pytest.approx(mean, abs=5.0 * np.sqrt(variance / n))
        assert counts.var(axis=0).mean() == pytest.approx(variance, rel=5.0 * np.sqrt(2.0 / n))
        pixels = counts.reshape(lines, -1)
        assert abs(np.corrcoef(pixels[:-1, 7], pixels[1:, 7])[0, 1]) < 5.0 / np.sqrt(lines)


def test_radiances_come_back_from_counts_by_the_frames():
    model = DetectorModel(imager(), 5)
    exposure = model.imager.file.exposure
    radiance = np.linspace(0.2, 0.8, 60, dtype=np.float32).reshape(12, 5) * 20000 / exposure / model.response
    counts = np.mean([model.counts(radiance.copy(), k).astype(float) for k in range(400)], axis=0)
    back = (counts - model.dark_frame) / (model.response_frame * exposure)
    assert np.allclose(back, radiance, rtol=5e-3)
    dark = np.mean([model.counts(np.zeros((12, 5), np.float32), k).astype(float) for k in range(400)], axis=0)
    assert np.abs(dark - model.dark_frame).max() < 5.0 * 1.7 * np.sqrt(1 / 200 + 1 / 400)


def test_what_is_too_bright_is_full():
    model = DetectorModel(imager(), 5)
    assert (model.counts(np.full((12, 5), 10.0, np.float32), 0) == model.full).all() and model.full == 4095.0


def test_response_falls_off_to_the_sides_as_cos_4_in_air():
    response = DetectorModel(imager(detector=data()["detector"] | {"uniformity": 0.0}), 5).response
    tangent = (np.arange(12) - 5.5) / 6.0 * np.tan(np.radians(30.0))
    fall = (1.0 + tangent**2) ** -2.0
    assert np.allclose(response / response[5:6], (fall / fall[5])[:, None], rtol=1e-4)


# Lines


def test_lines_do_not_depend_on_where_one_begins():
    found = scan(flat(0.2, cover=[{"material": "kelp", "share": 0.4, "length": 0.4}]))
    whole = list(found.blocks())
    assert [block.first for block in whole] == [0, BLOCK, 2 * BLOCK] and len(whole[2].counts) == 8
    (last,) = scan(flat(0.2, cover=[{"material": "kelp", "share": 0.4, "length": 0.4}])).blocks(2 * BLOCK)
    assert (last.counts == whole[2].counts).all()


def test_stamps_are_those_of_the_imagers_own_clock_and_grow():
    found = scan()
    clock = Clock(offset=0.5, drift=1e-3, jitter=0.02)
    stamps = found.stamps(clock)
    assert (np.diff(stamps) > 0).all()
    assert np.abs(stamps - (found.t * 1.001 + 0.5)).max() <= 0.4 * 0.05 + 1e-12 and np.std(stamps - found.t) > 0.005
    assert np.allclose(found.stamps(Clock()), found.t)


def test_covers_cover_their_shares_and_reflect_like_their_materials():
    scene = flat(cover=[{"material": "kelp", "share": 0.3, "length": 1.0, "seed": 3}])
    ground = Ground(scene, np.array([550.0, 650.0, 750.0]))
    place = np.random.default_rng(1).uniform(-60.0, 60.0, (40000, 2))
    shares = ground.shares(place, 0.002)
    assert shares.shape == (40000, 3)
    assert (shares[:, 2] > 0.5).mean() == pytest.approx(0.3, abs=0.03)
    inside = (shares[:, 2] > 0.5) & (shares[:, :2].sum(axis=1) < 1e-6)
    assert inside.sum() > 5000
    albedo = ground.albedo(place[inside], 0.002)
    assert np.allclose(albedo / albedo[:, :1], ground.spectra[2] / ground.spectra[2, 0], rtol=1e-3)
    assert albedo.min() >= 0.0


def test_the_scene_for_imagers_is_one_that_imagers_can_see():
    found = scan(load_scene("shoal"))
    counts = np.concatenate([block.counts for block in found.blocks()])
    assert counts.shape == (40, 12, 5) and (counts < 4095).mean() > 0.9 and np.ptp(counts[..., 2]) > 300


# The path


def test_a_path_goes_through_its_poses_and_turns_the_short_way():
    t = np.arange(0.0, 2.0, 0.1)
    eta = np.column_stack([0.1 * t**2, np.sin(t), 3 + 0 * t, 0.1 * np.sin(t), 0.1 * t, np.pi - 0.3 + 0.4 * t])
    eta[:, 5] = (eta[:, 5] + np.pi) % (2 * np.pi) - np.pi
    found = PosePath.of(t, eta)
    place, R, q = found.at(t)
    assert np.allclose(place, eta[:, :3]) and np.allclose(np.linalg.norm(q, axis=1), 1.0)
    assert np.allclose(R, Rotation.from_euler("ZYX", eta[:, 5:2:-1]).as_matrix(), atol=1e-12)
    between = t[:-1] + 0.05
    exact = np.column_stack([0.1 * between**2, np.sin(between)])
    assert np.abs(found.at(between)[0][1:-1, :2] - exact[1:-1]).max() < 1e-6
    true = Rotation.from_euler(
        "ZYX", np.column_stack([np.pi - 0.3 + 0.4 * between, 0.1 * between, 0.1 * np.sin(between)])
    )
    assert np.abs(found.at(between)[1] - true.as_matrix())[1:-1].max() < 1e-6


BAD = [
    (lambda t, eta: (t[:1], eta[:1]), "found 1 poses"),
    (lambda t, eta: (t[::-1], eta), "times do not grow"),
    (lambda t, eta: (t * 10, eta), "no pose from .* Log the truth more often"),
    (lambda t, eta: (t, eta + np.nan), "no numbers among"),
]


@pytest.mark.parametrize(("change", "message"), BAD, ids=[m for _, m in BAD])
def test_what_is_wrong_with_a_path_is_named(change, message):
    t = np.arange(0.0, 1.0, 0.1)
    with pytest.raises(LogError, match=message):
        PosePath.of(*change(t, np.zeros((10, 6))))
    assert path().t[-1] > 3.0
