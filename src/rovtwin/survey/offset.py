"""Way-points of the vehicle for a way of what it sees with: an imager that does not sit at CO.

On a leg the vehicle points along it, so that the imager's path is CO's, moved by its lever. Legs on which the survey
counts are moved back by it; the others join them.
"""

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.survey.route import Path

PARALLEL = 1e-3  # sine of the angle between two legs, below which they have no corner of their own [rad]


def corners_of_co(path: Path, lever: Float[np.ndarray, "2"]) -> Float[np.ndarray, "k 2"]:
    """Where CO has to be [m], so that a place of the body follows the legs of a way that see.

    Args:
        path: Of the place.
        lever: Of the place, ahead and to the right of CO [m].
    """
    corners, sees = path.corners, _seeing(path)
    course = np.diff(corners, axis=0)
    course = course / np.linalg.norm(course, axis=1, keepdims=True)
    right = np.stack([-course[:, 1], course[:, 0]], axis=1)
    moved = course * lever[0] + right * lever[1]
    found = corners.copy()
    for i in range(len(corners)):
        legs = [leg for leg in (i - 1, i) if 0 <= leg < len(sees) and sees[leg]]
        if len(legs) == 2 and abs(right[legs[0]] @ course[legs[1]]) > PARALLEL:
            # Both legs see: the corner is where the two moved legs cross.
            required = [right[leg] @ (corners[i] - moved[leg]) for leg in legs]
            found[i] = np.linalg.solve(right[legs], required)
        elif legs:
            found[i] = corners[i] - moved[legs[0]]
    return found


def _seeing(path: Path) -> Bool[np.ndarray, " legs"]:
    """Whether a part of each leg between corners sees."""
    row, found = 0, []
    for corner in path.corners[1:]:
        begin = row
        while not np.array_equal(path.points[row], corner) or row == begin:
            row += 1
        found.append(bool(path.sees[begin:row].any()))
    return np.array(found)
