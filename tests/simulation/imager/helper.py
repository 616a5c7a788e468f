"""A flat bottom, a straight path, and an imager that looks down."""

from typing import Any

import numpy as np
from tests.imaging.helper import DOWN, imager

from rovtwin.imaging.imager import Mount
from rovtwin.imaging.path import PosePath
from rovtwin.simulation.imager.scan import Scan
from rovtwin.simulation.scene import Scene, scene_from_dict

LAMP = {"name": "one", "position": [0.0, 0.3, 0.0], "beam_deg": 70.0, "radiant_flux": 10.0, "temperature": 3000.0}


def flat(light: float = 0.0, objects: Any = (), material: str = "white_50", **bottom: Any) -> Scene:
    """White bottom at 5 m in coastal water."""
    surface = {"material": material, "texture": "plain"}
    return scene_from_dict(
        {
            "name": "flat",
            "water": {"constituents": {}},
            "bottom": {"depth": 5.0, "surface": surface} | bottom,
            "objects": list(objects),
            "light": {"surface": light},
        }
    )


def path(euler: Any = (0.0, 0.0, 0.0), seconds: float = 4.0) -> PosePath:
    """North at 0.2 m/s, 1.6 m above 5 m."""
    t = np.arange(0.0, seconds, 0.1)
    eta = np.column_stack([0.2 * t, 0.3 + 0 * t, 3.4 + 0 * t, np.tile(euler, (len(t), 1))])
    return PosePath.of(t, eta)


def scan(scene: Scene | None = None, lines: int = 40, euler: Any = (0.0, 0.0, 0.0), **given: Any) -> Scan:
    mount = Mount(np.array([0.05, 0.0, 0.1]), DOWN)
    t = 0.1 + 0.05 * np.arange(lines)
    return Scan(imager(**given), mount, path(euler), scene or flat(), t, 3)
