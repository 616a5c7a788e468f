"""Pushes of the dip: where they are made."""

import numpy as np
import pytest

from rovtwin.commission.dip.schedule import AWAY, LENGTHS, dive, foreseen, pulses
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.physics.thrusters import static_force


@pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "double_blueye", "no_sway"])
def test_what_floats_up_is_brought_down_before_each_push(vehicle, no_sway):
    """One that floated up within seconds was pushed at the surface, where nothing can be told."""
    own = load_vehicle(no_sway if vehicle == "no_sway" else vehicle)
    model = own.model()
    planned = pulses(model, own.thruster_names, 0.75)
    dives = [i for i, pulse in enumerate(planned) if pulse.down_to == 0.75]
    assert len(dives) == 1 + 2 * len(own.thruster_names)
    for i, pulse in enumerate(planned):
        if pulse.what.split()[0] in own.thruster_names:
            assert "rest" in planned[i - 1].what and i - 2 in dives
    down = planned[dives[0]]
    wrench = np.asarray(model.thrusters.configuration @ static_force(model.thrusters, down.command))
    assert wrench[2] > 0.0 and np.abs(np.delete(wrench, 2)).max() < 0.2 * wrench[2]
    assert wrench[2] > 3.0 * float(model.buoyancy - model.weight), "against what it floats up with"
    assert foreseen(model, down.command, LENGTHS[-1]) and AWAY < 0.5


def test_a_vehicle_that_does_not_heave_is_not_brought_down():
    thruster = {"name": "stern", "position": [-0.2, 0, 0], "direction": [1, 0, 0], "force": 10}
    hull = {"mass": 5, "volume": 0.0051, "inertia": [0.1, 0.1, 0.1], "shape": {"box": [0.4, 0.2, 0.2]}}
    vehicle = vehicle_from_dict({"name": "fish", **hull, "center_of_buoyancy": [0, 0, -0.02], "thrusters": [thruster]})
    assert dive(vehicle.model(), 0.75) is None
    assert not any(pulse.down_to for pulse in pulses(vehicle.model(), ["stern"], 0.75))
