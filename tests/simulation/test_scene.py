"""Scene files: what they say, what they must not say, and that the surfaces lie where the file has them."""

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.simulation.scene import list_scenes, load_scene, scene_from_dict, scene_schema

pytest.importorskip("cv2")

BOX = {"name": "box", "box": [1.0, 2.0, 3.0], "pose": {"position": [5.0, 0.0, 2.0]}}
MARKER = {"id": 3, "size": 0.2, "position": [1.0, 0.0, 1.0], "faces": [-1.0, 0.0, 0.0]}


def on(face, pose=None, at=(0.0, 0.0), roll=0.0):
    """The one marker of a scene with a box that carries it."""
    box = BOX | ({} if pose is None else {"pose": pose})
    marker = {"id": 1, "size": 0.2, "at": list(at), "roll_deg": roll}
    scene = scene_from_dict(
        {"name": "s", "objects": [box], "markers": {"on_faces": [{"object": "box", "face": face, "markers": [marker]}]}}
    )
    return scene.layout.markers[0], scene


@pytest.mark.parametrize("name", list_scenes())
def test_each_scene_of_the_library_has_surfaces_and_markers_that_are_not_inside_of_anything(name):
    scene = load_scene(name)
    assert len(scene.rectangles) + len(scene.meshes) > 1
    assert scene.layout.markers
    for marker in scene.layout.markers:
        assert 0.0 < marker.corners[:, 2].min() and marker.corners[:, 2].max() < scene.depth


def test_mclab_is_the_tank_of_table_5_10_with_three_markers_on_one_side_of_the_box():
    scene = load_scene("mclab")
    walls = np.concatenate([r.corners for r in scene.rectangles[:5]])
    assert np.allclose(np.ptp(walls, axis=0), [40.0, 6.5, 1.5])
    box = np.concatenate([r.corners for r in scene.rectangles[5:11]])
    assert np.allclose(np.ptp(box, axis=0), [1.5, 1.5, 1.5])
    assert [m.size for m in scene.layout.markers] == [0.15] * 3
    assert np.allclose([m.corners[:, 0] for m in scene.layout.markers], box[:, 0].min())


@pytest.mark.parametrize(
    ("face", "place", "right"),
    [
        ("south", [4.5, 0.0, 2.0], [0, 1, 0]),
        ("north", [5.5, 0.0, 2.0], [0, -1, 0]),
        ("east", [5.0, 1.0, 2.0], [1, 0, 0]),
        ("west", [5.0, -1.0, 2.0], [-1, 0, 0]),
        ("top", [5.0, 0.0, 0.5], [0, 1, 0]),
    ],
)
def test_a_marker_on_a_face_lies_in_it_and_is_upright_for_who_looks_at_it(face, place, right):
    marker, scene = on(face)
    assert np.allclose(marker.position, place)
    assert np.allclose(marker.R_nm[:, 0], right)
    sides = [r for r in scene.rectangles if r.print is None and np.allclose(r.normal, marker.R_nm[:, 2])]
    assert len(sides) == 1 and np.allclose((marker.corners - sides[0].corner) @ sides[0].normal, 0.0)


def test_a_marker_turns_with_its_box_and_with_its_roll():
    plain, _ = on("south", at=(0.3, 0.4), roll=20.0)
    turned, scene = on("south", {"position": [5.0, 0.0, 2.0], "attitude_deg": [15.0, 10.0, 40.0]}, (0.3, 0.4), 20.0)
    R = scene.rectangles[0].normal, scene.rectangles[2].normal  # of north and east: x and y of the box
    R = np.column_stack([*R, np.cross(*R)])
    moved = (plain.corners - [5.0, 0.0, 2.0]) @ R.T + [5.0, 0.0, 2.0]
    assert np.allclose(turned.corners, moved)


def test_the_walls_of_a_tank_look_inwards_and_carry_markers():
    tank = {"length": 10.0, "width": 4.0, "depth": 2.0, "heading_deg": 90.0, "position": [1.0, 2.0, 0.0]}
    data = {"id": 0, "size": 0.3, "at": [1.0, 0.5]}
    scene = scene_from_dict(
        {"name": "s", "tank": tank, "markers": {"on_faces": [{"object": "tank", "face": "north", "markers": [data]}]}}
    )
    middle = np.array([1.0, 2.0, 1.0])
    for wall in scene.rectangles[:5]:
        assert (middle - wall.corner) @ wall.normal > 0
    # The tank's north wall lies east when the tank is turned by 90 degrees; right of who looks there is south.
    assert np.allclose(scene.layout.markers[0].position, [0.0, 7.0, 0.5])


def test_a_print_is_larger_than_its_marker_by_a_white_rim_and_shows_what_opencv_prints():
    import cv2

    scene = scene_from_dict({"name": "s", "markers": {"free": [MARKER]}})
    (board,) = scene.rectangles
    assert np.linalg.norm(board.right) == pytest.approx(0.2 * 8 / 6)
    inner = np.kron(255 * board.print, np.ones((20, 20))).astype(np.uint8)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    _, ids, _ = detector.detectMarkers(inner)
    assert ids.ravel().tolist() == [3]


def test_relief_and_wreck_are_the_same_every_time_and_stay_near_the_bottom():
    one, two = (load_scene("seabed").meshes for _ in range(2))
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a.vertices, b.vertices)
        assert np.allclose(np.linalg.norm(a.normals, axis=1), 1.0)
    assert np.ptp(one[0].vertices[:, 2]) == pytest.approx(1.1, abs=0.05)


def test_a_mesh_file_is_placed_and_scaled(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box(extents=[1000.0, 2000.0, 500.0]).export(tmp_path / "block.stl")
    item = {"name": "block", "mesh": {"file": "block.stl", "scale": 0.001}, "pose": {"position": [3.0, 0.0, 1.0]}}
    (mesh,) = scene_from_dict({"name": "s", "objects": [item]}, folder=tmp_path).meshes
    assert np.allclose(mesh.vertices.min(axis=0), [2.5, -1.0, 0.75])
    assert np.allclose(mesh.vertices.max(axis=0), [3.5, 1.0, 1.25])
    outward = ((mesh.vertices - [3.0, 0.0, 1.0]) * mesh.normals).sum(axis=1)
    assert (outward > 0).all()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"objects": [{"name": "a"}]}, r"objects\[0\]: found none, expected one of box, cylinder, plane, mesh, wreck"),
        ({"objects": [BOX, BOX]}, "the name 'box' is given twice"),
        ({"objects": [BOX | {"surface": {"colour": "red"}}]}, "expected a colour such as '#e6b800'"),
        ({"water": {"type": "jerlov_4"}}, "expected one of clear_tank, jerlov_I"),
        ({"markers": {"free": [MARKER, MARKER]}}, "marker 3 2 times, expected each id once"),
        ({"markers": {"on_faces": [{"object": "bax", "face": "top", "markers": []}]}, "objects": [BOX]}, "mean 'box'"),
        ({"markers": {"on_faces": [{"object": "tank", "face": "top", "markers": []}]}}, "but the scene has none"),
        ({"tank": {"length": 1, "width": 1, "depth": 1}, "bottom": {"depth": 2}}, "expected one of them"),
        ({"tank": {"lenght": 1, "width": 1, "depth": 1}}, "Did you mean 'length'"),
        ({"objects": [{"name": "a", "mesh": {"file": "no.stl"}}]}, "no.stl, which is no file"),
    ],
)
def test_what_cannot_be_is_named(data, message):
    with pytest.raises(ConfigError, match=message):
        _ = scene_from_dict({"name": "s"} | data).meshes


def test_a_scene_that_is_not_there_is_named():
    with pytest.raises(ConfigError, match="Did you mean 'mclab'"):
        load_scene("mclap")


def test_the_schema_describes_all_shapes():
    assert {"box", "cylinder", "plane", "mesh", "wreck"} <= set(scene_schema()["$defs"]["Object"]["properties"])
