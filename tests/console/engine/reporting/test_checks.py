"""What the engine says of a plan: every fault, each with its way-points; what was not checked is not right."""

import pytest

from rovtwin.console.engine.reporting.checks import MOST, faults, kept, require_none
from rovtwin.core.errors import ConfigError
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.feasibility.point_numbers import counted, named
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import MissionSection, Waypoint

FENCE = "autopilot.supervisor.geofence=15"


def planned(*places, changes=(FENCE,), **values):
    scenario = load_scenario("lawnmower_calm", ["autopilot=model_based", *changes])
    points = [Waypoint(position=list(place), speed=0.2, acceptance=0.2, **values) for place in places]
    return scenario.model_copy(update={"mission": MissionSection(waypoints=points)})


def found_in(scenario, has_terrain=False):
    model = vehicle_of(scenario).model()
    return faults(scenario, scenario, model, has_terrain=has_terrain, known_world=True)


def test_every_fault_is_reported_with_its_way_point():
    found = found_in(planned((0, 0, 2), (30, 0, 2), (4, 4, 2), (2, 2, 120), (0, 20, 2)))
    assert [(one.points, one.what.split(":")[0]) for one in found] == [
        ([3], "way-point 4"), ([1], "way-point 2"), ([4], "way-point 5")
    ]  # fmt: skip
    assert "120 m deep" in found[0].what and "30.0 m from the start" in found[1].what
    with pytest.raises(ConfigError) as refused:
        require_none(found)
    assert len(str(refused.value).splitlines()) == 3


def test_walls_are_named_by_the_number_that_people_see():
    """`mission.waypoints[1]` is way-point 2."""
    tank = "world.tank={north: [-3, 8], east: [-3, 8]}"
    found = found_in(planned((0, 0, 2), (20, 0, 2), (0, 20, 2), changes=(tank,)))
    assert [one.points for one in found if "wall" in one.what] == [[1], [2]]
    assert all(one.what.startswith(f"way-point {one.points[0] + 1}: ") for one in found)


def test_a_place_to_go_to_is_called_so():
    with pytest.raises(ConfigError, match="^the place: found 50.0 m from the start"):
        require_none(found_in(planned((50, 0, 2))), "the place")


def test_many_faults_are_counted():
    found = found_in(planned(*[(30 + i, 0, 2) for i in range(30)]))
    assert len(found) == MOST + 1 and found[-1].what == "and 10 more faults, at way-points 21 to 30"
    assert {i for one in found for i in one.points} == set(range(30))


def test_nothing_to_check_against_is_not_right():
    assert kept(planned((0, 0, 2), changes=())).level == "note"
    assert kept(planned((0, 0, 2))).level == "ok"


def test_altitude_without_altimeter():
    def lacking(has_terrain):
        found = found_in(planned((0, 0, 2), altitude=1.0, changes=()), has_terrain)
        return [one.points for one in found if "there is no altimeter" in one.what]

    assert lacking(False) == [[0]] and lacking(True) == []


@pytest.mark.parametrize("points", [[0], [1, 2, 3, 8], [4, 2], list(range(40))])
def test_numbers_are_counted_and_found_again(points):
    assert named(f"the leg to {counted(points)}: too fast") == sorted(points)


def test_a_finding_names_all_way_points_that_it_is_of():
    from rovtwin.runs.feasibility.mission import judge

    scenario = planned((5, 0, 2), (5, 5, 2), (0, 5, 2), changes=())
    points = [w.model_copy(update={"speed": 3.0}) for w in scenario.waypoints]
    scenario = scenario.model_copy(update={"mission": MissionSection(waypoints=points)})
    lines = [one.line for one in judge(scenario, vehicle_of(scenario).model()) if "are requested" in one.what]
    assert lines and {i for line in lines for i in named(line)} == {0, 1, 2}
