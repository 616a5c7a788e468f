"""The table of sensors, and that all who speak of sensors agree with it."""

from typing import get_args

import pytest

from rovtwin.core.sensors import ESSENTIAL, PLAUSIBLE, SENSORS, SHOWN_ONLY, kind_named, kind_of, names_of
from rovtwin.gnc.thesis.ekf_tuning import STATES
from rovtwin.identification.logs.record import SIGNALS
from rovtwin.scenario.schema import SensorsSection, WorldSection
from rovtwin.simulation.sensors.kinds import IDEAL, SITE
from rovtwin.vehicle.description.schema import SensorKind


@pytest.mark.parametrize("kind", SENSORS)
def test_a_second_of_a_kind_is_numbered(kind):
    names = names_of(kind, 12)
    assert names[0] == kind and names[1] == f"{kind}_2" and names[11] == f"{kind}_12"
    assert {kind_of(name) for name in names} == {kind}
    assert kind_named(names[1]) is SENSORS[kind]


def test_what_is_no_number_of_a_sensor_stays_a_name():
    assert kind_of("dvl_1") == "dvl_1" and kind_of("dvl_02") == "dvl_02" and kind_of("keel_dvl") == "keel_dvl"


def test_all_speak_of_the_same_sensors():
    assert set(IDEAL) == set(SENSORS) <= set(get_args(SensorKind))
    assert set(SENSORS) | {"preset"} == set(SensorsSection.model_fields)
    assert set(PLAUSIBLE) <= set(SENSORS) and not set(SHOWN_ONLY) & set(SENSORS)
    assert set(SITE) == {name for name, kind in SENSORS.items() if kind.world}
    assert set(STATES) <= set(SENSORS) and set(ESSENTIAL) <= set(SENSORS)
    for kind in SENSORS.values():
        assert len(kind.units) == kind.size
        assert not kind.world or len(getattr(WorldSection(), kind.world).vector)
        if kind.signal:
            fields, unit, _ = SIGNALS[kind.signal]
            assert len(fields) == kind.size and {unit} == set(kind.units)
