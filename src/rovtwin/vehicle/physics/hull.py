"""Hull: where a vehicle's buoyancy sits and how far its body reaches; needed at the surface and at walls only.

The buoyancy is spread over small elements. A box is cut in four layers of four columns, the columns at the Gauss points
of the waterplane: draught, waterplane area and its second moment are exact while it floats upright. The buoyancy of a
layer that is half wet acts at the layer's middle, a 32nd of the height from where it should in the worst case.
Plain NumPy on the host but for the last step.
"""

from itertools import product
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, jnp, module_for
from rovtwin.core.types import Scalar
from rovtwin.vehicle.constants import FRESH_WATER
from rovtwin.vehicle.solids.placement import SIGNS, Box

_LAYERS = np.array([-3.0, -1.0, 1.0, 3.0]) / 8.0  # middles of the layers of a box of height 1


class Hull(eqx.Module):
    """Elements of buoyancy, and corners that touch.

    Attributes:
        offsets: Elements seen from the centre of buoyancy, b [m]; their mean weighted by `shares` is 0.
        shares: Of the whole buoyancy; they sum to 1.
        reach: Half the height over which an element goes from dry to wet [m].
        corners: Outermost points of the body seen from CO, b [m].
        radius: Beyond it from CB there is no element, and beyond it from CO no corner [m].
    """

    offsets: Float[Array, "n 3"]
    shares: Float[Array, " n"]
    reach: Float[Array, " n"]
    corners: Float[Array, "m 3"]
    radius: Scalar

    def __init__(self, offsets: Any, shares: Any, reach: Any, corners: Any):
        """The radius follows."""
        self.offsets, self.shares, self.reach, self.corners = map(as_array, (offsets, shares, reach, corners))
        xp = module_for(offsets, reach, corners)
        elements = xp.add(xp.sqrt(xp.sum(xp.square(self.offsets), axis=1)), self.reach)
        farthest = xp.sqrt(xp.max(xp.sum(xp.square(self.corners), axis=1)))
        self.radius = as_array(xp.maximum(xp.max(elements), farthest))


def hull_of(boxes: tuple[Box, ...], center_of_buoyancy: Float[np.ndarray, "3"]) -> Hull | None:
    """The hull made of the parts' boxes; those that displace no water count for contact only. None without any.

    Args:
        boxes: Seen from CO.
        center_of_buoyancy: Of the whole, b [m]. Where it is not that of the boxes (foam on top, or a value
            that was measured) the shares are tilted towards it.
    """
    wet = [box for box in boxes if box.volume > 0]
    if not wet:
        return None
    points, volumes, reach = (np.concatenate(column) for column in zip(*map(_elements, wet), strict=True))
    shares = _tilted(volumes / volumes.sum(), points, center_of_buoyancy)
    corners = np.concatenate([box.corners() for box in boxes])
    low, high = corners.min(axis=0), corners.max(axis=0)
    outermost = 0.5 * (low + high) + 0.5 * SIGNS * (high - low)
    return Hull(points - shares @ points, shares, reach, outermost)


def _tilted(
    shares: Float[np.ndarray, " n"], points: Float[np.ndarray, "n 3"], center: Float[np.ndarray, "3"]
) -> Float[np.ndarray, " n"]:
    """Shares that grow linearly towards where the centre should be; as they were where some would be negative."""
    about = points - shares @ points
    spread = (shares[:, None] * about).T @ about
    slope = np.linalg.lstsq(spread, center - shares @ points, rcond=None)[0]
    tilted = shares * (1.0 + about @ slope)
    return tilted if tilted.min() > 0 else shares


def cube(center: Any, displaced_mass: Scalar) -> Hull:
    """The hull of a vehicle whose shape nobody gave: a cube of fresh water of its displaced mass [kg] about CB (3,)."""
    side = jnp.cbrt(jnp.maximum(displaced_mass, 1e-3) / FRESH_WATER)
    where, count = jnp.asarray(_grid(2)) * side, _LAYERS.size * 4
    corners = jnp.asarray(center) + 0.5 * SIGNS * side
    return Hull(where, jnp.full(count, 1.0 / count), jnp.full(count, 0.5 / _LAYERS.size) * side, corners)


def _grid(up: int) -> Float[np.ndarray, "16 3"]:
    """Where the elements of a box of side 1 sit about its centre; `up` is its upright axis."""
    gauss = (-0.5 / np.sqrt(3.0), 0.5 / np.sqrt(3.0))
    places = [gauss, gauss, gauss]
    places[up] = tuple(_LAYERS)
    return np.array(list(product(*places)))


def _elements(box: Box) -> tuple[Float[np.ndarray, "16 3"], Float[np.ndarray, "16"], Float[np.ndarray, "16"]]:
    """Points, volumes and half heights of a box's elements."""
    R = box.placement.rotation
    up = int(np.abs(R[2]).argmax())  # the axis that is most nearly upright when the vehicle is level
    points = box.placement.position + (_grid(up) * box.size) @ R.T
    count = len(points)
    return points, np.full(count, box.volume / count), np.full(count, 0.5 / _LAYERS.size * box.size[up])
