"""What an imager sees of a flat floor from a height: swath, size of pixels, and how fast it may go."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.imager import Imager, Mount

LEVELEST = 0.1  # cosine of a ray from the vertical, below which it is taken to miss the floor


@dataclass(frozen=True)
class Footprint:
    """Of a vehicle that is level but for a roll within what is allowed for.

    Attributes:
        place: Of the imager, ahead and to the right of CO [m].
        height: Of the imager over the floor [m].
        width: Seen across the course at every roll that is allowed for [m].
        middle: Of that, ahead and to the right of CO [m].
        level_width: Seen without roll [m].
        across: Size of a pixel across the course: the middle one, and the largest [m].
        along: Length that the slit's image has along the course on the floor, middle pixel [m].
    """

    place: Float[np.ndarray, "2"]
    height: float
    width: float
    middle: Float[np.ndarray, "2"]
    level_width: float
    across: tuple[float, float]
    along: float

    def square_speed(self, line_rate: float, binned: int = 1) -> float:
        """Speed at which lines are as far apart as so many pixels are wide in the middle [m/s]."""
        return self.across[0] * binned * line_rate

    def gapless_speed(self, line_rate: float, exposure: float) -> float:
        """Fastest speed at which what one line sees touches what the next one sees [m/s]; inf where it always does.

        A line sees the slit's image, drawn out by the way that is made while it collects light.
        """
        dark = 1.0 / line_rate - exposure
        return self.along / dark if dark > 1e-9 else np.inf


def footprint_of(imager: Imager, mount: Mount, altitude: float, roll: float = 0.0) -> Footprint:
    """Rays through lens and port, as mounted, to a flat floor.

    Args:
        imager: Which one.
        mount: Where it sits, see `mount_of`.
        altitude: Of CO over the floor [m].
        roll: By which the vehicle rolls at the most, either way [rad].

    Raises:
        ConfigError: The imager is at or below the floor, looks beside it, or along the course rather than across.
    """
    height = altitude - float(mount.position[2])
    if not height > 0:
        raise ConfigError(
            f"altitude: found {altitude:g} m, but {mount.name} sits {mount.position[2]:g} m below the vehicle's "
            "origin: it would be in the floor"
        )
    level = _on_floor(imager, mount, altitude, 0.0)
    _require_across(level, mount)
    edges = [np.sort(_on_floor(imager, mount, altitude, angle)[[0, -1], 1]) for angle in (-roll, 0.0, roll)]
    left, right = max(edge[0] for edge in edges), min(edge[1] for edge in edges)
    if right - left <= 0:
        raise ConfigError(
            f"roll: {np.degrees(roll):g} deg either way leave nothing of the {abs(level[-1, 1] - level[0, 1]):.2f} m "
            "that the imager sees; allow for less"
        )
    steps = np.linalg.norm(np.diff(level, axis=0), axis=1)
    middle = len(level) // 2
    slit = [_on_floor(imager, mount, altitude, 0.0, across)[middle] for across in (-0.5, 0.5)]
    ahead = float(np.interp(0.5 * (left + right), *level[np.argsort(level[:, 1])][:, ::-1].T))
    return Footprint(
        np.array(mount.position[:2], float),
        height,
        float(right - left),
        np.array([ahead, 0.5 * (left + right)]),
        float(abs(level[-1, 1] - level[0, 1])),
        (float(steps[min(middle, len(steps) - 1)]), float(steps.max())),
        float(np.linalg.norm(slit[0] - slit[1])),
    )


def _on_floor(
    imager: Imager, mount: Mount, altitude: float, roll: float, across: float = 0.0
) -> Float[np.ndarray, "pixel 2"]:
    """Where the pixels' rays meet the floor, ahead and to the right of CO [m]."""
    point, direction = imager.rays(across)
    turned = Rotation.from_euler("x", roll).as_matrix()
    begin = (mount.position + point @ mount.rotation.T) @ turned.T
    ray = direction @ mount.rotation.T @ turned.T
    if (ray[:, 2] < LEVELEST).any():
        raise ConfigError(
            f"{mount.name}: looks past the floor with some of its pixels"
            + (f" at a roll of {np.degrees(roll):.1f} deg" if roll else "")
            + "; an imager for maps looks down: its x axis is the line of sight"
        )
    return (begin + ray * ((altitude - begin[:, 2]) / ray[:, 2])[:, None])[:, :2]


def _require_across(level: Float[np.ndarray, "pixel 2"], mount: Mount) -> None:
    way = np.abs(level[-1] - level[0])
    if way[1] < 2.0 * way[0]:
        raise ConfigError(
            f"{mount.name}: its line of pixels reaches {way[0]:.2f} m ahead and {way[1]:.2f} m across: it sweeps no "
            "swath. Turn it so that its y axis is the vehicle's"
        )
