"""A survey made up: lines to and fro over hills, and a stated track that errs as an AR(1) process."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from tests.imaging.helper import DOWN, imager
from tests.mapping.overlaps import Strip

from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.imaging.imager import Imager, Mount
from rovtwin.mapping.alignment.ground_points import CALIBRATION
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.navigation import Navigation

LEVER = np.array([0.1, 0.0, 0.11])
LINES, LENGTH, APART, SPEED, RATE = 4, 6.0, 1.0, 0.2, 8.0
EXACT = dict.fromkeys(CALIBRATION, 0.0)


class Hills:
    """Depth 5 m, waves of 6 cm, sloping."""

    def depth_and_slope(self, place):
        north, east = place[..., 0], place[..., 1]
        depth = 5.0 + 0.06 * np.sin(1.3 * north + 0.4) * np.cos(0.9 * east) + 0.02 * east
        slope = 0.06 * np.stack(
            [
                1.3 * np.cos(1.3 * north + 0.4) * np.cos(0.9 * east),
                -0.9 * np.sin(1.3 * north + 0.4) * np.sin(0.9 * east),
            ],
            axis=-1,
        )
        return depth, slope + np.array([0.0, 0.02])


def wide() -> Imager:
    """60 degrees in the water, 200 pixels."""
    return imager(pixels=200, port=None, lens={"field_of_view_deg": 60.0})


def course(speeds=(SPEED,)):
    """Times, places, headings; and when each line was flown."""
    t, place, yaw, lines, now = [], [], [], [], 0.0
    for k in range(LINES):
        speed = speeds[k % len(speeds)]
        along = np.arange(0.0, LENGTH, speed / RATE)
        ahead = k % 2 == 0
        north = along if ahead else LENGTH - along
        t.append(now + np.arange(len(along)) / RATE)
        place.append(np.column_stack([north, np.full_like(north, k * APART), np.full_like(north, 3.5)]))
        yaw.append(np.full(len(along), 0.0 if ahead else np.pi))
        lines.append((t[-1][0], t[-1][-1]))
        now = t[-1][-1] + 1.0  # a gap, that no spline goes round a corner
    return np.concatenate(t), np.concatenate(place), np.concatenate(yaw), lines


@dataclass
class Survey:
    truth: Georeference
    stated: Georeference
    keys: KeyFrames
    joint: JointErrors
    strips: list[Strip]
    lines: list[tuple[float, float]]

    def grid(self, every=1.5, across=5):
        t = np.concatenate([np.arange(a + 0.5, b - 0.5, every) for a, b in self.lines])
        pixel = np.linspace(2, self.truth.imager.pixels - 3, across)
        return tuple(x.ravel() for x in np.meshgrid(t, pixel, indexing="ij"))


def survey(seed=0, std=(0.06, 0.004), phi=0.97, misaligned=(0.0, 0.0, 0.0), prior=None, speeds=(SPEED,)) -> Survey:
    """Poses err by `std` [m, rad], with correlation `phi` from second to second; the stated track is what is left."""
    t, place, yaw, lines = course(speeds)
    rng = np.random.default_rng(seed)
    at = np.arange(0.0, t[-1] + 1.0)
    P = np.diag(np.r_[[std[0] ** 2] * 2, 1e-6, [std[1] ** 2] * 3])
    error = np.empty((len(at), 6))
    error[0] = rng.normal(size=6) * np.sqrt(np.diag(P))
    for k in range(1, len(at)):
        error[k] = phi * error[k - 1] + rng.normal(size=6) * np.sqrt(np.diag(P) * (1 - phi**2))
    true = np.array([Rotation.from_euler("ZYX", [y, 0.0, 0.0]).as_quat()[[3, 0, 1, 2]] for y in yaw])
    e = np.column_stack([np.interp(t, at, error[:, i]) for i in range(6)])
    turned = Rotation.from_quat(true[:, [1, 2, 3, 0]]) * Rotation.from_rotvec(-e[:, 3:])
    stated = Navigation(t, place - e[:, :3], turned.as_quat()[:, [3, 0, 1, 2]], source="smoothed")
    mount = Mount(LEVER, DOWN, "uhi.camera")
    truly = Mount(LEVER, Rotation.from_rotvec(misaligned).as_matrix() @ DOWN, "uhi.camera")
    n = len(at)
    keys = KeyFrames(
        *(at, np.zeros((n, 3)), np.zeros((n, 4)), np.tile(phi * np.eye(6), (n - 1, 1, 1)), np.tile(P, (n, 1, 1))),
        *(np.eye(6), (), np.zeros((n, 6, 0)), np.zeros(0), np.zeros(0), np.zeros((0, 0)), np.zeros(0)),
    )
    whole = Georeference(wide(), truly, Navigation(t, place, true, source="truth"), Hills())
    joint = JointErrors.of(keys, t[0], t[-1], EXACT if prior is None else prior)
    strips = [Strip(whole, a + 0.2, b - 0.2, 0.5) for a, b in lines]
    return Survey(whole, Georeference(whole.imager, mount, stated, Hills()), keys, joint, strips, lines)
