"""How far a vehicle reaches: the box around the shapes of its parts."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.description import schema
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.totals.assembly import Assembly
from rovtwin.vehicle.solids.placement import HERE, Placement


def bounding_box(body: schema.Body, least: float = 0.0) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None:
    """Lowest and highest corner in b [m] of all shapes; None where no part has one.

    `least` leaves out those with less than this share of the largest one's volume.
    """
    solids = list(_solids(body, HERE))
    most = max((solid.volume() for solid, _ in solids), default=0.0)
    found = [_extent(solid, placement) for solid, placement in solids if solid.volume() >= least * most]
    if not found:
        return None
    low, high = zip(*found, strict=True)
    return np.min(low, axis=0), np.max(high, axis=0)


def around_thrusters(total: Assembly) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]] | None:
    """The same box of the places of all thrusters, which is flat where they are level; None without thrusters."""
    found = [(one.placement, one.item) for one in total.thrusters if isinstance(one.item, schema.Thruster)]
    if not found:
        return None
    places = np.array([placement.point(np.array(thruster.position)) for placement, thruster in found])
    return places.min(axis=0), places.max(axis=0)


def _solids(body: schema.Body, placement: Placement) -> Iterator[tuple[Solid, Placement]]:
    if body.shape is not None:
        solid = Solid.of(body.shape)
        yield solid, solid.placement.after(placement)
    for part in body.parts:
        yield from _solids(part, Placement.of(part.pose.position, part.pose.attitude_deg).after(placement))


def _extent(solid: Solid, placement: Placement) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Exact for each kind of solid, whatever its attitude."""
    R, half = placement.rotation, solid.size / 2
    if solid.mesh is not None:
        corners = placement.position + solid.mesh.outline @ R.T
        return corners.min(axis=0), corners.max(axis=0)
    if solid.kind == "box":
        reach = np.abs(R) @ half
    elif solid.kind == "ellipsoid":
        reach = np.linalg.norm(R * half, axis=1)
    else:  # a cylinder along its x
        reach = np.abs(R[:, 0]) * half[0] + half[1] * np.sqrt(np.maximum(1 - R[:, 0] ** 2, 0))
    return placement.position - reach, placement.position + reach
