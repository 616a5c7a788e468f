"""What links and servers know of the vehicle: density of its own water, number of drones, speed."""

import pickle
from dataclasses import dataclass, field

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.links.blueye.server import BlueyeServer
from rovtwin.live import connect as live
from rovtwin.live.serving.protocols import servers_of, world_for
from rovtwin.runs.compose.composition import vehicle_of, water_density
from rovtwin.runs.pace import Clock


@dataclass
class Vehicle:
    drones: tuple[str, ...] = ("",)
    largest: dict[str, np.ndarray] = field(default_factory=lambda: {"": np.ones(6)})


@pytest.mark.system
@pytest.mark.parametrize("overrides", [[], ["world.water=1013"]])
def test_density_of_links_and_servers(overrides, monkeypatch):
    scenario = world_for("bluerov2_heavy", overrides, None)
    expected = 1013.0 if overrides else vehicle_of(scenario).assembly.density
    assert water_density(scenario) == expected
    mavlink, ros2 = servers_of(["mavlink", "ros2"], scenario, Vehicle(), {}).values()
    assert mavlink.density == expected and ros2.water.density == expected

    openers = []
    monkeypatch.setattr(
        live, "_hosted", lambda opener, scenario, stop_at: openers.append(pickle.loads(pickle.dumps(opener)))
    )
    made = {}
    monkeypatch.setattr("rovtwin.links.mavlink.link.MavlinkLink", lambda *_, **options: made.update(mavlink=options))
    monkeypatch.setattr("rovtwin.links.ros2.link.Ros2Link", lambda *_, **options: made.update(ros2=options))
    clock = Clock(4.0)
    for url in ("mavlink://udpin:127.0.0.1:14550", "ros2://rov"):
        live.connect(url, scenario, clock)
    for opener in openers:
        opener()
    assert made["mavlink"]["readings"].density == expected and made["ros2"]["water"].density == expected
    assert made["ros2"]["clock"].speed == 4.0 and "use_sim_time" not in made["ros2"]


def test_mavlink_is_for_one_drone():
    scenario, vehicle = world_for("double_blueye", [], None), Vehicle(("port", "starboard"))
    with pytest.raises(ConfigError, match=r"double_blueye is made of 2 drones \(port, starboard\).*--protocol blueye"):
        servers_of(["mavlink"], scenario, vehicle, {})


def test_blueye_knows_how_fast_the_vehicle_is():
    """Damping of the Pioneer balances its force there; a mission that asks for more is warned of."""
    scenario = world_for("blueye_pioneer", [], None)
    server = servers_of(["blueye"], scenario, Vehicle(largest={"": np.array([10.0, 5.0, 11.0, 0, 0, 0])}), {})["blueye"]
    assert isinstance(server, BlueyeServer)
    model = vehicle_of(scenario).model()
    for speed, axis, force in zip(server.reaches, (0, 2), (10.0, 11.0), strict=True):
        linear, quadratic = (float(d[axis, axis]) for d in (model.linear_damping_ahead, model.quadratic_damping_ahead))
        assert 0.3 < speed < 0.4 and linear * speed + quadratic * speed**2 == pytest.approx(force, rel=0.1)
