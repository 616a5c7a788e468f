"""A fence that is drawn: what is one, which legs leave it, and that the supervisor watches it without compiling."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.console.engine.test_engine import armed, engine  # noqa: F401  (a fixture)

pytest.importorskip("zmq", reason="the console needs pyzmq: pip install 'rovtwin[console]'")

from rovtwin.console.engine.fence import fault_of, legs_outside, padded, with_fence
from rovtwin.console.engine.helm import Helm
from rovtwin.console.engine.reporting.checks import faults
from rovtwin.console.orders import MOST_CORNERS, parse
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import GEOFENCE
from rovtwin.core.numerics import as_array
from rovtwin.gnc.safety.rules import inside
from rovtwin.runs.compose.composition import compose, vehicle_of
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema import MissionSection, Waypoint

# Like an L: north of 4 only as far east as 4.
L_SHAPE = [[0, 0], [8, 0], [8, 4], [4, 4], [4, 8], [0, 8]]
AWAY = [[50, 50], [60, 50], [60, 60], [50, 60]]


@given(st.tuples(st.floats(-1, 9), st.floats(-1, 9)))
@settings(max_examples=30, deadline=None)
def test_repeated_corners_change_nothing(place):
    corners = padded(L_SHAPE)
    assert corners.shape == (MOST_CORNERS, 2)
    assert bool(inside(as_array(corners), as_array(place))) == bool(inside(as_array(L_SHAPE), as_array(place)))
    assert inside(as_array(padded(None)), as_array(np.array(place) * 1e4))


@pytest.mark.parametrize(
    ("polygon", "fault"),
    [
        (L_SHAPE, ""),
        ([[0, 0], [8, 8], [8, 0], [0, 8]], "crosses itself"),
        ([[0, 0], [0.1, 0], [0.1, 0.1]], "area of 0.005 m"),
        (AWAY, "north 1.0 m, east 2.0 m, outside of it"),
    ],
)
def test_what_is_no_fence_is_refused_in_words(polygon, fault):
    found = fault_of(polygon, np.array([1.0, 2.0]))
    assert found == fault if not fault else fault in found


def test_a_leg_that_cuts_a_corner_is_a_fault_though_its_ends_are_inside():
    places = np.array([[7.0, 1.0], [1.0, 1.0], [1.0, 7.0], [7.0, 2.0]])
    assert legs_outside(np.array(L_SHAPE, float), places) == [3]
    points = [Waypoint(position=[float(x), float(y), 2.0]) for x, y in places]
    scenario = with_fence(load_scenario("lawnmower_calm"), [[float(v) for v in corner] for corner in L_SHAPE])
    scenario = scenario.model_copy(update={"mission": MissionSection(waypoints=points)})
    model = vehicle_of(scenario).model()
    (found,) = faults(scenario, scenario, model, has_terrain=False, known_world=False)
    assert found.points == [3] and "leaves the fence" in found.what
    # And where the legs keep inside, nothing is found: the same without the last.
    kept = scenario.model_copy(update={"mission": MissionSection(waypoints=points[:3])})
    assert faults(kept, kept, model, has_terrain=False, known_world=False) == []


@pytest.mark.parametrize(
    "corners",
    [[[0, 0], [1, 1]], [[0, 0]] * (MOST_CORNERS + 1), [[0, 0], [1, "1"], [2, 0]], [[0, 0], [1, 1e9], [2, 0]], 7],
)
def test_corners_that_are_none_never_reach_the_engine(corners):
    with pytest.raises(ValueError, match="fence"):
        parse({"do": "fence", "corners": corners})
    assert parse({"do": "fence"}).corners is None


def test_a_fence_is_not_changed_while_the_vehicle_is_armed(engine):  # noqa: F811
    armed(engine)
    with pytest.raises(ConfigError, match="disarm first"):
        engine.set_fence(engine.session.helm, L_SHAPE)


@pytest.mark.system
def test_the_supervisor_watches_the_fence_that_is_drawn():
    """Of a vehicle that stands still at the start: within, outside, and with none again."""
    scenario = load_scenario("square", ["autopilot=thesis"])
    helm = Helm(compose(scenario), scenario)
    here = np.asarray(scenario.start.position[:2])

    def outside_for(polygon) -> float:
        helm.fence(polygon)
        helm.start()
        for _ in range(20):
            helm.tick([], (0.0, 0.0, 0.0))
        return float(helm._host.memory.supervisor.watch.lasting[GEOFENCE])

    around = (here + np.array([[-5, -5], [5, -5], [5, 5], [-5, 5]])).tolist()
    assert outside_for(around) == 0.0
    assert outside_for(AWAY) == pytest.approx(20 * scenario.control_dt, rel=1e-3)
    assert outside_for(None) == 0.0
