"""A run's folder with the meshes of its vehicle and the scene of its cameras, moved elsewhere."""

from types import SimpleNamespace

import pytest
import yaml

from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.recording.provenance import scenario_to_replay
from rovtwin.scenario.assets import kept_beside
from rovtwin.scenario.files import dump_scenario, load_scenario
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import vehicle_from_dict
from rovtwin.vehicle.analysis.visuals import pieces_of

MESH = "solid {}\nendsolid\n"


def test_mesh_files_travel_with_the_run(tmp_path, monkeypatch):
    """Two files of one name, one of them used twice; the folder is moved, what they were copied from is gone."""
    garage, run, moved = tmp_path / "garage", tmp_path / "run", tmp_path / "elsewhere" / "run"
    for place in ("fore", "aft"):
        (garage / place).mkdir(parents=True)
        (garage / place / "hull.stl").write_text(MESH.format(place))
    part = {"name": "stern", "mass": 1.0, "visuals": [{"mesh": "aft/hull.stl"}, {"mesh": "fore/hull.stl"}]}
    data = {"name": "v", "mass": 10.0, "visuals": [{"mesh": "fore/hull.stl"}, {"sphere": 0.1}], "parts": [part]}
    simulation = SimpleNamespace(vehicle=vehicle_from_dict(data, folder=garage))
    run.mkdir()
    (run / "scenario.yaml").write_text(dump_scenario(scenario_to_replay(load_scenario("square"), simulation, run)))
    vehicle = yaml.safe_load((run / "scenario.yaml").read_text())["vehicle"]
    assert [v.get("mesh") for v in vehicle["visuals"]] == ["meshes/hull.stl", None]
    assert [v.get("mesh") for v in vehicle["parts"][0]["visuals"]] == ["meshes/hull_1.stl", "meshes/hull.stl"]

    moved.parent.mkdir()
    run.rename(moved)
    for file in garage.rglob("*.stl"):
        file.unlink()
    monkeypatch.chdir(tmp_path)
    pieces = pieces_of(vehicle_of(load_scenario(moved / "scenario.yaml")))
    found = [open(piece.mesh).read() for piece in pieces if piece.kind == "mesh"]
    assert found == [MESH.format(place) for place in ("fore", "aft", "fore")]


def test_a_run_without_meshes_has_no_folder_for_them(tmp_path):
    simulation = SimpleNamespace(vehicle=vehicle_from_dict({"name": "v", "mass": 10.0}))
    scenario_to_replay(load_scenario("square"), simulation, tmp_path)
    assert not list(tmp_path.iterdir())


def pool(folder, *meshes):
    """A scenario file in a folder, its cameras in a scene beside it that has these mesh files."""
    folder.mkdir(parents=True)
    objects = [{"name": f"thing {k}", "mesh": {"file": mesh}} for k, mesh in enumerate(meshes)]
    scene = {"name": "ours", "tank": {"length": 8, "width": 4, "depth": 2}, "objects": objects}
    (folder / "our_pool.yaml").write_text(yaml.safe_dump(scene))
    flown = {"mission": "square", "cameras": [{"scene": "our_pool.yaml"}, {"scene": "pool", "camera": "port.camera"}]}
    (folder / "flown.yaml").write_text(yaml.safe_dump(flown))
    return folder / "flown.yaml"


def test_the_scene_of_the_cameras_travels_with_the_run(tmp_path, monkeypatch):
    """It is found beside the scenario, from wherever that is flown; a copy of a copy is the same again."""
    garage, run, moved = tmp_path / "garage", tmp_path / "run", tmp_path / "elsewhere" / "run"
    scenario = load_scenario(pool(garage, "hull.stl", "../hull.stl"))
    (garage / "hull.stl").write_text(MESH.format("near"))
    (tmp_path / "hull.stl").write_text(MESH.format("far"))
    simulation = SimpleNamespace(vehicle=vehicle_from_dict({"name": "v", "mass": 10.0}))
    run.mkdir()
    (run / "scenario.yaml").write_text(dump_scenario(scenario_to_replay(scenario, simulation, run)))

    moved.parent.mkdir()
    run.rename(moved)
    for file in (garage / "hull.stl", tmp_path / "hull.stl", garage / "our_pool.yaml"):
        file.unlink()
    monkeypatch.chdir(tmp_path)
    again = load_scenario(moved / "scenario.yaml")
    assert again.cameras[1].scene == "pool"  # of the library: every rovtwin has it
    scene = load_scene(again.cameras[0].scene)
    assert scene.file.tank.length == 8
    assert [(scene.folder / item.mesh.file).read_text() for item in scene.file.objects] == [
        MESH.format(place) for place in ("near", "far")
    ]
    (tmp_path / "third").mkdir()
    third = scenario_to_replay(again, simulation, tmp_path / "third")
    assert third.cameras[0].scene == "scenes/our_pool.yaml"
    assert (tmp_path / "third" / "scenes" / "our_pool.yaml").read_text() == (
        moved / "scenes" / "our_pool.yaml"
    ).read_text()


def test_a_scene_without_one_of_its_meshes_is_named(tmp_path):
    scenario = load_scenario(pool(tmp_path / "garage", "gone.stl"))
    simulation = SimpleNamespace(vehicle=vehicle_from_dict({"name": "v", "mass": 10.0}))
    with pytest.raises(ConfigError, match=r"our_pool.yaml: .*found file gone.stl, but there is no file .*garage/gone"):
        scenario_to_replay(scenario, simulation, tmp_path)


def test_copies_of_copies_do_not_overwrite_each_other(tmp_path):
    """A file that is written again where it was read from, and one that takes the other's name."""
    (tmp_path / "meshes").mkdir()
    (tmp_path / "new").mkdir()
    (tmp_path / "meshes" / "hull.stl").write_text("old")
    (tmp_path / "new" / "hull.stl").write_text("new")
    visuals = [{"mesh": str(tmp_path / place / "hull.stl")} for place in ("new", "meshes")]
    kept = kept_beside({"visuals": visuals}, tmp_path)
    assert [(tmp_path / v["mesh"]).read_text() for v in kept["visuals"]] == ["new", "old"]
