"""Meshes from files: what comes out, and every mistake of such files named."""

import json

import numpy as np
import pytest
from tests.identification.commands import run

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.priors.mesh_file import mesher_of_file
from rovtwin.identification.priors.panel import panel_added_mass

trimesh = pytest.importorskip("trimesh", reason="needs the extra 'panel'")
pytest.importorskip("capytaine", reason="needs the extra 'panel'")

SIZE = (0.64, 0.95, 0.354)


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    trimesh.creation.box(SIZE).export(folder / "box.stl")
    trimesh.creation.icosphere(subdivisions=3, radius=0.5).export(folder / "sphere.obj")
    trimesh.creation.icosphere(subdivisions=5, radius=0.5).export(folder / "fine.stl")
    mm = trimesh.creation.box(SIZE)
    mm.apply_scale(1000)
    mm.export(folder / "mm.stl")
    inward = trimesh.creation.box(SIZE)
    inward.invert()
    inward.export(folder / "inward.stl")
    whole = trimesh.creation.box(SIZE)
    trimesh.Trimesh(whole.vertices, whole.faces[:-1]).export(folder / "open.stl")
    (folder / "empty.stl").write_text("solid nothing\nendsolid nothing\n")
    return folder


def diagonal(path, panel_size=None):
    return np.diag(panel_added_mass(mesher_of_file(path), panel_size=panel_size).matrix)


def test_a_box_of_twelve_triangles_within_two_percent(meshes):
    np.testing.assert_allclose(diagonal(meshes / "box.stl")[:3], [114, 70, 279], rtol=0.02)


@pytest.mark.system
@pytest.mark.parametrize("name", ["sphere.obj", "fine.stl"])
def test_spheres_within_one_percent(meshes, name):
    """Coarser than the panels, and finer: merged."""
    found = panel_added_mass(mesher_of_file(meshes / name))
    np.testing.assert_allclose(np.diag(found.matrix)[:3], 2 / 3 * np.pi * 0.5**3 * 1000, rtol=0.01)
    assert set(found.priors()) == {"added_mass.surge", "added_mass.sway", "added_mass.heave"}


def test_inward_normals_are_turned_and_reported(meshes):
    found = panel_added_mass(mesher_of_file(meshes / "inward.stl"), panel_size=0.15)
    assert found.panels.volume == pytest.approx(np.prod(SIZE))
    assert (
        any("1 of 1 shells pointed inward" in note for note in found.notes) and np.linalg.eigvalsh(found.matrix)[0] > 0
    )


def shells(tmp_path, *pieces, size=0.08):
    path = tmp_path / "shells.stl"
    trimesh.util.concatenate(pieces).export(path)
    return panel_added_mass(mesher_of_file(path), panel_size=size)


def test_a_cavity_is_left_out(tmp_path, meshes):
    """The inner wall of a pressure hull: the air in it is not the water's business."""
    outer, inner = trimesh.creation.box(SIZE), trimesh.creation.box(np.array(SIZE) - 0.05)
    inner.invert()
    found = shells(tmp_path, outer, inner)
    np.testing.assert_allclose(np.diag(found.matrix), diagonal(meshes / "box.stl", 0.08))
    assert any("1 cavities" in note for note in found.notes)


def test_shells_apart_are_one_body_and_none_is_lost(tmp_path):
    one, other = (trimesh.creation.icosphere(subdivisions=3, radius=0.2) for _ in range(2))
    other.invert()
    other.apply_translation([0, 3.0, 0])
    found = shells(tmp_path, one, other, size=0.026)
    np.testing.assert_allclose(found.matrix[0, 0], 2 * 2 / 3 * np.pi * 0.2**3 * 1000, rtol=0.02)
    assert any("1 of 2 shells pointed inward" in note for note in found.notes)


def test_shells_that_run_into_each_other(tmp_path, meshes):
    """A box in two halves that overlap by 5 cm, one of them a little smaller: nearly the whole box."""
    left = trimesh.creation.box((0.64, 0.5, 0.354))
    right = trimesh.creation.box((0.63, 0.5, 0.344))
    left.apply_translation([0, -0.225, 0])
    right.apply_translation([0, 0.225, 0])
    found = shells(tmp_path, left, right)
    np.testing.assert_allclose(np.diag(found.matrix)[:3], [114, 70, 279], rtol=0.06)
    assert any("run into each other" in note for note in found.notes) and found.error[:3].min() >= 0.05


def test_frame_and_origin_place_the_body(meshes):
    """The file's y forward, x to starboard, so z up is down's minus; the origin below the middle."""
    found = mesher_of_file(meshes / "box.stl", frame=("y", "x", "-z"), origin=(0.0, 0.0, -0.1)).at(0.3, 4)
    np.testing.assert_allclose(found.size, [0.95, 0.64, 0.354])
    np.testing.assert_allclose(found.vertices[:, 2].mean(), -0.1)
    assert found.volume == pytest.approx(np.prod(SIZE))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("mm.stl", {}, "950 m long.*looks like millimetres; give --scale 0.001"),
        ("box.stl", {"scale": 1e-3}, "expected 0.02 to 20"),
        ("open.stl", {}, "not closed: 3 open edges"),
        ("empty.stl", {}, "empty.stl"),
        ("none.stl", {}, "no such file"),
        ("box.stl", {"frame": ("x", "y", "-z")}, "no right-handed frame"),
        ("box.stl", {"frame": ("x", "y", "w")}, "found 'w'"),
    ],
)
def test_mistakes_are_named(meshes, name, options, message):
    with pytest.raises(IdentificationError, match=message):
        mesher_of_file(meshes / name, **options)


def test_the_command_on_a_mesh(meshes, tmp_path, monkeypatch, capsys):
    picture, block = tmp_path / "p.png", tmp_path / "h.yaml"
    words = ("panel", meshes / "mm.stl", "--scale", 0.001, "--panel-size", "20cm", "--picture", picture, "-o", block)
    code, out, _ = run(monkeypatch, capsys, *words, "--json")
    report = json.loads(out)
    assert code == 0 and report["volume_m3"] == pytest.approx(np.prod(SIZE))
    assert report["priors"]["added_mass.heave"]["median"] == pytest.approx(report["added_mass"][2][2])
    assert picture.stat().st_size > 10_000 and block.read_text().startswith("hydrodynamics:")


def test_the_command_says_mistakes_without_a_traceback(meshes, monkeypatch, capsys):
    code, _, err = run(monkeypatch, capsys, "panel", meshes / "open.stl")
    assert code == 2 and "not closed" in err and "Traceback" not in err
    code, _, err = run(monkeypatch, capsys, "panel", meshes / "box.stl", "--frame", "x,y")
    assert code == 2 and "--frame" in err
    code, _, err = run(monkeypatch, capsys, "panel", meshes / "box.stl", "--depth", "10kg")
    assert code == 2 and "--depth" in err
    code, _, err = run(monkeypatch, capsys, "empirical", "double_blueye", "--size", "1,2")
    assert code == 2 and "--size" in err
    code, _, err = run(monkeypatch, capsys, "empirical", "bluerov2")
    assert code == 2 and "no part has a 'shape'" in err


def test_the_empirical_command_meets_the_thesis(tmp_path, monkeypatch, capsys):
    words = ("empirical", "double_blueye_thesis", "--size", "640mm,950mm,354mm")
    words += ("--areas", "0.173964,0.140366,0.301998", "-o", tmp_path / "h.yaml")
    code, out, _ = run(monkeypatch, capsys, *words)
    assert code == 0 and all(number in out for number in ("21.2", "13.3", "28.6", "1.74", "0.658", "1.5", "90.5"))
    assert "added_mass: [21.19, 13.31, 28.64, 1.744, 0.6577, 1.504]" in (tmp_path / "h.yaml").read_text()


def test_the_blocks_can_be_pasted(tmp_path, monkeypatch, capsys):
    from rovtwin.vehicle import load_vehicle

    for words in (("empirical", "double_blueye"), ("panel", "double_blueye", "--panel-size", "0.1")):
        assert run(monkeypatch, capsys, *words, "-o", tmp_path / "h.yaml")[0] == 0
        parts = "name: pasted\ndescription: d\nparts:\n  - {name: rov, part: double_blueye}\n"
        (tmp_path / "v.yaml").write_text(parts + (tmp_path / "h.yaml").read_text())
        pasted = load_vehicle(tmp_path / "v.yaml").assembly.added_mass
        assert np.linalg.eigvalsh(pasted)[0] > 0
        assert not np.allclose(pasted, load_vehicle("double_blueye").assembly.added_mass)
