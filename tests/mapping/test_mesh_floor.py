"""Meshes as floor: rays end where the closed form says, also on what stands above; any frame; bad ones named."""

import numpy as np
import pytest
import trimesh
from tests.mapping.helper import imager, mount, moving
from tests.mapping.test_floors import DATUM, HIGH, LOW, dem, depth_at

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.floor import Plane, floor_hits
from rovtwin.mapping.floors import Elevation, elevation_model
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.mesh_floor import MeshFloor, MeshFrame, mesh_floor
from rovtwin.mapping.projection import crs_of, project
from rovtwin.simulation.scene.shapes import grid_triangles

BOX = np.array([LOW[0], LOW[1], 0.0]), np.array([HIGH[0], HIGH[1], 9.0])


def sheet(depth, low=(-3.0, -2.0), high=(13.0, 8.0), cell=0.1):
    """Vertices and faces of a surface over a grid."""
    axes = [np.arange(a, b + 0.5 * cell, cell) for a, b in zip(low, high, strict=True)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    return np.column_stack([place, depth(*place.T)]), grid_triangles(len(axes[0]), len(axes[1]))


def floor_of(*parts):
    return MeshFloor(np.concatenate([vertices[faces] for vertices, faces in parts]))


def box(north, east, top, bottom):
    made = trimesh.creation.box(bounds=[[north[0], east[0], top], [north[1], east[1], bottom]])
    return np.asarray(made.vertices), np.asarray(made.faces)


def written(folder, vertices, faces, name="floor.ply", encoding="binary"):
    path = folder / name
    if name.endswith(".ply"):  # trimesh writes 32-bit numbers
        head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}", *(f"property double {x}" for x in "xyz")]
        head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
        rows = [" ".join(repr(float(x)) for x in row) for row in vertices]
        path.write_text("\n".join([*head, *rows, *(f"3 {a} {b} {c}" for a, b, c in faces)]) + "\n")
    else:
        trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


def over(floor, **given):
    where = moving((0.05, -0.04, 0.6), **given)
    return Georeference(imager(pixels=60), mount(), where, floor).locate(where.t[5:-5])


def test_on_a_sloping_plane_pixels_lie_where_the_closed_form_has_them():
    plane = Plane(5.0, (0.05, -0.03))
    mesh = over(floor_of(sheet(lambda n, e: 5.0 + 0.05 * n - 0.03 * e)))
    closed = over(plane)
    assert mesh.valid.all() and np.abs(mesh.point - closed.point).max() < 1e-12
    assert np.abs(mesh.normal - closed.normal).max() < 1e-12 and np.abs(mesh.way - closed.way).max() < 1e-12


def test_no_ray_slips_through_an_edge_or_a_corner():
    vertices, faces = sheet(lambda n, e: 5.0 + 0 * n, (0.0, 0.0), (1.0, 1.0), 0.25)
    rng = np.random.default_rng(2)
    a, b = vertices[faces[:, 0]], vertices[faces[:, 1]]
    inner = (vertices[:, :2] > 0.0).all(axis=1) & (vertices[:, :2] < 1.0).all(axis=1)
    aims = np.concatenate([vertices[inner], (a + rng.random((len(a), 1)) * (b - a))])
    edge = (aims[:, :2] == 0.0).any(axis=1) | (aims[:, :2] == 1.0).any(axis=1)
    for eye in ([0.3, 0.7, 2.0], [0.5, 0.5, 4.99], [3.0, -1.0, 1.0]):
        to = aims[~edge] - eye
        far = np.linalg.norm(to, axis=1)
        hits = floor_hits(floor_of((vertices, faces)), np.array(eye), to / far[:, None], 99.0)
        assert np.abs(hits.way - far).max() < 1e-9


def test_the_nearest_of_all_triangles_is_met_as_by_trying_each_one():
    rng = np.random.default_rng(5)
    corners = rng.normal(size=(300, 1, 3)) + 0.4 * rng.normal(size=(300, 3, 3))
    origin, direction = 4.0 * rng.normal(size=(400, 3)), rng.normal(size=(400, 3))
    direction = (-origin + 0.5 * direction) / np.linalg.norm(-origin + 0.5 * direction, axis=1, keepdims=True)
    found = MeshFloor(corners).hits(origin, direction, 9.0).way
    expected = np.full(400, np.inf)
    for one in corners:  # by the plane of each, and by sides
        normal = np.cross(one[1] - one[0], one[2] - one[0])
        t = (normal @ one[0] - origin @ normal) / (direction @ normal)
        at = origin + t[:, None] * direction
        sides = [np.cross(one[(i + 1) % 3] - one[i], at - one[i]) @ normal >= 0 for i in range(3)]
        expected = np.where(np.all(sides, axis=0) & (t > 0) & (t <= 9.0), np.minimum(expected, t), expected)
    assert np.isfinite(expected).sum() > 150
    assert np.array_equal(np.isfinite(found), np.isfinite(expected))
    hit = np.isfinite(found)
    assert np.abs(found[hit] - expected[hit]).max() < 1e-9


def test_a_box_25_cm_above_the_floor_is_where_it_is_and_a_flat_floor_puts_it_centimetres_off():
    ground, top = sheet(lambda n, e: 5.0 + 0 * n), 4.75
    north, east = (0.3, 0.8), (-0.1, 0.7)
    mesh, flat = over(floor_of(ground, box(north, east, top, 5.0))), over(Plane(5.0))
    above = over(Plane(top))
    on = (above.point[..., 0] > north[0]) & (above.point[..., 0] < north[1])
    on &= (above.point[..., 1] > east[0]) & (above.point[..., 1] < east[1])
    assert on.sum() > 200 and np.abs(mesh.point[on] - above.point[on]).max() < 1e-12
    off = np.linalg.norm(flat.point[on] - above.point[on], axis=-1)
    aside = np.hypot(*(flat.point[on] - above.point[on])[:, :2].T)
    assert np.sqrt(np.mean(aside**2)) > 0.02 and (off >= 0.25).all()
    sides = mesh.valid & ~on & (mesh.point[..., 2] < 4.999)
    assert (np.abs(mesh.normal[sides][:, 2]) < 1e-9).all()  # all that is neither top nor floor is a side


def test_beneath_an_overhang_rays_reach_the_floor_and_upright_they_do_not():
    floor = floor_of(sheet(lambda n, e: 5.0 + 0 * n), box((1.0, 3.0), (0.0, 2.0), 4.0, 4.1))
    slanted = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
    hits = floor_hits(floor, np.array([[-2.0, 1.0, 2.5], [2.0, 1.0, 3.0]]), np.array([slanted, [0, 0, 1.0]]), 12.0)
    assert np.abs(hits.point - [[0.5, 1.0, 5.0], [2.0, 1.0, 4.0]]).max() < 1e-12
    under = floor_hits(floor, np.array([[0.2, 1.0, 4.2]]), np.array([[1.0, 0.0, 0.5]]) / np.sqrt(1.25), 12.0)
    assert np.abs(under.point - [[1.8, 1.0, 5.0]]).max() < 1e-12  # it lies 0.8 m in from the edge
    depth, slope = floor.depth_and_slope(np.array([[2.0, 1.0], [5.0, 1.0], [50.0, 1.0]]))
    assert depth[:2].tolist() == [4.0, 5.0] and np.isnan(depth[2]) and not slope.any()


def test_past_edges_and_through_holes_there_is_no_floor():
    vertices, faces = sheet(lambda n, e: 5.0 + 0 * n)
    middle = vertices[faces].mean(axis=1)
    holed = faces[np.hypot(middle[:, 0] - 0.5, middle[:, 1] - 0.3) > 0.15]
    found = over(floor_of((vertices, holed)))
    whole = over(floor_of((vertices, faces)))
    inside = np.hypot(whole.point[..., 0] - 0.5, whole.point[..., 1] - 0.3) < 0.1
    assert inside.sum() > 20 and not found.valid[inside].any() and np.isnan(found.point[inside]).all()
    assert found.valid[np.hypot(whole.point[..., 0] - 0.5, whole.point[..., 1] - 0.3) > 0.25].all()


@pytest.mark.parametrize("turned", [False, True])
def test_the_winding_of_triangles_does_not_matter(turned):
    vertices, faces = sheet(depth_at)
    found = over(floor_of((vertices, faces[:, ::-1] if turned else faces)))
    assert (found.cosine > 0).all() and (found.normal[..., 2] < 0).all()


@pytest.mark.parametrize("frame", ["ned", "enu", "EPSG:32632", "EPSG:25833"])
@pytest.mark.parametrize("name", ["floor.ply", "floor.obj"])
def test_a_mesh_is_where_its_frame_says_and_agrees_with_an_elevation_model(tmp_path, frame, name):
    vertices, faces = sheet(depth_at, cell=0.25)
    stored = vertices
    if frame == "enu":
        stored = vertices[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    elif frame != "ned":
        xy = project(DATUM, crs_of(frame, "test"), vertices)
        stored = np.column_stack([xy, DATUM.height - vertices[:, 2]])
    found = mesh_floor(written(tmp_path, stored, faces, name), DATUM, *BOX, MeshFrame(frame))
    place = LOW + (HIGH - LOW) * np.random.default_rng(3).random((200, 2))
    exact = floor_of((vertices, faces)).depth_and_slope(place)[0]
    # PLY in double precision; trimesh writes OBJ to 8 decimals. A system's heights lie over the curved Earth.
    assert np.abs(found.depth_and_slope(place)[0] - exact).max() < (1e-7 if name == "floor.obj" else 1e-9) + (
        0.0 if frame in ("ned", "enu") else 1e-4
    )
    model = elevation_model(dem(tmp_path / "dem.tif", cell=0.1), DATUM, LOW, HIGH, Elevation())
    # flat triangles of 0.25 m on a surface of this curvature are off by at most 0.128 x 0.25^2 / 4
    assert np.abs(found.depth_and_slope(place)[0] - model.depth_and_slope(place)[0]).max() < 2.1e-3


FLAT = sheet(lambda n, e: 5.0 + 0 * n, cell=1.0)
UTM = np.array([567820.0, 7036450.0, 0.0])


def changed(vertices, **by):
    return np.stack([by.get(axis, 1.0) * vertices[:, k] + by.get(f"d{axis}", 0.0) for k, axis in enumerate("ned")], 1)


BAD = [
    ("degrees", changed(FLAT[0], n=1e-5, e=1e-5, dn=63.45, de=10.36), "ned", "Are its coordinates degrees"),
    (
        "degrees as UTM",
        changed(FLAT[0], n=1e-2, e=1e-2),
        "EPSG:32632",
        "degrees, or counted from an origin of their own",
    ),
    ("elsewhere", changed(FLAT[0], dn=500.0), "ned", "north 497 to 513.*survey's floor must lie within north -2 to 12"),
    ("in mm", changed(FLAT[0], n=1e3, e=1e3, d=1e3), "ned", "depth 5000 to 5000"),
    ("upside down", changed(FLAT[0], d=-1.0), "ned", "axes or units others.*--floor-crs ned"),
    ("no number", np.where(np.arange(len(FLAT[0]))[:, None] == 5, np.nan, FLAT[0]), "ned", "no numbers"),
    ("another UTM zone", FLAT[0] + UTM + [9e4, 0, 0.123], "EPSG:32632", "must lie within"),
    ("a geographic system", FLAT[0], "EPSG:4326", "--floor-crs: .*no coordinates in metres"),
]


@pytest.mark.parametrize(("vertices", "frame", "message"), [one[1:] for one in BAD], ids=[one[0] for one in BAD])
def test_a_mesh_that_cannot_be_is_named(tmp_path, vertices, frame, message):
    path = written(tmp_path, vertices, FLAT[1])
    with pytest.raises(ConfigError, match=message) as error:
        mesh_floor(path, DATUM, *BOX, MeshFrame(frame))
    assert str(path) in str(error.value) or "--floor-crs" in str(error.value)


def test_numbers_of_32_bits_a_cloud_and_a_file_that_is_none_are_named(tmp_path):
    coarse = (FLAT[0] + UTM).astype(np.float32).astype(float)
    with pytest.raises(ConfigError, match=r"as 32-bit numbers, which are 0\.5 m apart"):
        mesh_floor(written(tmp_path, coarse, FLAT[1], "floor.stl"), DATUM, *BOX, MeshFrame("EPSG:32632"))
    path = tmp_path / "floor.ply"
    path.write_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\n"
                    "end_header\n1 2 3\n")  # fmt: skip
    with pytest.raises(ConfigError, match="has no triangles|cannot be read as a mesh"):
        mesh_floor(path, DATUM, *BOX, MeshFrame())
    path.write_text("gravel")
    with pytest.raises(ConfigError, match="cannot be read as a mesh|has no triangles"):
        mesh_floor(path, DATUM, *BOX, MeshFrame())
    with pytest.raises(ConfigError, match=r"none\.ply: cannot be read: No such file"):
        mesh_floor(tmp_path / "none.ply", DATUM, *BOX, MeshFrame())


def test_a_vertex_of_no_triangle_that_is_no_number_hides_nothing(tmp_path):
    """What is wrong with the others is named all the same, and what is right is used."""
    degrees = np.vstack([changed(FLAT[0], n=1e-5, e=1e-5, dn=63.45, de=10.36), np.full((1, 3), np.nan)])
    with pytest.raises(ConfigError, match="Are its coordinates degrees"):
        mesh_floor(written(tmp_path, degrees, FLAT[1]), DATUM, *BOX, MeshFrame())
    right = np.vstack([np.full((1, 3), np.nan), FLAT[0]])
    found = mesh_floor(written(tmp_path, right, FLAT[1] + 1), DATUM, *BOX, MeshFrame())
    assert np.abs(found.depth_and_slope(np.array([[5.0, 3.0]]))[0] - 5.0).max() < 1e-12
