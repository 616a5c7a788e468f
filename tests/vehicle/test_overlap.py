"""Parts in each other: said where water is counted twice, with a place that is free; nothing of what is meant so."""

import pytest

from rovtwin.vehicle import list_library, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.lint import findings
from rovtwin.vehicle.analysis.overlap import overlaps
from rovtwin.vehicle.outfitting.refit import add, trimming, with_ballast

HULL = {"mass": 14.0, "volume": 0.01415, "center_of_buoyancy": [0, 0, -0.03], "shape": {"box": [0.5, 0.4, 0.28]}}
TUBE = {"mass": 3.0, "shape": {"cylinder": {"length": 0.3, "radius": 0.06}}}


def vehicle(*parts, **hull):
    names = (f"tube_{i}" for i in range(len(parts)))
    listed = [{"name": name} | part for name, part in zip(names, parts, strict=True)]
    return vehicle_from_dict({"name": "stoat"} | hull | {"parts": listed}, "stoat.yaml")


def at(x, y, z, **more):
    return TUBE | {"pose": {"position": [x, y, z]}} | more


def lines(one):
    return [line for line in findings(one, one.model()) if "overlap" in line]


@pytest.mark.parametrize("name", list_library())
def test_there_is_no_finding_on_the_library(name):
    one = load_vehicle(name)
    assert not overlaps(one.file, one.name)


def test_share_depth_and_free_place_of_a_tube_in_a_box():
    """A tube of radius 60 mm, 20 mm above the bottom of a box: 80 mm down it is out of it."""
    (found,) = overlaps(vehicle(at(0, 0, 0.12), **HULL).file, "stoat")
    assert (found.smaller, found.larger, found.moved) == ("tube_0", "stoat", "tube_0")
    assert found.share == pytest.approx(0.708, abs=0.03)  # of a circle above a chord a third of the radius down
    assert found.depth == pytest.approx(0.08, abs=0.0015) and found.way == pytest.approx((0, 0, 0.08), abs=0.0015)
    there = vehicle(at(*found.place), **HULL)
    assert not overlaps(there.file, "stoat") and not lines(there)
    assert found.twice == "added mass and drag"  # the hull is open: 14 of its 56 l are solid


def test_buoyancy_counts_twice_where_two_solids_have_no_room():
    (line,) = lines(vehicle(at(0, 0, 0), at(0, 0.05, 0)))
    assert "'tube_0' and 'tube_1' overlap: 4" in line and "counted twice there: buoyancy, added mass and drag" in line
    assert "'tube_1' is free 70 mm further to starboard, at 0,0.12,0" in line


@pytest.mark.parametrize(
    "part, hull",
    [
        (at(0, 0, 0), HULL | {"volume": 0.0, "mass": 1.0}),  # electronics in a hull that displaces nothing
        (at(0, 0, 0, volume=0.0), HULL),
        ({"mass": 1.0, "volume": 0.001, "pose": {"position": [0, 0, 0]}}, HULL),  # no shape
        (at(0, 0, 0.21), HULL),
        (at(0, 0, 0.14), HULL),  # its middle in the face, as ballast lies
        (at(0, 0, 0), HULL | {"restoring": {"buoyancy": "neutral"}, "hydrodynamics": {
            "added_mass": [9, 20, 30, 1, 1, 1], "linear_damping": [1] * 6, "quadratic_damping": [9] * 6}}),
    ],
    ids=["no volume", "part without volume", "no shape", "outside", "on the face", "totals of the whole"],
)  # fmt: skip
def test_what_is_described_so_on_purpose_is_not_remarked(part, hull):
    assert not lines(vehicle(part, **hull))


def test_ballast_that_is_laid_on_is_no_overlap(tmp_path):
    path = tmp_path / "stoat.yaml"
    path.write_text(
        "name: stoat\nmass: 14\nvolume: 0.01415\ncenter_of_buoyancy: [0, 0, -0.03]\nshape: {box: [0.5, 0.4, 0.28]}\n"
    )
    change = add(path, "dvl_a50", [0.1, 0, 0.16], out=tmp_path / "new.yaml")
    assert not change.notes
    trimmed = with_ballast(change, trimming(change.before, change.after), tmp_path / "new.yaml")
    assert len(trimmed.after.file.parts) > 1 and not lines(trimmed.after)


def test_of_a_mesh_its_own_walls_count_and_not_the_box_around_it():
    """Between the legs of an open frame a device is free; 60 mm higher it stands in the foam."""
    between, within = (add("tilt_six", "dvl_a50", [0, 0, z]).notes for z in (0.2, 0.0))
    assert not between and "'dvl_a50' and 'tilt_six' overlap" in within[0]
