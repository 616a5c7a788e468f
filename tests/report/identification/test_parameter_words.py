"""Groups of thrusters and what teaches a parameter, in words."""

from rovtwin.identification.joint.model.catalogue import catalogue
from rovtwin.identification.joint.model.groups import thruster_groups
from rovtwin.report.identification.parameter_words import groups_in_words, what_teaches
from rovtwin.vehicle import load_vehicle


def test_every_parameter_of_a_vehicle_has_a_test_that_teaches_it():
    for name in ("gladius_mini", "double_blueye", "minerva"):
        assert all(what_teaches(p) for p in catalogue(load_vehicle(name)).names)
    assert "pull on a scale" in what_teaches("thrusters.horizontal_1.force_astern")
    assert "fast steps" in what_teaches("quadratic_damping_astern.surge")


def test_a_group_of_thrusters_names_its_members():
    vehicle = load_vehicle("gladius_mini")
    lines = groups_in_words(thruster_groups(vehicle), vehicle.thruster_names)
    assert "thrusters.horizontal: port_surge, starboard_surge" in lines
    assert "dead_band" in lines[-1] and groups_in_words({}, []) == []
