"""A vehicle file with an `identified:` block, for tests."""

from pathlib import Path

import numpy as np
import yaml

from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.groups import thruster_groups
from rovtwin.identification.joint.model.parameters import Parameter, Parameters
from rovtwin.identification.joint.result.overlay import identified_file
from rovtwin.vehicle import load_vehicle


def identified_vehicle(path: Path, share: float = 1.0) -> Path:
    """The Double Blueye with surge's added mass known to 10 % and its quadratic drag to 20 %, correlated by 0.5.

    `share` makes both standard deviations smaller.
    """
    vehicle = load_vehicle("double_blueye")
    model = vehicle.model()
    free = (
        Parameter.at("added_mass.surge", "kg", float(model.added_mass[0, 0]), True),
        Parameter.at("quadratic_damping.surge", "N s2/m2", float(model.quadratic_damping_ahead[0, 0]), True),
    )
    parameters = Parameters(model, free, thruster_groups(vehicle))
    covariance = share**2 * np.array([[0.01, 0.01], [0.01, 0.04]])
    prior = Gaussian(np.zeros(2), np.eye(2))
    data = identified_file(vehicle, parameters, np.zeros(2), covariance, prior, ["known"] * 2, [], [], {})
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path
