"""A vehicle that was identified, all of it."""

from pathlib import Path

import numpy as np
import yaml

from rovtwin.identification.joint.model.catalogue import catalogue
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.result.overlay import identified_file
from rovtwin.vehicle import load_vehicle

WIDTHS = {"restoring.net_buoyancy": 0.1, "restoring.center_of_buoyancy_x": 1e-3, "restoring.center_of_buoyancy_y": 1e-3}


def identified(path: Path, std: float = 0.05) -> Path:
    """The Double Blueye as in the library, factors known by `std`, net buoyancy by 0.1 N, its centre by 1 mm."""
    vehicle = load_vehicle("double_blueye")
    parameters = catalogue(vehicle)
    count = len(parameters)
    covariance = np.diag([WIDTHS.get(p.name, std) ** 2 for p in parameters.free])
    prior = Gaussian(np.zeros(count), np.eye(count))
    data = identified_file(vehicle, parameters, np.zeros(count), covariance, prior, ["learnt"] * count, [], [], {})
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path
