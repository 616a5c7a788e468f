"""Points of the floor that an imager sees, and how they answer to errors of poses, calibration and floor.

Ray in b: from the lever l along u(pixel), turned by R_bs. Ground point g = p + R (l + s d) on the floor; with
rho = R'(g - p), n the floor's normal and r = R d:

    Pi = I - r n' / (n'r)
    dg = Pi (dp - R S(rho) dtheta - R S(rho - l) dboresight + R dl + (v - R S(rho) omega) dt) + r n_z / (n'r) dh

Errors are what is true less what is stated: dp of place in n, dtheta of attitude and dboresight of the mount as small
rotations in b, dl of the lever in b, dt of the stamps (true time is stamp + dt), dh of the floor's depth. The equations
are those of direct georeferencing of line cameras (Schläpfer and Richter 2002, International Journal of Remote Sensing
23(13); Bettemir 2012, IEEE TGRS 50(3)), here derived for any floor and differentiated in closed form.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.arrays.rotations import skew
from rovtwin.imaging.floor import floor_hits
from rovtwin.mapping.georeference import LONGEST, Georeference

CALIBRATION = ("boresight_roll", "boresight_pitch", "boresight_yaw", "lever_x", "lever_y", "lever_z", "clock")
_STEP = 0.05  # for velocities by differences of poses [s]


@dataclass(frozen=True)
class GroundPoints:
    """Points seen.

    Attributes:
        t: When, by the stamps [s].
        point: n [m].
        by_pose: Derivative of north and east by errors of place (n) and attitude (b) at that time.
        by_calibration: By errors of CALIBRATION [rad, m, s].
        by_depth: By an error of the floor's depth.
        valid: Where there is a pose and the ray meets the floor; all else is zero elsewhere.
    """

    t: Float[np.ndarray, " m"]
    point: Float[np.ndarray, "m 3"]
    by_pose: Float[np.ndarray, "m 2 6"]
    by_calibration: Float[np.ndarray, "m 2 7"]
    by_depth: Float[np.ndarray, "m 2"]
    valid: Bool[np.ndarray, " m"]


def ground_points(where: Georeference, t: Float[np.ndarray, " m"], pixel: Float[np.ndarray, " m"]) -> GroundPoints:
    """Of pixels, whole numbers or between, of lines at times [s]."""
    poses = where.navigation.at(t)
    R, l = poses.rotation, where.mount.position
    offset, direction = (_between(x, pixel) @ where.mount.rotation.T for x in where.bundle)
    offset, d = offset + l, direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    r = np.einsum("mij,mj->mi", R, d)
    hits = floor_hits(where.floor, poses.position + np.einsum("mij,mj->mi", R, offset), r, LONGEST)
    valid = np.isfinite(hits.way) & poses.valid
    n, point = hits.normal, np.where(valid[:, None], hits.point, 0.0)
    rho = np.einsum("mji,mj->mi", R, point - np.where(valid[:, None], poses.position, 0.0))
    facing = np.where(valid, np.sum(n * r, axis=-1), 1.0)
    Pi = np.eye(3) - r[:, :, None] * n[:, None, :] / facing[:, None, None]
    v, omega = _rates(where, t)
    turned = R @ skew(rho)
    moving = v - np.einsum("mij,mj->mi", turned, omega)
    by_pose = np.concatenate([Pi, -Pi @ turned], axis=-1)
    by_mount = np.concatenate([-Pi @ R @ skew(rho - l), Pi @ R, (Pi @ moving[..., None])], axis=-1)
    by_depth = r * (n[:, 2] / facing)[:, None]
    cut = [np.where(valid.reshape(-1, *[1] * (x.ndim - 1)), x, 0.0)[:, :2] for x in (by_pose, by_mount, by_depth)]
    return GroundPoints(t, point, cut[0], cut[1], cut[2], valid)


def _between(rows: Float[np.ndarray, "pixel 3"], at: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
    """Rows between whole numbers; beyond the ends as if they went on."""
    k = np.clip(np.floor(at).astype(int), 0, len(rows) - 2)
    return rows[k] + (at - k)[:, None] * (rows[k + 1] - rows[k])


def _rates(
    where: Georeference, t: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 3"]]:
    """Velocity in n and angular velocity in b, zero at the ends of the navigation."""
    before, after = (where.navigation.at(t + half) for half in (-0.5 * _STEP, 0.5 * _STEP))
    turn = np.swapaxes(before.rotation, -1, -2) @ after.rotation
    omega = 0.5 * np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1) / _STEP
    known = (before.valid & after.valid)[:, None]
    return np.where(known, (after.position - before.position) / _STEP, 0.0), np.where(known, omega, 0.0)
