"""Places and speeds of what autopilots are sent: latitude and longitude, steps of a DVL or of visual odometry."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.datum import INVERSE_FLATTENING, SEMI_MAJOR_AXIS
from rovtwin.identification.logs.readers.raw import Table

LOCKED = 3  # status of a GPS with a fix in three dimensions, ArduPilot's and MAVLink's
FEW = 5  # fixes that make no track
LONGEST_STEP = 100.0  # [s]; larger numbers are microseconds


def place_table(
    t: Float[np.ndarray, " n"], latitude: Float[np.ndarray, " n"], longitude: Float[np.ndarray, " n"]
) -> Table:
    """Columns north and east [m] from the first place, over the same clock.

    By the radii of curvature of WGS-84 at the first place: right to a millimetre over 100 m.

    Args:
        t: Times [s].
        latitude: [deg], n >= 1.
        longitude: [deg].
    """
    flattening = 1.0 / INVERSE_FLATTENING
    e2 = flattening * (2.0 - flattening)
    sine = np.sin(np.radians(latitude[0]))
    across = SEMI_MAJOR_AXIS / np.sqrt(1.0 - e2 * sine**2)
    along = across * (1.0 - e2) / (1.0 - e2 * sine**2)
    turned = (longitude - longitude[0] + 180.0) % 360.0 - 180.0
    north = along * np.radians(latitude - latitude[0])
    east = across * np.sqrt(1.0 - sine**2) * np.radians(turned)
    return Table(np.stack([north, east], axis=1), ("north", "east"), t)


def gps_table(table: Table, status: str, latitude: str, longitude: str) -> Table | None:
    """Columns north and east [m] of the readings of a GPS that have a fix; None of a few, or without a clock.

    Args:
        table: Of its messages.
        status: Name of the column that says what fix it has.
        latitude: Name of a column [deg].
        longitude: Name of a column [deg].
    """
    if table.t is None:
        return None
    fixed = table.column(status) >= LOCKED
    if fixed.sum() <= FEW:
        return None
    return place_table(table.t[fixed], table.column(latitude)[fixed], table.column(longitude)[fixed])


def speed_table(t: Float[np.ndarray, " n"], step: Float[np.ndarray, " n"], moved: Float[np.ndarray, "n 3"]) -> Table:
    """Columns u, v, w [m/s] of steps, timed in their middle; a step that took no time is left out as NaN.

    Args:
        t: End of each step [s].
        step: How long it took, in seconds or, where the median says that it cannot be those, microseconds.
        moved: By how much, b (FRD) [m].
    """
    taken = np.where(step > 0, step, np.nan)
    taken = taken * (1e-6 if np.isfinite(taken).any() and np.nanmedian(taken) > LONGEST_STEP else 1.0)
    return Table(moved / taken[:, None], ("u", "v", "w"), t - 0.5 * np.nan_to_num(taken))
