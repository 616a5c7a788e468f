"""What a vehicle looks like: the pieces that its parts name, or else their shapes, placed in b."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rovtwin.vehicle.description import schema
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.solids.placement import HERE, Placement

_GREY = (0.55, 0.57, 0.6)


@dataclass(frozen=True)
class Piece:
    """One piece of a vehicle's looks.

    Attributes:
        name: Of its part, and its number there.
        kind: "box", "cylinder" (along x), "ellipsoid" or "mesh".
        size: Full dimensions along its own axes [m], shape (3,); of a mesh its scale, metres per unit of the file.
        placement: In b.
        colour: sRGB, shares.
        mesh: Path of its file, or "".
    """

    name: str
    kind: str
    size: np.ndarray
    placement: Placement
    colour: tuple[float, float, float]
    mesh: str = ""


def pieces_of(vehicle: Vehicle) -> list[Piece]:
    """All pieces of a vehicle; a part without visuals shows its shape, and one without that nothing."""
    return list(_pieces(vehicle.file, vehicle.name, HERE))


def _pieces(body: schema.Body, name: str, placement: Placement) -> Iterator[Piece]:
    if body.visuals:
        for i, visual in enumerate(body.visuals):
            yield _piece(visual, f"{name}_{i}", placement)
    elif body.shape is not None and body.shape.mesh is not None:
        here = Placement.of(body.shape.center, body.shape.attitude_deg).after(placement)
        yield Piece(name, "mesh", np.full(3, body.shape.scale or 1.0), here, _GREY, body.shape.mesh)
    elif body.shape is not None:
        solid = Solid.of(body.shape)
        yield Piece(name, solid.kind, solid.size, solid.placement.after(placement), _GREY)
    for part in body.parts:
        inner = Placement.of(part.pose.position, part.pose.attitude_deg).after(placement)
        yield from _pieces(part, f"{name}_{part.name}", inner)


def _piece(visual: schema.Visual, name: str, placement: Placement) -> Piece:
    here = Placement.of(visual.center, visual.attitude_deg).after(placement)
    red, green, blue = visual.colour
    if visual.mesh is not None:
        return Piece(name, "mesh", np.ones(3), here, (red, green, blue), visual.mesh)
    if visual.box is not None:
        kind, size = "box", visual.box
    elif visual.cylinder is not None:
        kind, size = "cylinder", [visual.cylinder.length, 2 * visual.cylinder.radius, 2 * visual.cylinder.radius]
    else:
        kind, size = "ellipsoid", [2 * a for a in visual.ellipsoid or [visual.sphere or 0.0] * 3]
    return Piece(name, kind, np.array(size), here, (red, green, blue))
