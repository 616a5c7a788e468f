"""Where a scenario lies on Earth, and in which water: conversions, the plant, the log."""

import json

import numpy as np
import pytest
import yaml

from rovtwin.core.datum import Datum, datum_of
from rovtwin.core.errors import ConfigError
from rovtwin.core.log import Log, export_map
from rovtwin.core.numerics import jax
from rovtwin.runs.compose.composition import compose, way_points
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import dump_scenario, load_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.water import density

OSLO = "datum={latitude: 59.9, longitude: 10.7, height: 40, utc_start: 2026-05-04T08:00:00+02:00}"


def same(a, b) -> bool:
    leaves = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(np.asarray(x).tobytes() == np.asarray(y).tobytes() for x, y in leaves)


# ---------------------------------------------------------------------------------------------------------------- datum


def test_every_scenario_has_a_datum_and_its_own_survives_writing():
    assert load_scenario("lawnmower_calm").origin == Datum()
    scenario = load_scenario("square", [OSLO])
    assert scenario.origin == Datum(59.9, 10.7, 40.0, "2026-05-04T06:00:00Z")
    assert Scenario.model_validate(yaml.safe_load(dump_scenario(scenario))) == scenario


def test_way_points_on_the_map_are_those_in_the_plane():
    plain = load_scenario("square", [OSLO])
    latitude, longitude, height = plain.origin.geodetic([w.placed(plain.origin) for w in plain.mission.waypoints])
    points = [
        {"geodetic": [float(lat), float(lon), float(40 - h)]}
        for lat, lon, h in zip(latitude, longitude, height, strict=True)
    ]
    mapped = load_scenario("square", [OSLO, f"mission.waypoints={json.dumps(points)}"])
    assert mapped.mission.waypoints[0].position is None
    model = load_vehicle("double_blueye").model()
    a, b = (np.asarray(way_points(s, model).position) for s in (plain, mapped))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-6)
    assert Scenario.model_validate(yaml.safe_load(dump_scenario(mapped))) == mapped


HERE = "[63.45001, 10.36003, 3]"


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("datum.latitude=95", "datum.latitude: found 95, expected a number of at most 90"),
        ("datum.lattitude=60", "Did you mean 'latitude'?"),
        ("datum.utc_start=2021-06-01T10:00:00", "datum.utc_start: found '2021-06-01T10:00:00' without a zone"),
        ("datum.utc_start=noon", "datum.utc_start: found 'noon', expected a time in UTC"),
        ("mission.waypoints=[{speed: 0.1}]", "found neither position nor geodetic, expected one"),
        (f"mission.waypoints=[{{position: [0, 0, 3], geodetic: {HERE}}}]", "found both position and geodetic"),
        ("mission.waypoints=[{geodetic: [63.45, 10.36]}]", "mission.waypoints[0].geodetic: found 2 values, expected 3"),
        ("mission.waypoints=[{geodetic: [163, 10, 3]}]", "found latitude 163: expected degrees between -90 and 90"),
        ("mission.waypoints=[{geodetic: [63.45, 10.36, -1]}]", "expected a depth of at least 0"),
        ("mission.waypoints=[{geodetic: [63.45, 10.36, 300]}]", "is 300 m deep, where the supervisor aborts"),
        ("mission.waypoints=[{geodetic: [10.36, 63.45, 3]}]", "expected at most 10 km: swap latitude and longitude"),
        (f"mission.waypoints=[{{geodetic: {HERE}}}, {{geodetic: [59.9, 10.7, 3]}}]",
         "mission.waypoints[1].geodetic: 59.9, 10.7 is 396 km from the datum (63.45, 10.36), expected at most 10 km"),
    ],
)  # fmt: skip
def test_a_place_that_cannot_be_meant(override, expected):
    with pytest.raises(ConfigError) as error:
        load_scenario("square", [override])
    assert expected in str(error.value)


# ---------------------------------------------------------------------------------------------------------------- water


@pytest.mark.parametrize(
    ("water", "expected"),
    [("sea", 1025.0), ("fresh", 1000.0), ("1012", 1012.0), ("{density: 1012}", 1012.0),
     ("12C 34", density(12, 34)), ("{temperature: 12, salinity: 34}", density(12, 34))],
)  # fmt: skip
def test_water_in_its_short_and_long_forms(water, expected):
    scenario = load_scenario("square", [f"world.water={water}"])
    assert scenario.world.water is not None and scenario.world.water.kg_per_m3 == expected
    assert Scenario.model_validate(yaml.safe_load(dump_scenario(scenario))) == scenario


@pytest.mark.parametrize(
    ("water", "expected"),
    [
        ("salt", "world.water: water 'salt': expected fresh, sea"),
        (
            "1.025",
            "world.water: water density 1.025 kg/m3, expected 900 to 1100 (fresh 1000, sea 1025). Is it in g/cm3",
        ),
        ("{temperature: 12}", "found temperature, expected either density, or temperature and salinity"),
        ("{}", "found nothing, expected either density"),
        ("{temperature: -4, salinity: 34}", "temperature -4 deg C: expected -1.9 (it freezes) to 40"),
        ("{temperature: 4, salinity: 340}", "salinity 340: expected practical salinity from 0 (fresh) to 42"),
        ("{temprature: 4}", "Did you mean 'temperature'?"),
        ("[1]", "world.water: found a list of 1 value"),
    ],
)
def test_water_that_is_none(water, expected):
    with pytest.raises(ConfigError) as error:
        load_scenario("square", [f"world.water={water}"])
    assert expected in str(error.value)


def test_without_water_the_plant_is_the_model_bit_for_bit():
    simulation = compose(load_scenario("lawnmower_calm"))
    assert same(simulation.loop.twin.model, load_vehicle("double_blueye").model())
    fresh = compose(load_scenario("lawnmower_calm", ["world.water=fresh"]))
    assert same(fresh.loop.twin.model, simulation.loop.twin.model)  # what the file is written for


def test_water_is_the_plants_and_not_the_autopilots():
    simulation = compose(load_scenario("lawnmower_calm", ["world.water={temperature: 5, salinity: 35}"]))
    plant, vehicle = simulation.loop.twin.model, load_vehicle("double_blueye")
    assert same(simulation.model, vehicle.model()) and same(plant, vehicle.model(water_density=density(5, 35)))
    assert float(plant.buoyancy - simulation.model.buoyancy) == pytest.approx(8.0, abs=0.2)


def test_water_mismatch_and_net_buoyancy_add_up():
    """Buoyancy: ratio of densities, times the factor on masses, plus the net buoyancy; the draws stay the seed's."""
    changes = ["world.mismatch=true", "world.net_buoyancy=2"]
    dry = compose(load_scenario("lawnmower_calm", changes)).loop.twin.model
    wet = compose(load_scenario("lawnmower_calm", [*changes, "world.water=sea"])).loop.twin.model
    weight = float(load_vehicle("double_blueye").model().weight)
    assert float(dry.buoyancy - dry.weight) == pytest.approx(2.0)
    assert float(wet.buoyancy - wet.weight) == pytest.approx(2.0 + 1.10 * 0.025 * weight)
    np.testing.assert_allclose(wet.added_mass, 1.025 * dry.added_mass, rtol=1e-12)
    np.testing.assert_allclose(wet.damping, 1.025 * dry.damping, rtol=1e-12)
    np.testing.assert_array_equal(wet.rigid_body_mass, dry.rigid_body_mass)


# --------------------------------------------------------------------------------------------------------------- flight


@pytest.mark.slow
def test_a_flight_at_sea_with_a_way_point_on_the_map(tmp_path):
    """The filter finds the 8 N; the log knows where it is, and opens as a map."""
    target = "mission.waypoints=[{geodetic: [59.90002, 10.70004, 3]}]"
    changes = [OSLO, target, "world.water=5C 35", "autopilot=thesis_placed", "duration=30"]
    flight = fly(load_scenario("square", changes), tmp_path / "run")
    assert flight.log["autopilot/bias"]["Z"][-1] == pytest.approx(-8.1, abs=1.5)  # n: up is negative
    log = Log.read(tmp_path / "run" / "log.mcap")
    datum = datum_of(log.metadata)
    assert datum == Datum(59.9, 10.7, 40.0, "2026-05-04T06:00:00Z")
    (point,) = json.loads(log.metadata["mission"])
    np.testing.assert_allclose(point["position"], datum.position(59.90002, 10.70004, 3.0), rtol=0, atol=1e-9)
    found = json.loads(export_map(log, tmp_path / "track.geojson").read_text())["features"]
    assert [f["properties"]["name"] for f in found] == ["truth", "estimate", "1"]
    np.testing.assert_allclose(found[2]["geometry"]["coordinates"], [10.70004, 59.90002, 37.0], rtol=0, atol=1e-8)
    assert found[0]["properties"]["utc_start"] == "2026-05-04T06:00:00.000Z"
