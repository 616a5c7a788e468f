"""Printed square markers (ArUco): where they hang, and where their corners are.

The marker frame `m` is OpenCV's: x to the right and y up on the printed face, z out of it towards who looks at it.
Corners come in OpenCV's order: top left, top right, bottom right, bottom left, as seen on an upright print.
"""

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import Degrees, Number, Positive, Strict, Vector3, parse
from rovtwin.core.user_files.yamlfile import read_yaml
from rovtwin.core.vision import opencv

CORNERS = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])  # of unit size, in m
DICTIONARIES = tuple(f"DICT_{n}X{n}_{k}" for n in (4, 5, 6, 7) for k in (50, 100, 250, 1000))


class Marker(Strict):
    """One marker. Upright on a wall; flat on the floor or under a ceiling its top points north; `roll_deg` turns it."""

    id: Annotated[int, Field(ge=0, strict=True)]
    size: Positive = Field(description="side of the black square [m]")
    position: Vector3 = Field(description="of its middle, n [m]")
    faces: Vector3 = Field(description="direction out of the printed face, n: [-1, 0, 0] looks south, [0, 0, -1] up")
    roll_deg: Degrees = Field(0.0, description="turned on its wall, counter-clockwise for who looks at it")

    @model_validator(mode="after")
    def _some_direction(self) -> "Marker":
        if not any(self.faces):
            raise ValueError("faces: found [0, 0, 0], expected a direction")
        return self

    @property
    def R_nm(self) -> np.ndarray:
        """Maps m to n, shape (3, 3)."""
        z = np.array(self.faces) / np.linalg.norm(self.faces)
        up = np.array([0.0, 0.0, -1.0]) if abs(z[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
        y = up - (up @ z) * z
        y /= np.linalg.norm(y)
        x = np.cross(y, z)
        c, s = math.cos(math.radians(self.roll_deg)), math.sin(math.radians(self.roll_deg))
        return np.column_stack([c * x + s * y, c * y - s * x, z])

    @property
    def corners(self) -> np.ndarray:
        """In n [m], shape (4, 3)."""
        return np.array(self.position) + self.size * CORNERS @ self.R_nm.T


class Layout(Strict):
    """Which markers hang in a test, and of which dictionary."""

    dictionary: str = Field("DICT_4X4_50", description="of OpenCV's, " + ", ".join(DICTIONARIES[:4]) + " ..")
    markers: list[Marker] = []
    scale_std: Annotated[Number, Field(ge=0, lt=0.2)] = Field(
        default=0.005,
        description="how well its lengths are known, sides and places alike: one standard deviation, a share",
    )

    @model_validator(mode="after")
    def _each_once(self) -> "Layout":
        if self.dictionary not in DICTIONARIES:
            raise ValueError(f"dictionary: found {self.dictionary!r}, expected one of {', '.join(DICTIONARIES)}")
        highest = int(self.dictionary.rpartition("_")[2])
        ids = [marker.id for marker in self.markers]
        for number in ids:
            if number >= highest:
                raise ValueError(f"found marker {number}, but {self.dictionary} ends with {highest - 1}")
            if ids.count(number) > 1:
                raise ValueError(f"found marker {number} {ids.count(number)} times, expected each id once")
        return self


def pattern(dictionary: str, number: int) -> np.ndarray:
    """Cells of a marker with its black border, rows from the top, shape (n, n), True is black.

    Raises:
        ConfigError: OpenCV, which knows the patterns, is not installed.
    """
    cv2 = opencv("drawing markers")
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    return cv2.aruco.generateImageMarker(known, number, known.markerSize + 2, borderBits=1) < 128


def read_layout(path: Any) -> Layout:
    """A layout from a YAML file.

    Raises:
        ConfigError: It cannot be read, or says something that cannot be.
    """
    data = read_yaml(path)
    if not data:
        raise ConfigError(f"{path}: is empty, expected 'markers:' with a list of id, size, position and faces")
    return parse(Layout, data, str(path))
