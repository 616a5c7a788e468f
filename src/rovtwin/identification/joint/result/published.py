"""Which published totals count when parts change: those of parts that come or go, none of what stays.

What was identified of the old vehicle stays under the change, so that totals of the vehicle, and of every body of which
something stays, are left out of both trees: what stays cancels, and what formulas say of the rest adds up. A part that
comes or goes brings or takes what its own file says of it.
"""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np

from rovtwin.vehicle.description.identified import without_remarks
from rovtwin.vehicle.description.schema import Body
from rovtwin.vehicle.description.totals.assembly import bodies
from rovtwin.vehicle.solids.placement import HERE, Placement

_TOTALS = ("rigid_body", "restoring", "hydrodynamics")
_OWN = {"mass", "center_of_gravity", "inertia", "shape", "volume", "center_of_buoyancy", *_TOTALS}


def trees_to_compare(old: Body, new: Body) -> tuple[Body, Body]:
    """The trees without totals of the vehicle itself and of bodies of which something is in both."""
    common = Counter(_keys(old, HERE)) & Counter(_keys(new, HERE))
    first, second = (_stripped(body, HERE, Counter(common), _thrusters(body))[0] for body in (old, new))
    none: dict[str, Any] = {key: None for key in (*_TOTALS, "identified")}
    return first.model_copy(update=none), second.model_copy(update=none)


def _stripped(body: Body, place: Placement, common: Counter[str], all_thrusters: int) -> tuple[Body, bool]:
    """The body without the totals that do not count, and whether something of it is in both trees.

    `common` loses what is found. What holds all thrusters is the vehicle, whatever its new file says of it.
    """
    key = _key(body, place)
    stays = common[key] > 0
    common[key] -= stays
    parts = []
    for part in body.parts:
        inner, inner_stays = _stripped(part, _placed(part, place), common, all_thrusters)
        parts.append(inner)
        stays = stays or inner_stays
    vehicle = 0 < all_thrusters == _thrusters(body)
    return body.model_copy(update={"parts": parts} | (dict.fromkeys(_TOTALS) if stays or vehicle else {})), stays


def _keys(body: Body, place: Placement) -> Iterator[str]:
    """Of all bodies that say something of themselves; a mere group of parts does not."""
    if key := _key(body, place):
        yield key
    for part in body.parts:
        yield from _keys(part, _placed(part, place))


def _key(body: Body, place: Placement) -> str:
    """The same of two bodies with the same place and values; "" of one without values."""
    own = without_remarks(body.model_dump(mode="json", include=_OWN, exclude_defaults=True))
    where = np.round(np.concatenate([place.position, place.rotation.ravel()]), 9) + 0.0  # no -0.0
    return json.dumps([own, where.tolist()], sort_keys=True) if own else ""


def _placed(part: Any, place: Placement) -> Placement:
    return Placement.of(part.pose.position, part.pose.attitude_deg).after(place)


def _thrusters(body: Body) -> int:
    return sum(len(one.thrusters) for _, one in bodies(body, ""))
