"""A vehicle in a few figures, beside another one's."""

import pytest

from rovtwin.runs.vehicle_figures import compared, devices_load, key_figures
from rovtwin.vehicle import list_devices, list_library, load_vehicle, summary, vehicle_from_dict


@pytest.mark.system
@pytest.mark.parametrize("name", [*list_library(), "uhi"])
def test_the_figures_are_those_of_vehicle_show(name):
    vehicle = load_vehicle(name)
    found, shown = {f.key: f.value for f in key_figures(vehicle)}, summary(vehicle)
    assert found["mass"] == pytest.approx(shown["mass_kg"])
    assert found["net_buoyancy"] == pytest.approx(shown["net_buoyancy_N"])
    assert found["metacentric_height"] == pytest.approx(1000 * shown["metacentric_height_m"])
    assert found["top_speed_sway_port"] == shown["performance"]["sway"]["port"]["top_speed_ms"]
    assert found["top_speed_yaw_port"] == pytest.approx(shown["performance"]["yaw"]["port"]["top_speed_deg_per_s"])
    if vehicle.thruster_names:
        assert found["uncontrollable"] == shown["allocation"]["uncontrollable"]
        assert 0.01 < found["position_bound_surge"] < 0.5


@pytest.mark.system
def test_endurance_is_capacity_over_load():
    figures = {f.key: f.value for f in key_figures(load_vehicle("blueye_pioneer"), 0.0)}  # neutral: no thrust at rest
    assert figures["endurance_at_rest"] == pytest.approx(75 / 20) == figures["endurance"]
    pod = {"parts": [{"name": "rov", "part": "blueye_pioneer"}, {"name": "pod", "part": "battery_pod"}]}
    longer = {f.key: f.value for f in key_figures(vehicle_from_dict({"name": "v", **pod}), 0.0)}
    assert longer["capacity"] == 75 + 266 and longer["endurance_at_rest"] > 3.5


@pytest.mark.system
def test_a_comparison_says_what_came_and_went():
    rows = {row["key"]: row for row in compared(load_vehicle("bluerov2"), load_vehicle("bluerov2_heavy"))}
    assert rows["uncontrollable"]["change"] == ["-pitch (M)"]
    assert rows["mass"]["change"] == pytest.approx(rows["mass"]["after"] - rows["mass"]["before"])
    assert all(row["change"] in (None, 0.0, []) for row in compared(*[load_vehicle("bluerov2")] * 2))


def test_devices_draw_power_without_a_battery_too():
    hull = {
        "name": "hull",
        "mass": 6.5,
        "inertia": [0.06, 0.11, 0.12],
        "volume": 0.0066,
        "shape": {"box": [0.4, 0.3, 0.2]},
    }
    bare = vehicle_from_dict({"name": "v", "parts": [hull]})
    loaded = vehicle_from_dict({"name": "v", "parts": [hull, {"name": "sonar", "mass": 0.5, "power": 20}]})
    rows = {row["key"]: row for row in compared(bare, loaded)}
    assert (rows["hotel_load"]["before"], rows["hotel_load"]["after"]) == (None, 20.0)
    assert rows["capacity"]["after"] is None and devices_load(loaded) == 20.0


def test_a_device_alone_has_no_speed_and_no_bound():
    assert "dvl_a50" in list_devices()
    figures = {f.key: f.value for f in key_figures(load_vehicle("dvl_a50"))}
    assert figures["position_bound_surge"] is None and figures["endurance"] is None


BARE = {"name": "bare", "mass": 6.0, "inertia": [0.1, 0.1, 0.1], "volume": 0.006}
BARE |= {"thrusters": [{"name": "t", "direction": [1, 0, 0], "force": 10.0}]}


def test_a_vehicle_without_drag_has_no_speed_and_says_so():
    """It was infinite, and its power nan."""
    bare = vehicle_from_dict(BARE)
    shaped = vehicle_from_dict({"name": "v", "parts": [BARE, {"name": "pod", "mass": 1.0, "shape": {"sphere": 0.06}}]})
    rows = {row["key"]: row for row in compared(bare, shaped)}
    assert rows["propulsion"]["label"] == "power of thrusters under way"
    assert rows["endurance"]["label"] == "endurance under way"
    assert (rows["propulsion"]["before"], rows["propulsion"]["after"]) == (None, None)  # both at the first's speed
    assert rows["position_bound_surge"]["why"].startswith("nothing drags it")
    assert not any("inf" in row["label"] for row in rows.values())


def test_why_there_is_no_bound():
    figures = {f.key: f for f in key_figures(load_vehicle("dvl_a50"))}
    assert "no thrusters" in figures["position_bound_surge"].why
    assert not any(f.why for f in key_figures(load_vehicle("bluerov2")))
