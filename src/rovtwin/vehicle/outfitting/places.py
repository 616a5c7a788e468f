"""Where foam and lead go: on the box around the hull, clear of what is on the vehicle already."""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.analysis.extent import around_thrusters, bounding_box
from rovtwin.vehicle.analysis.overlap import overlaps
from rovtwin.vehicle.description.schema import Body
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.outfitting.ballast import Piece, places_around

HULL = 0.25  # of the largest shape's volume: a smaller shape is a device on a bracket, with open water beside it
ROUNDS = 8  # how often pieces that overlap others are shifted and weighed again


def around_hull(vehicle: Vehicle) -> Float[np.ndarray, "18 3"]:
    """Places on the box around a vehicle's large shapes, else around its thrusters, in b [m].

    Raises:
        ConfigError: It has neither.
    """
    box = bounding_box(vehicle.file, HULL) or around_thrusters(vehicle.assembly)
    if box is None:
        raise ConfigError(
            f"{vehicle.where}: neither a part with a shape nor a thruster says where its outside is, to put pieces on; "
            "name places (rovtwin vehicle ballast --at x,y,z)"
        )
    return places_around(*box)


def laid_out(
    solve: Callable[[Float[np.ndarray, "k 3"]], Sequence[Piece]],
    places: Float[np.ndarray, "k 3"],
    assembled: Callable[[Sequence[Piece]], Body],
    rounds: int = ROUNDS,
) -> tuple[list[Piece], list[str]]:
    """Pieces that lie in no other part, and what to say of those that still do.

    A piece that does is shifted the least way along an axis of b that frees it, and all are weighed again.

    Args:
        solve: Pieces for places.
        places: In b [m].
        assembled: The vehicle with pieces as its last parts.
        rounds: How often pieces may be shifted; 0: not at all.

    Raises:
        ConfigError: No pieces do it.
    """
    places = np.array(places, dtype=float)
    for left in reversed(range(rounds + 1)):
        pieces = list(solve(places))
        body = assembled(pieces)
        new = {
            part.name: piece for part, piece in zip(body.parts[len(body.parts) - len(pieces) :], pieces, strict=True)
        }
        found = overlaps(body, "vehicle", new)
        if not found or not left:
            break
        for one in found:
            if one.moved in new:
                places[np.all(places == new[one.moved].position, axis=1)] = one.place
    return pieces, [one.line() for one in found]
