"""What overlaps and known points say: one feature in two lines, a feature in a line at a place that was surveyed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import csr_array, vstack

from rovtwin.core.errors import LogError
from rovtwin.mapping.alignment.ground_points import ground_points
from rovtwin.mapping.alignment.joint import JointErrors
from rovtwin.mapping.georeference import Georeference


@dataclass(frozen=True)
class Ties:
    """Features that two lines saw.

    Attributes:
        t: Stamps of the two lines [s].
        pixel: In each, whole numbers or between.
        covariance: Of how far apart the two may be taken, on the floor, north and east [m2].
        quality: From 0 to 1, such as a correlation.
        untried: Patches of the overlaps that were not looked for, as there were more than are tried.
    """

    t: Float[np.ndarray, "m 2"]
    pixel: Float[np.ndarray, "m 2"]
    covariance: Float[np.ndarray, "m 2 2"]
    quality: Float[np.ndarray, " m"]
    untried: int = 0

    def chosen(self, which: Bool[np.ndarray, " m"]) -> "Ties":
        """Some of them."""
        return Ties(self.t[which], self.pixel[which], self.covariance[which], self.quality[which], self.untried)


@dataclass(frozen=True)
class ControlPoints:
    """Features of lines whose place is known.

    Attributes:
        t: Stamp of the line that saw each [s].
        pixel: In it.
        place: North and east [m].
        std: Of place and of picking the pixel together [m].
        names: For reports.
    """

    t: Float[np.ndarray, " c"]
    pixel: Float[np.ndarray, " c"]
    place: Float[np.ndarray, "c 2"]
    std: Float[np.ndarray, " c"]
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Observations:
    """Measured differences of north and east, d = H e + noise, two rows each.

    Attributes:
        d: What is measured less what the stated poses say [m].
        H: Derivative by the errors.
        R: Covariance of the noise of each pair of rows [m2].
        ends: North and east [m] where each of the two lines of a tie puts the feature; of a control point where its
            line does, and where it is.
        t: Stamps of the two lines [s]; the second of a control point is no number.
        pixel: In each, likewise.
        names: Of each: `tie 3`, `point A`.
    """

    d: Float[np.ndarray, "m 2"]
    H: csr_array
    R: Float[np.ndarray, "m 2 2"]
    ends: Float[np.ndarray, "m 2 2"]
    t: Float[np.ndarray, "m 2"]
    pixel: Float[np.ndarray, "m 2"]
    names: tuple[str, ...]

    @property
    def place(self) -> Float[np.ndarray, "m 2"]:
        """Where on the floor, north and east [m]."""
        return self.ends.mean(axis=1)

    def chosen(self, which: Bool[np.ndarray, " m"]) -> "Observations":
        """Some of them."""
        names = tuple(name for name, kept in zip(self.names, which, strict=True) if kept)
        rows = (self.ends[which], self.t[which], self.pixel[which])
        return Observations(self.d[which], self.H[np.repeat(which, 2)], self.R[which], *rows, names)


def observe(
    joint: JointErrors,
    where: Georeference,
    ties: Ties,
    control: ControlPoints | None = None,
    depth_std: float = 0.0,
) -> Observations:
    """Ties and control points as measurements of the errors.

    Args:
        joint: Whose errors.
        where: Imager, mount, poses and floor as stated.
        ties: Between lines.
        control: Known points.
        depth_std: Of the floor's depth [m]: the same for the two lines of a tie, which see it from two sides.

    Raises:
        LogError: A control point is seen by no ray.
    """
    one, other = (ground_points(where, ties.t[:, k], ties.pixel[:, k]) for k in range(2))
    good = one.valid & other.valid & np.isfinite(ties.covariance).all(axis=(1, 2))
    good &= joint.covers(ties.t).all(axis=1)
    f = (one.by_depth - other.by_depth) * depth_std
    R = ties.covariance + f[:, :, None] * f[:, None, :]
    found = Observations(
        other.point[:, :2] - one.point[:, :2],
        csr_array(joint.slopes(one) - joint.slopes(other)),
        R,
        np.stack([one.point[:, :2], other.point[:, :2]], axis=1),
        ties.t,
        ties.pixel,
        tuple(f"tie {k}" for k in range(len(good))),
    ).chosen(good)
    if control is None or not len(control.t):
        return found
    seen = ground_points(where, control.t, control.pixel)
    names = tuple(f"point {name}" for name in control.names) or tuple(f"point {k}" for k in range(len(control.t)))
    if not seen.valid.all():
        lost = [name for name, valid in zip(names, seen.valid, strict=True) if not valid]
        raise LogError(f"control: {', '.join(lost)}: that line and pixel have no pose or no floor; check both")
    if not (known := joint.covers(control.t)).all():
        late = [f"{name} ({t:.1f} s)" for name, t, ok in zip(names, control.t, known, strict=True) if not ok]
        raise LogError(
            f"control: {', '.join(late)}: seen outside the smoothed track's key frames, {joint.t[0]:.1f} to "
            f"{joint.t[-1]:.1f} s, where errors are not known; take lines within"
        )
    f = seen.by_depth * depth_std
    noise = control.std[:, None, None] ** 2 * np.eye(2) + f[:, :, None] * f[:, None, :]
    none = np.full(len(control.t), np.nan)
    return Observations(
        np.concatenate([found.d, control.place - seen.point[:, :2]]),
        csr_array(vstack([found.H, joint.slopes(seen)])),
        np.concatenate([found.R, noise]),
        np.concatenate([found.ends, np.stack([seen.point[:, :2], control.place], axis=1)]),
        np.concatenate([found.t, np.column_stack([control.t, none])]),
        np.concatenate([found.pixel, np.column_stack([control.pixel, none])]),
        found.names + names,
    )
