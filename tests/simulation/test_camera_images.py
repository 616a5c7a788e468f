"""Rendered pictures: what is where, to a fraction of a pixel; both renderers alike; water, blur and noise."""

from dataclasses import replace

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.simulation.camera.outside import outside_view
from rovtwin.simulation.camera.rays import rays_of
from rovtwin.simulation.camera.renderer import image_flow, renderer
from rovtwin.simulation.camera.water import PURE, Optics
from rovtwin.simulation.scene import load_scene, scene_from_dict
from rovtwin.simulation.scene.schema import Water
from rovtwin.simulation.scene.surfaces import Material, Rectangle
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.cameras import Camera, cameras_of
from rovtwin.vehicle.physics.camera import Port, lens_from, project

cv2 = pytest.importorskip("cv2")

LEFT = cameras_of(load_vehicle("double_blueye_thesis"))[0]
SMALL = replace(LEFT, lens=LEFT.lens.scaled(1 / 3))  # 640 x 360
TANK = {"length": 12.0, "width": 6.0, "depth": 2.0}
PLACE, LEVEL = np.array([3.0, 0.1, 0.9]), np.eye(3)


def has_gl():
    try:
        from rovtwin.simulation.camera.gl import context

        context()
    except ConfigError:
        return False
    return True


gl_here = pytest.mark.skipif(not has_gl(), reason="no OpenGL over EGL here")
KINDS = ["raycast", pytest.param("gl", marks=gl_here)]


class Chess(type(load_scene("pool"))):
    """A board of 11 x 11 squares across the view, whose inner corners can be found to a few hundredths of a pixel."""

    CELL, AHEAD = 0.17, 1.6

    @property
    def rectangles(self):
        n = 11
        squares = (np.add.outer(np.arange(n), np.arange(n)) % 2).astype(np.uint8)
        right, up = np.array([0.0, n * self.CELL, 0.0]), np.array([0.0, 0.0, -n * self.CELL])
        middle = np.array([self.AHEAD, LEFT.position[1], 1.0 + LEFT.position[2]])
        material = Material(np.full(3, 0.8), np.full(3, 0.03))
        return [Rectangle(middle - 0.5 * (right + up), right, up, material, print=squares)]

    @property
    def corners(self):
        """Inner corners in n, shape (100, 3)."""
        board, steps = self.rectangles[0], np.arange(1, 11) / 11
        return board.corner + np.array([a * board.right + b * board.up for a in steps for b in steps])


def chess():
    # Clear, and lit evenly: what is measured is where things are, not how bright.
    data = {"name": "chess", "water": {"absorption": [0, 0, 0], "scattering": [0, 0, 0]}, "light": {"caustics": 0.0}}
    return Chess(scene_from_dict(data).file, "chess")


LENSES = {
    "thesis": LEFT.lens.scaled(0.5),
    "pinhole": lens_from([420, 420], [479.5, 269.5], (960, 540)),
    "barrel": lens_from([420, 425], [470, 280], (960, 540), [-0.2, 0.03, 1e-3, -1e-3]),
    "port": lens_from([520, 520], [470, 280], (960, 540), [0.1, 0.02], Port.of(0.015, 0.004)),
}


MOST = {"raycast": 0.13, "gl": 0.17}  # by which corners may miss, rms [px]


def picture_of(scene, camera, kind):
    """Grey, uint8, from 1 m of depth, level, looking north."""
    return cv2.cvtColor(renderer(scene, camera, kind).image([0.0, 0.0, 1.0], LEVEL), cv2.COLOR_RGB2GRAY)


def corner_errors(picture, scene, camera):
    """Corners of the board as found in the picture less those that projection has [px], shape (n, 2).

    OpenCV's refinement returns where it starts when it finds nothing there. So it starts 1.5 to 2 px beside projection,
    twice, each time in another direction, and has to end at the same place.
    """
    eye = np.array([0.0, 0.0, 1.0]) + camera.position
    true = np.asarray(project(camera.lens, (scene.corners - eye) @ camera.R_bc))
    true = true[((true > 8) & (true < np.array(camera.lens.size) - 9)).all(axis=1)]
    assert len(true) >= 40, "too few corners in the picture"
    around = [picture[row - 4 : row + 5, column - 4 : column + 5] for column, row in np.rint(true).astype(int)]
    assert min(int(window.max()) - int(window.min()) for window in around) > 100, "contrast: no corner to be seen"
    draws, found = np.random.default_rng(7), []
    for _ in range(2):
        angle, beside = draws.uniform(0.0, 2.0 * np.pi, len(true)), draws.uniform(1.5, 2.0, len(true))
        start = true + beside[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        found.append(refined(picture, start))
        assert np.linalg.norm(found[-1] - start, axis=1).min() > 0.01, "start: a corner came back where it started"
    assert np.linalg.norm(found[0] - found[1], axis=1).max() < 0.02, "start: a corner depends on where it started"
    return found[0] - true


def refined(picture, start):
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    given = start.astype(np.float32).reshape(-1, 1, 2)
    return cv2.cornerSubPix(picture, given.copy(), (4, 4), (-1, -1), stop).reshape(-1, 2).astype(float)


def check_corners(picture, scene, camera, kind, aside=0.05):
    off = corner_errors(picture, scene, camera)
    assert np.abs(off.mean(axis=0)).max() < aside, "aside: all corners"
    assert np.sqrt((off**2).sum(axis=1).mean()) < MOST[kind], "apart: corners from projection"


@pytest.mark.system
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", LENSES)
def test_corners_come_out_where_projection_has_them(name, kind):
    """A corner is found to 0.1 px rms: that is OpenCV's refinement, also for a pinhole and a board that faces it."""
    camera = replace(LEFT, lens=LENSES[name])
    check_corners(picture_of(chess(), camera, kind), chess(), camera, kind)


# Each with the lens of the picture, that of the projection, and what the check has to say.
BARREL, PINHOLE, PORT = LENSES["barrel"], LENSES["pinhole"], LENSES["port"]
WRONG = {
    "half a pixel to the right": (PINHOLE, lens_from([420, 420], [480.0, 269.5], (960, 540)), "aside"),
    "half a pixel down": (PINHOLE, lens_from([420, 420], [479.5, 270.0], (960, 540)), "aside"),
    "distortion left out": (BARREL, lens_from([420, 425], [470, 280], (960, 540)), "contrast|start|aside|apart"),
    "distortion the wrong way round": (
        BARREL,
        lens_from([420, 425], [470, 280], (960, 540), [0.2, -0.03, -1e-3, 1e-3]),
        "contrast|start|aside|apart",
    ),
    "port left out": (PORT, lens_from([520, 520], [470, 280], (960, 540), [0.1, 0.02]), "contrast|start|aside|apart"),
}


@pytest.mark.system
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("what", WRONG)
def test_a_picture_through_another_lens_is_detected_by_its_corners(what, kind):
    lens, other, text = WRONG[what]
    picture = picture_of(chess(), replace(LEFT, lens=lens), kind)
    with pytest.raises(AssertionError, match=text):
        check_corners(picture, chess(), replace(LEFT, lens=other), kind)


@pytest.mark.system
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda picture: np.full_like(picture, 128), "contrast"),
        (lambda picture: np.tile(np.uint8([20, 20, 20, 20, 200, 200, 200, 200]), (540, 120)), "start"),
        (lambda picture: np.roll(picture, (15, 12), axis=(0, 1)), "contrast"),
        (lambda picture: np.roll(picture, 1, axis=1), "aside"),
    ],
    ids=["blank", "stripes", "principal point off by 12, 15", "by one pixel"],
)
def test_a_picture_without_the_corners_is_detected(spoil, message):
    camera = replace(LEFT, lens=PINHOLE)
    with pytest.raises(AssertionError, match=message):
        check_corners(spoil(picture_of(chess(), camera, "raycast")), chess(), camera, "raycast")


class Board(Chess):
    """As large in the picture from any way."""

    AWAY = 1.0
    CELL = property(lambda self: 0.12 * self.AWAY)
    AHEAD = property(lambda self: self.AWAY + LEFT.position[0])


@pytest.mark.system
@gl_here
@pytest.mark.parametrize("away", [0.5, 1.0, 5.0])
def test_a_port_is_drawn_for_the_range_that_is_seen(away, monkeypatch):
    lens = lens_from([520, 520], [470, 280], (960, 540), [0.1, 0.02], Port.of(0.02, 0.005))
    camera = replace(LEFT, lens=lens)
    monkeypatch.setattr(Board, "AWAY", away)
    scene = Board(chess().file, "chess")
    check_corners(picture_of(scene, camera, "gl"), scene, camera, "gl", aside=0.1)
    # One pinhole for all ranges, here exact at 2 m, does not pass.
    monkeypatch.setattr("rovtwin.simulation.camera.gl._PORT_ROUNDS", 0)
    with pytest.raises(AssertionError, match="start|apart"):
        check_corners(picture_of(scene, camera, "gl"), scene, camera, "gl", aside=0.1)


def detected(picture):
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    settings = detector.getDetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector.setDetectorParameters(settings)
    corners, ids, _ = detector.detectMarkers(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))
    return {int(k): c[0] for k, c in zip([] if ids is None else ids.ravel(), corners, strict=False)}


@pytest.mark.system
def test_markers_are_detected_with_their_ids_near_where_projection_has_them():
    scene = load_scene("pool")
    found = detected(renderer(scene, SMALL, "raycast").image(PLACE, LEVEL))
    known = {m.id: m for m in scene.layout.markers}
    assert len(found) >= 4 and set(found) <= set(known)
    eye = PLACE + SMALL.position
    for number, corners in found.items():
        true = np.asarray(project(SMALL.lens, (known[number].corners - eye) @ SMALL.R_bc))
        # The refinement pulls the corners of a dark square inwards, each by about 0.4 px; its middle stays.
        assert np.abs(corners - true).max() < 1.0
        assert np.abs((corners - true).mean(axis=0)).max() < 0.3


@pytest.mark.system
@gl_here
def test_both_renderers_agree_on_marker_corners_and_on_brightness():
    scene = load_scene("pool")
    camera = replace(LEFT, lens=LEFT.lens.scaled(0.5))
    drawn, apart = [renderer(scene, camera, kind) for kind in ("raycast", "gl")], []
    for x in (3.0, 4.0):
        pictures = [one.image([x, 0.1, 0.9], LEVEL) for one in drawn]
        found = [detected(picture) for picture in pictures]
        both = set(found[0]) & set(found[1])
        assert len(both) >= 5
        apart += [found[0][k] - found[1][k] for k in both]
        difference = np.abs(pictures[0].astype(int) - pictures[1])
        assert difference.mean() < 1.0 and np.quantile(difference, 0.99) < 12
    assert np.sqrt((np.concatenate(apart) ** 2).sum(axis=1).mean()) < 0.3


@pytest.mark.system
@gl_here
def test_lamps_light_and_glow_alike_in_both():
    lamp = {"position": [0.3, 0.0, 0.1], "beam_deg": 70.0, "power": 1.0}
    data = {"name": "dark", "tank": TANK, "water": {"type": "jerlov_3C"}, "light": {"surface": 0.0, "lamps": [lamp]}}
    scene = scene_from_dict(data)
    pictures = [renderer(scene, SMALL, kind).image(PLACE, LEVEL).astype(int) for kind in ("raycast", "gl")]
    assert pictures[0].max() > 60
    assert np.abs(pictures[0] - pictures[1]).mean() < 1.0


@pytest.mark.system
def test_the_way_to_what_is_seen_is_measured():
    r = renderer(chess(), replace(LEFT, lens=LENSES["pinhole"]), "raycast")
    _, way = r.brightness(np.array([0.0, 0.0, 1.0]), LEVEL)
    assert way[270, 480] == pytest.approx(Chess.AHEAD - LEFT.position[0], abs=1e-4)
    assert np.isinf(way[0, 0])


def test_murkier_water_takes_contrast_as_beer_and_lambert_have_it():
    # A white and a black plate, alike but for their colour, seen one after the other.
    def grey(colour, c):
        plate = {"name": "p", "plane": [4.0, 4.0], "pose": {"position": [4.0, 0.0, 1.0], "attitude_deg": [0, -90, 0]}}
        data = {"name": "s", "objects": [plate | {"surface": {"colour": colour}}], "light": {"caustics": 0.0}}
        scene = scene_from_dict(data).with_water(beam_attenuation=c, absorption=[0.05, 0.05, 0.05])
        return renderer(scene, SMALL, "raycast").brightness(np.array([0.0, 0.0, 1.0]), LEVEL)[0][180, 320, 1]

    contrast = [grey([0.9, 0.9, 0.9], c) - grey([0.1, 0.1, 0.1], c) for c in (0.3, 1.3)]
    way = 4.0 - LEFT.position[0]
    # The exposure follows the daylight at the camera, of which more scattering leaves less there.
    assert contrast[1] / contrast[0] == pytest.approx(np.exp(-way), rel=0.05)


def test_water_types_are_those_of_the_references():
    tank = Optics.of(Water())
    assert np.array_equal(tank.absorption, PURE)
    types = [Optics.of(Water(type=f"jerlov_{kind}")) for kind in ("I", "IB", "II", "III", "1C", "5C", "9C")]
    green = [o.diffuse[1] for o in types]
    assert green == pytest.approx([0.063, 0.072, 0.089, 0.12, 0.12, 0.30, 0.63])
    assert np.all(np.diff([o.beam[2] for o in types]) > 0)
    assert Optics.of(Water(beam_attenuation=0.6)).beam[1] == pytest.approx(0.6)


@pytest.mark.system
def test_blur_is_as_long_as_the_way_in_the_picture_while_the_shutter_is_open():
    scene, camera = chess(), replace(LEFT, lens=LENSES["thesis"])
    r = renderer(scene, camera, "raycast")
    place, dt = np.array([0.0, 0.0, 1.0]), 1e-3
    nu = np.array([0.1, 0.3, -0.2, 0.05, -0.1, 0.2])
    flow = image_flow(r.rays, camera, r.brightness(place, LEVEL)[1], nu)
    turn = np.eye(3) + dt * np.array([[0, -nu[5], nu[4]], [nu[5], 0, -nu[3]], [-nu[4], nu[3], 0]])
    seen = [
        np.asarray(project(camera.lens, (scene.corners - (p + R @ camera.position)) @ (R @ camera.R_bc)))
        for p, R in ((place, LEVEL), (place + dt * nu[:3], turn))
    ]
    at = np.rint(seen[0]).astype(int)
    inside = ((at > 5) & (at < np.array(camera.lens.size) - 5)).all(axis=1)
    expected = (seen[1] - seen[0])[inside] / dt
    got = flow[at[inside][:, 1], at[inside][:, 0]]
    assert np.abs(got - expected).max() < 0.03 * np.abs(expected).max()


@pytest.mark.system
def test_motion_blurs_edges_across_it():
    scene, camera = chess(), replace(LEFT, lens=LENSES["pinhole"])
    r = renderer(scene, camera, "raycast", exposure=0.03)
    still, moved = (r.image([0.0, 0.0, 1.0], LEVEL, velocity=v).astype(float) for v in (None, [0.0, 0.5, 0.0]))
    # 0.5 m/s at 1.35 m, f = 420 px, 0.03 s: 4.7 px sideways. Level edges keep their sharpness.
    for axis, least, most in ((1, 3.0, 8.0), (0, 0.8, 1.3)):
        steep = [np.abs(np.diff(picture[200:340, 400:560, 1], axis=axis)).max() for picture in (still, moved)]
        assert least < steep[0] / steep[1] < most


@pytest.mark.system
def test_noise_comes_from_its_seed():
    r = renderer(load_scene("pool"), replace(LEFT, lens=LEFT.lens.scaled(1 / 6)), "raycast", noise=3.0)
    clean, one, same, other = (r.image(PLACE, LEVEL, seed=seed).astype(int) for seed in (None, 1, 1, 2))
    assert np.array_equal(one, same) and not np.array_equal(one, other)
    assert (one - clean).std() == pytest.approx(3.0, rel=0.05)


def test_the_same_lens_is_computed_once():
    assert rays_of(SMALL.lens) is rays_of(replace(SMALL, name="again").lens)


def test_meshes_need_the_other_renderer_and_the_message_says_so():
    with pytest.raises(ConfigError, match=r"bottom, wreck.*'gl': pip install 'rovtwin\[render\]'"):
        renderer(load_scene("seabed"), SMALL, "raycast")
    with pytest.raises(ConfigError, match="expected auto, gl or raycast"):
        renderer(load_scene("pool"), SMALL, "vulkan")


def test_a_lens_that_maps_nothing_to_some_pixels_is_named():
    # r (1 - 2 r^2) never exceeds 0.27: no ray leads to the corners of this picture.
    broken = Camera("broken", lens_from([300, 300], [319.5, 179.5], (640, 360), [-2.0, 0.0]), LEFT.position, LEFT.R_bc)
    with pytest.raises(ConfigError, match="camera broken: its distortion"):
        renderer(load_scene("pool"), broken, "raycast")


@pytest.mark.system
@pytest.mark.parametrize("kind", KINDS)
def test_what_stands_out_of_the_water_is_not_seen_above_the_surface_which_mirrors_what_is_below(kind):
    # A red plate whose upper half is in the air, before a white wall.
    plate = {"name": "p", "plane": [0.6, 0.6], "pose": {"position": [3.0, 0.0, 0.0], "attitude_deg": [0, -90, 0]}}
    marker = {"id": 3, "size": 0.2, "position": [2.9, 0.0, 0.25], "faces": [-1.0, 0.0, 0.0]}
    objects = [plate | {"surface": {"colour": "#ff0000"}}]
    light = {"caustics": 0.0}
    scene = scene_from_dict(
        {"name": "s", "tank": TANK, "objects": objects, "markers": {"free": [marker]}, "light": light}
    )
    camera = replace(SMALL, position=np.zeros(3), lens=lens_from([250, 250], [319.5, 179.5], (640, 360)))
    picture = renderer(scene, camera, kind).image([1.5, 0.0, 0.4], LEVEL).astype(int)

    def row(z, x=3.0):
        return round(179.5 + 250 * (z - 0.4) / (x - 1.5))

    red = picture[..., 0] - picture[..., 2] > 40
    column = np.flatnonzero(red[:, 290])
    assert abs(column.min() - row(-0.3)) <= 1 and abs(column.max() - row(0.3)) <= 1
    # The marker's mirror image hangs where a marker upside down at the same height above the surface would.
    black = np.flatnonzero(picture[:, 319 + 15].max(axis=-1) < 90)
    assert abs(black.min() - row(-0.35, 2.9)) <= 2 and abs(black.max() - row(0.35, 2.9)) <= 2


@gl_here
def test_where_opengl_refuses_auto_falls_back_and_gl_says_so(monkeypatch):
    monkeypatch.setattr("rovtwin.simulation.camera.gl.FRAGMENT", "#version 330\nthis is no shader")
    camera = replace(LEFT, lens=LEFT.lens.scaled(1 / 12))
    assert renderer(load_scene("pool"), camera, "auto").kind == "raycast"
    with pytest.raises(ConfigError, match=r"port\.camera: OpenGL refuses to draw 160 x 90 pixels .* 'raycast'"):
        renderer(load_scene("pool"), camera, "gl")


@gl_here
@pytest.mark.parametrize("depth", [3.0, 0.25])
def test_from_outside_in_a_tank_so_tiny_that_the_camera_is_straight_above(depth):
    scene = scene_from_dict({"name": "s", "tank": {"length": 0.3, "width": 0.3, "depth": depth}})
    sphere = vehicle_from_dict({"name": "v", "mass": 1.0, "shape": {"sphere": 0.05}})
    picture = outside_view(scene, sphere, [0.0, 0.0, 0.5 * depth], LEVEL, size=(128, 72))
    assert picture.shape == (72, 128, 3) and picture.max() > 105  # the walls: open water has 95 at most
