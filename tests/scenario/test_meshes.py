"""A run's folder with the meshes of its vehicle, moved elsewhere."""

from types import SimpleNamespace

import yaml

from rovtwin.scenario.composition import vehicle_of
from rovtwin.scenario.files import dump_scenario, load_scenario
from rovtwin.scenario.flight import scenario_to_replay
from rovtwin.vehicle import vehicle_from_dict
from rovtwin.vehicle.visuals import pieces_of

MESH = "solid {}\nendsolid\n"


def test_mesh_files_travel_with_the_run(tmp_path, monkeypatch):
    """Two files of one name, one of them used twice; the folder is moved, what they were copied from is gone."""
    garage, run, moved = tmp_path / "garage", tmp_path / "run", tmp_path / "elsewhere" / "run"
    for place in ("fore", "aft"):
        (garage / place).mkdir(parents=True)
        (garage / place / "hull.stl").write_text(MESH.format(place))
    part = {"name": "stern", "mass": 1.0, "visuals": [{"mesh": "aft/hull.stl"}, {"mesh": "fore/hull.stl"}]}
    data = {"name": "v", "mass": 10.0, "visuals": [{"mesh": "fore/hull.stl"}, {"sphere": 0.1}], "parts": [part]}
    composed = SimpleNamespace(vehicle=vehicle_from_dict(data, folder=garage))
    run.mkdir()
    (run / "scenario.yaml").write_text(dump_scenario(scenario_to_replay(load_scenario("square"), composed, run)))
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
    composed = SimpleNamespace(vehicle=vehicle_from_dict({"name": "v", "mass": 10.0}))
    scenario_to_replay(load_scenario("square"), composed, tmp_path)
    assert not list(tmp_path.iterdir())
