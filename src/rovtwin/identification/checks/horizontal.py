"""Places against the way the commands should push: north and east swapped, turned or mirrored.

The model flies the commands on its own; what it does along the body, turned by the measured attitude, must look like
the rate of the measured places. Sizes do not count: a model that is not identified yet still moves ahead when it is
pushed ahead.
"""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from rovtwin.identification.checks.findings import Finding
from rovtwin.identification.logs.motion import STEP, Motion, on_grid
from rovtwin.identification.logs.response import commanded_motion
from rovtwin.vehicle.physics.model import Model

WIDTH = 0.6  # [s] of the kernel: places are noisy
POOR, GOOD = 0.4, 0.75  # correlation with the commanded path below which it is none, from which it is one
MOVED = 0.03  # [m/s] in the root of the mean square, below which nothing is reported
# What may have happened to (north, east): undone by these matrices, the simpler ones first.
_UNDONE = {
    "north and east are swapped": [[0.0, 1.0], [1.0, 0.0]],
    "north has the wrong sign": [[-1.0, 0.0], [0.0, 1.0]],
    "east has the wrong sign": [[1.0, 0.0], [0.0, -1.0]],
    "north and east both have the wrong sign, or the heading is 180 degrees off": [[-1.0, 0.0], [0.0, -1.0]],
    "the axes are turned by 90 degrees against the heading": [[0.0, 1.0], [-1.0, 0.0]],
    "the axes are turned by -90 degrees against the heading": [[0.0, -1.0], [1.0, 0.0]],
    "north and east are swapped and both have the wrong sign": [[0.0, -1.0], [-1.0, 0.0]],
}


def check_horizontal(model: Model, motion: Motion) -> list[Finding]:
    """One finding if places go where commands cannot have pushed; nothing where too little moved to tell."""
    name = next((n for n in ("position", "horizontal") if n in motion.record.signals), None)
    if name is None or motion.rotation is None:
        return []
    signal = motion.record.signals[name]
    if len(signal.t) < 50:
        return []
    gone = on_grid(signal.t, signal.value[:, :2], motion.t, WIDTH)[1]
    pushed = _pushed(model, motion)
    good = np.isfinite(np.column_stack([gone, pushed])).all(axis=1)
    if good.sum() < 50:
        return []
    # A steady current carries the vehicle wherever it points.
    gone, pushed = (x[good] - x[good].mean(axis=0) for x in (gone, pushed))
    size = np.sqrt(np.mean(gone**2) * np.mean(pushed**2))
    if np.sqrt(np.mean(gone**2)) < MOVED or np.sqrt(np.mean(pushed**2)) < MOVED:
        return []
    scores = {mistake: float(np.mean((gone @ np.array(T).T) * pushed) / size) for mistake, T in _UNDONE.items()}
    now, best = float(np.mean(gone * pushed) / size), max(scores.values())
    if now > POOR or best < GOOD:
        return []
    mistake = next(words for words, score in scores.items() if score > best - 0.02)
    message = f"{mistake}: places follow the commands with a correlation of {best:.2f} so, of {now:.2f} as written."
    return [Finding("error", "horizontal", name, message, "Check frame (ned, enu, nwu) and the order of the columns.")]


def _pushed(model: Model, motion: Motion) -> Float[np.ndarray, "m 2"]:
    """Velocity over ground that the commands alone would give at the measured attitude [m/s]."""
    alone = commanded_motion(model, motion.record.t_command, motion.record.command)["velocity"]
    if len(alone.t) < 2 or motion.rotation is None:
        return np.full((len(motion.t), 2), np.nan)
    body = np.stack([np.interp(motion.t, alone.t, column, right=np.nan) for column in alone.value.T], axis=1)
    ground = np.einsum("nij,nj->ni", motion.rotation, body)[:, :2]
    good = np.isfinite(ground).all(axis=1)
    smooth = gaussian_filter1d(np.where(good[:, None], ground, 0.0), WIDTH / STEP, axis=0, mode="nearest")
    return np.where(good[:, None], smooth, np.nan)
