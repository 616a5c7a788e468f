"""A part's shape given as a mesh: the simple solids come out as what they are, and every mistake is named."""

import json
import time

import numpy as np
import pytest
import trimesh
import yaml
from trimesh.transformations import rotation_matrix

from rovtwin.core.errors import ConfigError
from rovtwin.identification.priors.outline import outline_of
from rovtwin.identification.priors.widths import prior_widths
from rovtwin.scenario.assets import kept_beside
from rovtwin.vehicle import check, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.extent import bounding_box
from rovtwin.vehicle.analysis.visuals import pieces_of
from rovtwin.vehicle.description.identified import fingerprint
from rovtwin.vehicle.description.schema import Shape
from rovtwin.vehicle.description.totals.added_mass import Solid, added_mass
from rovtwin.vehicle.description.totals.drag import drag_elements
from rovtwin.vehicle.solids.mesh_solid import open_share

make = trimesh.creation
BOX = [0.6, 0.4, 0.3]


def lying(mesh):
    """A body about z, laid along x."""
    mesh.apply_transform(rotation_matrix(np.pi / 2, [0, 1, 0]))
    return mesh


def ball(*axes):
    mesh = make.icosphere(subdivisions=4, radius=1.0)
    mesh.apply_scale(axes)
    return mesh


@pytest.fixture
def solid(tmp_path):
    def of(mesh, **more):
        mesh.export(tmp_path / "hull.stl")
        return Solid.of(Shape(mesh=str(tmp_path / "hull.stl"), **more))

    return of


@pytest.mark.parametrize(
    ("mesh", "shape"),
    [
        (lambda: make.box(BOX), {"box": BOX}),
        (
            lambda: lying(make.cylinder(radius=0.1, height=0.6, sections=96)),
            {"cylinder": {"radius": 0.1, "length": 0.6}},
        ),
        (lambda: ball(0.2, 0.2, 0.2), {"sphere": 0.2}),
        (lambda: ball(0.5, 0.2, 0.15), {"ellipsoid": [0.5, 0.2, 0.15]}),
    ],
    ids=["box", "cylinder", "sphere", "ellipsoid"],
)
def test_a_simple_solid_given_as_a_mesh_is_that_solid(solid, mesh, shape):
    """Volume, inertia, areas, added mass and drag: within 1 %, what facets and pixels take from round bodies."""
    found, exact = solid(mesh()), Solid.of(Shape.model_validate(shape))
    assert found.volume() == pytest.approx(exact.volume(), rel=0.01)
    np.testing.assert_allclose(found.homogeneous(1.0).inertia, exact.homogeneous(1.0).inertia, rtol=0.01, atol=1e-5)
    np.testing.assert_allclose(found.projected_areas(), exact.projected_areas(), rtol=0.01)
    expected = np.diag(added_mass(exact, 1000.0))
    np.testing.assert_allclose(
        np.diag(added_mass(found, 1000.0)), expected, rtol=0.01, atol=1e-3 + 2e-3 * expected[3:].max()
    )
    drag = [np.diag(drag_elements(one, 1000.0).damping().quadratic_ahead) for one in (found, exact)]
    np.testing.assert_allclose(drag[0][:3], drag[1][:3], rtol=0.01)
    # The 64 points for an ellipse give 4.2 % more than its integral of lever^3, the silhouette's cells 0.4 %.
    np.testing.assert_allclose(drag[0][3:], drag[1][3:], atol=0.045 * drag[1][3:].max())


def test_a_mesh_turned_in_its_file_is_the_same_body_turned(solid):
    turned = make.box(BOX)
    T = rotation_matrix(0.4, [0.3, 1.0, 0.2], [0.1, 0, 0])
    turned.apply_transform(T)
    found, R = solid(turned), T[:3, :3]
    straight = Solid.of(Shape(box=BOX))
    M = added_mass(straight, 1000.0)
    np.testing.assert_allclose(added_mass(found, 1000.0)[:3, :3], R @ M[:3, :3] @ R.T, atol=0.3)
    np.testing.assert_allclose(found.centered().position, T[:3, 3], atol=1e-6)


def test_center_attitude_and_scale_place_the_mesh(solid):
    mesh = make.box(1000 * np.array(BOX))
    mesh.apply_translation([100, 0, 0])  # its origin is not its middle
    found = solid(mesh, scale=0.001, center=[0, 0.5, 0], attitude_deg=[0, 0, 90])
    np.testing.assert_allclose(found.centered().position, [0, 0.6, 0], atol=1e-6)
    same = Solid.of(Shape(box=BOX, center=[0, 0.6, 0], attitude_deg=[0, 0, 90]))
    np.testing.assert_allclose(added_mass(found, 1000.0), added_mass(same, 1000.0), rtol=1e-3, atol=1e-2)


def test_the_center_of_volume_is_not_the_middle_of_the_box(solid):
    """A cone lies a quarter of its height from its base."""
    found = solid(make.cone(radius=0.1, height=0.4, sections=64))
    assert found.centered().position[2] == pytest.approx(0.1, abs=1e-3)


def test_water_between_walls_goes_along_and_gaps_let_it_through(solid):
    """Two plates across the motion carry the water between them; two hulls along it do not."""
    plates = trimesh.util.concatenate([make.box((0.02, 0.4, 0.4)).apply_translation([x, 0, 0]) for x in (-0.2, 0.2)])
    found = solid(plates)
    assert found.mesh.trapped[0] == pytest.approx(0.4 * 0.4 * 0.38, rel=0.05)
    assert found.mesh.trapped[1] == found.mesh.trapped[2] == 0.0
    np.testing.assert_allclose(found.mesh.solidity, [1.0, 0.1, 0.1], atol=0.01)
    block = added_mass(Solid.of(Shape(box=[0.42, 0.4, 0.4])), 1000.0)[0, 0]
    assert added_mass(found, 1000.0)[0, 0] == pytest.approx(block + 60.8, rel=0.03)


def test_perforation_is_that_of_dnv():
    """DNV-RP-N103, sec. 4.6.4: all up to 5 %, 0.7 at 22 %, exp(-40 / 28) at 50 %; no jumps."""
    np.testing.assert_allclose(open_share(np.array([0.97, 0.78, 0.5])), [1.0, 0.7, np.exp(-40 / 28)])
    fine = open_share(np.linspace(0, 1, 2001))
    assert np.abs(np.diff(fine)).max() < 0.03 and (np.diff(fine) >= 0).all()


def hull_file(folder, mesh, name="hull.stl"):
    mesh.export(folder / name)
    (folder / "my.yaml").write_text(yaml.safe_dump({"name": "my", "mass": 72.0, "shape": {"mesh": name}}))
    return folder / "my.yaml"


def test_everything_of_a_vehicle_follows_from_its_mesh(tmp_path):
    """Buoyancy, hull at the surface, extent, looks, prior and outline: nothing else has to be given."""
    vehicle = load_vehicle(hull_file(tmp_path, make.box(BOX)))
    box = vehicle_from_dict({"name": "my", "mass": 72.0, "shape": {"box": BOX}})
    model, other = vehicle.model(), box.model()
    for name in ("inertia", "buoyancy", "center_of_buoyancy", "quadratic_damping_ahead"):
        np.testing.assert_allclose(getattr(model, name), getattr(other, name), rtol=0.02, atol=0.02)
    np.testing.assert_allclose(model.hull.offsets, other.hull.offsets, atol=1e-6)
    np.testing.assert_allclose(bounding_box(vehicle.file), bounding_box(box.file), atol=1e-6)
    np.testing.assert_allclose(outline_of(vehicle).areas, outline_of(box).areas, rtol=1e-6)
    (piece,) = pieces_of(vehicle)
    assert piece.kind == "mesh" and piece.size[0] == 1.0
    assert prior_widths(vehicle)["added_mass.yaw"] > prior_widths(box)["added_mass.yaw"]


def test_an_identification_belongs_to_the_mesh_and_not_to_its_place(tmp_path):
    for name, size in (("a", BOX), ("b", BOX), ("c", [0.6, 0.4, 0.31])):
        (tmp_path / name).mkdir()
        hull_file(tmp_path / name, make.box(size))
    a, b, c = (fingerprint(load_vehicle(tmp_path / name / "my.yaml").file) for name in "abc")
    assert a == b != c


def test_a_shape_travels_with_a_run(tmp_path):
    (tmp_path / "run").mkdir()
    vehicle = load_vehicle(hull_file(tmp_path, make.box(BOX)))
    kept = kept_beside(json.loads(json.dumps(vehicle.to_dict())), tmp_path / "run")
    (tmp_path / "hull.stl").unlink()
    assert kept["shape"]["mesh"] == "meshes/hull.stl"
    again = vehicle_from_dict(kept, folder=tmp_path / "run")
    np.testing.assert_allclose(again.assembly.added_mass, vehicle.assembly.added_mass)


def test_a_mesh_may_be_in_a_part(tmp_path):
    hull_file(tmp_path, make.box(BOX))
    data = {"name": "v", "parts": [{"name": "rov", "part": "my", "pose": {"position": [1, 0, 0]}}]}
    assert vehicle_from_dict(data, folder=tmp_path).assembly.center_of_buoyancy[0] == pytest.approx(1.0)


def leaking():
    whole = make.box(BOX)
    return trimesh.Trimesh(whole.vertices, whole.faces[:-1])


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (leaking, r"my.yaml: shape.mesh: hull.stl: the surface is not closed: 3 open edges .*Close it in the CAD"),
        (lambda: make.box(1000 * np.array(BOX)), r"a body 600 m long, expected 0.005 to 20 m; give scale: 0.001,"),
        (lambda: make.box(100 * np.array(BOX)), r"a body 60 m long, .*; give scale: 0.01,"),
        (lambda: make.box(1e-5 * np.array(BOX)), r"a body 6e-06 m long, .*; give scale, metres per unit"),
    ],
    ids=["leaks", "millimetres", "centimetres", "tiny"],
)
def test_a_mesh_that_is_no_hull_is_named_with_the_fix(tmp_path, mesh, message):
    with pytest.raises(ConfigError, match=message):
        load_vehicle(hull_file(tmp_path, mesh()))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("empty.stl", "solid nothing\nendsolid nothing\n", "found no triangles|not readable as a mesh"),
        ("broken.stl", "no mesh at all", "found no triangles|not readable as a mesh"),
        ("hull.step", "ISO-10303-21;", r"found the ending '.step', expected one of .stl"),
    ],
)
def test_a_file_that_is_no_mesh_is_named(tmp_path, name, content, message):
    (tmp_path / name).write_text(content)
    with pytest.raises(ConfigError, match=message):
        vehicle_from_dict({"name": "v", "shape": {"mesh": name}}, folder=tmp_path)


def test_a_mesh_that_is_not_there_and_a_huge_one_are_refused(tmp_path):
    with pytest.raises(ConfigError, match=r"shape.mesh: found no.stl, but there is no file"):
        vehicle_from_dict({"name": "v", "shape": {"mesh": "no.stl"}}, folder=tmp_path)
    with (tmp_path / "huge.stl").open("wb") as file:
        file.truncate(70_000_000)
    with pytest.raises(ConfigError, match="a file of 70 MB, expected at most 60; simplify the mesh"):
        vehicle_from_dict({"name": "v", "shape": {"mesh": "huge.stl"}}, folder=tmp_path)


def test_inward_normals_are_turned_and_reported(tmp_path):
    inward = make.box(BOX)
    inward.invert()
    path = hull_file(tmp_path, inward)
    assert load_vehicle(path).assembly.volume == pytest.approx(np.prod(BOX))
    assert any("hull.stl: normals of 1 of 1 shells pointed inward: turned" in line for line in check(path).findings)


def test_shells_are_counted_and_reported(tmp_path):
    two = trimesh.util.concatenate([make.box(BOX), make.box(BOX).apply_translation([0.3, 0, 0])])
    assert any("2 shells, whose volumes are added" in line for line in check(hull_file(tmp_path, two)).findings)


def millimetres(folder, sensor, rov):
    """What is said of the scale of a vehicle with a sensor of 18 x 18 x 12 mm."""
    make.box((18, 18, 12)).export(folder / "sensor.stl")
    hull = {"name": "rov", "mass": 72.0, "shape": {"box": BOX}} | rov
    data = {"name": "v", "parts": [hull, {"name": "sensor", "shape": {"mesh": "sensor.stl"} | sensor.pop("shape", {})}]}
    data["parts"][1] |= sensor
    (folder / "v.yaml").write_text(yaml.safe_dump(data))
    return [line for line in check(folder / "v.yaml").findings if "scale: 0.001" in line]


@pytest.mark.system
@pytest.mark.parametrize(
    ("sensor", "rov", "message"),
    [
        ({"mass": 0.02}, {}, "displaces 3888000 kg of water and its mass is 0.02 kg"),
        ({}, {}, "displaces 3888000 kg of water and the whole vehicle weighs 72 kg"),
        ({}, {"mass": 1e6}, "is 18 m long and no other part is longer than 0.6 m"),
    ],
    ids=["mass", "whole", "length"],
)
def test_a_small_mesh_in_millimetres_is_reported(tmp_path, sensor, rov, message):
    (line,) = millimetres(tmp_path, dict(sensor), rov)
    assert "sensor: its mesh" in line and message in line


def test_a_mesh_with_a_scale_or_of_its_mass_is_not_doubted(tmp_path):
    assert not millimetres(tmp_path, {"shape": {"scale": 0.001}, "mass": 0.02}, {})
    assert not millimetres(tmp_path, {"mass": 3.9e6}, {})
    assert not [line for line in check(hull_file(tmp_path, make.box(BOX))).findings if "scale" in line]


def test_scale_is_for_meshes():
    with pytest.raises(ConfigError, match="found scale, which is for a mesh"):
        vehicle_from_dict({"name": "v", "shape": {"box": BOX, "scale": 0.001}})


def test_a_detailed_mesh_is_read_within_seconds_and_once(tmp_path):
    """20,000 triangles: added mass at load must not keep anybody waiting."""
    path = hull_file(tmp_path, ball(0.3, 0.2, 0.2).subdivide())
    start = time.perf_counter()
    load_vehicle(path)
    first = time.perf_counter() - start
    start = time.perf_counter()
    load_vehicle(path)
    assert first < 5.0 and time.perf_counter() - start < 0.5 * first


def test_the_panel_method_takes_a_vehicle_of_meshes_and_boxes(tmp_path):
    pytest.importorskip("capytaine", reason="needs the extra 'panel'")
    from rovtwin.identification.priors.mesh_file import mesher_of
    from rovtwin.identification.priors.panel import panel_added_mass

    hull_file(tmp_path, ball(0.3, 0.3, 0.3))
    alone = panel_added_mass(mesher_of(load_vehicle(tmp_path / "my.yaml")), panel_size=0.06)
    np.testing.assert_allclose(np.diag(alone.matrix)[:3], 2 / 3 * np.pi * 0.3**3 * 1000, rtol=0.03)
    pod = {"name": "pod", "pose": {"position": [0, 0, 0.4]}, "shape": {"box": [0.2, 0.2, 0.1]}}
    data = {"name": "v", "parts": [{"name": "rov", "part": "my"}, pod]}
    both = panel_added_mass(mesher_of(vehicle_from_dict(data, folder=tmp_path)), panel_size=0.06)
    more = np.diag(both.matrix)[:3] / np.diag(alone.matrix)[:3]
    assert (
        more.min() > 0.98 and more.max() < 1.2 and more.mean() > 1.02
    )  # a pod of a twentieth of the volume, in its lee
