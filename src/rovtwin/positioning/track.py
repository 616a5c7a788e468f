"""The track of a vehicle from a recording, by any of the three methods."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.block import Start
from rovtwin.core.errors import LogError
from rovtwin.core.frames import rotation_from_quaternion, rotation_from_vector
from rovtwin.core.markers import Layout
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.positioning.estimators.ekf import MarkerEkf
from rovtwin.positioning.estimators.ekf_steps import FULL, NEW, NOBODY, REJECTED, USED, WAITING
from rovtwin.positioning.estimators.ekf_tuning import SlamTuning
from rovtwin.positioning.estimators.luenberger import Gains, MarkerLuenberger
from rovtwin.positioning.estimators.run import Outputs, associate, run_observer
from rovtwin.positioning.estimators.single_frame import fixes
from rovtwin.positioning.estimators.smoother import smooth
from rovtwin.positioning.recording import Recording
from rovtwin.vehicle.description.cameras import Camera

Method = Literal["ekf", "luenberger", "smoother"]
METHODS: tuple[Method, ...] = ("ekf", "luenberger", "smoother")
DARK = 2.0  # time without any marker that is worth a note [s]

_NO_LAYOUT = "luenberger does not use the layout: the start fixes the frame; ekf and smoother use it"
_NO_FIXES = (
    "luenberger gives no positions of single frames: the log has no sensor/position that rovtwin identify could read; "
    "use ekf or smoother for that"
)
_NO_SCALE = (
    "no marker's place is known: the scale of the track rests on the sides of the prints as given. A side that is 1 % "
    "off makes all ways and speeds 1 % wrong; measure them, say how well (--marker-scale-std), or give --layout"
)
_rotations = jax.jit(jax.vmap(rotation_from_quaternion))


@dataclass(frozen=True, eq=False)
class Placed:
    """A marker of the map: id, position in n [m], quaternion R_nm, std of shift [m] and turn [rad]."""

    id: int
    position: Float[np.ndarray, "3"]
    attitude: Float[np.ndarray, "4"]
    std: Float[np.ndarray, "6"]


@dataclass(frozen=True, eq=False)
class Track:
    """Where the vehicle was.

    Attributes:
        method: Which of METHODS.
        t: Times of the frames [s].
        position: CO in n [m].
        velocity: In n [m/s].
        std: Of both, by the estimator's covariance; NaN where it does not say (luenberger).
        attitude: Quaternions R_nb.
        offset: Of the attitude that was measured, a rotation vector in n [rad]; R_nb = exp(offset) R_meas.
        offset_std: Its standard deviation [rad].
        counts: Markers seen, used and rejected in each frame.
        fix: Position from each frame alone [m]; NaN where there is none. See `fixes`.
        fix_std: Its standard deviation [m].
        markers: The map at the end.
        pixel_rms: Of the residuals [px]; NaN where the method has none.
        notes: What happened on the way, one line each.
    """

    method: Method
    t: Float[np.ndarray, " n"]
    position: Float[np.ndarray, "n 3"]
    velocity: Float[np.ndarray, "n 3"]
    std: Float[np.ndarray, "n 6"]
    attitude: Float[np.ndarray, "n 4"]
    offset: Float[np.ndarray, "3"]
    offset_std: Float[np.ndarray, "3"]
    counts: Int[np.ndarray, "n 3"]
    fix: Float[np.ndarray, "n 3"]
    fix_std: Float[np.ndarray, "n 3"]
    markers: list[Placed]
    pixel_rms: float
    notes: tuple[str, ...]


def track(
    recording: Recording,
    cameras: Sequence[Camera],
    method: Method = "ekf",
    layout: Layout | None = None,
    tuning: SlamTuning | None = None,
    sizes: Float[np.ndarray, " ids"] | None = None,
    start: Sequence[float] | np.ndarray = (0.0, 0.0, 0.0),
    gains: Gains | None = None,
) -> Track:
    """The track of a recording.

    Args:
        recording: Frames with what was seen.
        cameras: As the recording was made with.
        method: One of METHODS.
        layout: Markers of known place; None: the start fixes the frame.
        tuning: Of filter and smoother.
        sizes: Side of each marker by its id [m], the table that the recording was made with; None: the layout's, and
            that of the thesis for others.
        start: Where the vehicle is at the first frame, n [m]; with a layout, nearly.
        gains: Of the Luenberger observer; None: the thesis's.

    Raises:
        LogError: No marker in any frame.
    """
    frames = recording.frames
    if not np.asarray(frames.sightings.valid).any():
        dictionary = layout.dictionary if layout else "DICT_4X4_50"
        raise LogError(
            f"found no marker in any of {len(frames)} frames, expected some of {dictionary}. Check the dictionary, the "
            "light and the turbidity, and that whole markers with their white border are in view"
        )
    # The first frame may be long after the log's clock began: nothing is known of the time before.
    begin = Start(as_array(start), as_array(frames.attitude[0]), as_array(np.zeros(6)))
    if method == "luenberger":
        return _observed(recording, cameras, begin, gains, layout)
    capacity = _number_of_ids(recording) + 4
    table = None if sizes is None else as_array(sizes)
    filter = MarkerEkf.of(cameras, tuning, layout, capacity=-(-capacity // 8) * 8, sizes=table)
    out = run_observer(filter, frames, begin)
    return _smoothed(recording, filter, out) if method == "smoother" else _filtered(recording, filter, out)


def _filtered(recording: Recording, filter: MarkerEkf, out: Outputs) -> Track:
    map_ = associate(filter, recording.frames, out)
    std = np.sqrt(np.maximum(np.diagonal(out.covariance, axis1=1, axis2=2), 0.0))
    fix, fix_std = _fixes(recording, filter, out.offset[-1], out.position, map_.position, map_.attitude, map_.landmark)
    last = [k for k, number in enumerate(out.ids[-1]) if number >= 0]
    marker_std = np.sqrt(np.maximum(out.marker_variance[-1], 0.0))
    markers = [
        Placed(int(out.ids[-1, k]), out.marker_position[-1, k], out.marker_attitude[-1, k], marker_std[k]) for k in last
    ]
    return Track(
        "ekf", recording.frames.t, out.position, out.velocity, std, out.attitude, out.offset[-1],
        out.offset_std[-1], _counts(recording, out), fix, fix_std, markers, float("nan"),
        _notes(recording, filter, out),
    )  # fmt: skip


def _smoothed(recording: Recording, filter: MarkerEkf, out: Outputs) -> Track:
    s = smooth(filter, recording.frames, out)
    std = np.sqrt(np.maximum(np.diagonal(s.covariance, axis1=1, axis2=2), 0.0))
    fix, fix_std = _fixes(recording, filter, s.offset, s.position, s.marker_position, s.marker_attitude, s.landmark)
    columns = zip(s.ids, s.marker_position, s.marker_attitude, s.marker_std, strict=True)
    markers = [Placed(int(number), p, q, sd) for number, p, q, sd in columns]
    counts = _counts(recording, out)
    counts[:, 1] = (s.landmark >= 0).sum(axis=1)
    return Track(
        "smoother", recording.frames.t, s.position, s.velocity, std, s.attitude, s.offset, s.offset_std, counts, fix,
        fix_std, markers, s.pixel_rms, _notes(recording, filter, out),
    )  # fmt: skip


def _number_of_ids(recording: Recording) -> int:
    seen = recording.frames.sightings
    return len(np.unique(np.asarray(seen.ids)[np.asarray(seen.valid)]))


def _observed(
    recording: Recording, cameras: Sequence[Camera], begin: Start, gains: Gains | None, layout: Layout | None
) -> Track:
    frames = recording.frames
    out = run_observer(MarkerLuenberger.of(cameras, gains, capacity=_number_of_ids(recording)), frames, begin)
    n, none = len(frames), np.full((len(frames), 6), np.nan)
    seen = np.asarray(frames.sightings.valid).sum(axis=1)
    used = (np.asarray(frames.sightings.valid) & np.asarray(frames.sightings.single)).sum(axis=1)
    markers = [
        Placed(int(number), place, np.array([1.0, 0, 0, 0]), np.full(6, np.nan))
        for number, place in zip(out.ids[-1], out.landmarks[-1], strict=True)
        if number >= 0
    ]
    counts = np.stack([seen, used, np.zeros(n, int)], axis=1)
    notes = (*recording.notes, *([_NO_LAYOUT] if layout else []), _NO_FIXES)
    return Track(
        "luenberger", frames.t, out.position, out.velocity, none, frames.attitude, np.zeros(3), np.zeros(3), counts,
        none[:, :3], none[:, :3], markers, float("nan"), notes,
    )  # fmt: skip


def _fixes(
    recording: Recording,
    filter: MarkerEkf,
    offset: Float[np.ndarray, "3"],
    near: Float[np.ndarray, "n 3"],
    position: Float[np.ndarray, "landmarks 3"],
    attitude: Float[np.ndarray, "landmarks 4"],
    landmark: Int[np.ndarray, "n slots"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    frames = recording.frames
    turned = np.asarray(rotation_from_vector(jnp.asarray(offset)))
    R_meas = turned @ np.asarray(_rotations(jnp.asarray(frames.attitude)))
    R_nm = np.asarray(_rotations(jnp.asarray(attitude)))
    which = np.maximum(landmark, 0)
    arguments = frames, R_meas, near, position[which], R_nm[which], landmark >= 0
    return fixes(filter.eyes, filter.tuning, filter.sizes, *arguments)


def _counts(recording: Recording, out: Outputs) -> Int[np.ndarray, "n 3"]:
    used = ((out.status == USED) | (out.status == NEW)).sum(axis=1)
    seen = np.asarray(recording.frames.sightings.valid).sum(axis=1)
    return np.stack([seen, used, (out.status == REJECTED).sum(axis=1)], axis=1)


def _notes(recording: Recording, filter: MarkerEkf, out: Outputs) -> tuple[str, ...]:
    """What a user would want to know of the run."""
    t, notes = recording.frames.t, list(recording.notes)
    if not (np.asarray(filter.layout.ids) != NOBODY).any():
        notes.append(_NO_SCALE)
    moved: dict[int, list[float]] = {}
    for k, place in zip(*np.nonzero(out.moved), strict=True):
        moved.setdefault(int(out.ids[k - 1, place]), []).append(float(t[k]))
    for number, times in moved.items():
        more = f", {len(times)} times in all" if len(times) > 1 else ""
        notes.append(
            f"marker {number} contradicts the others from {times[0]:g} s: moved, or its reflection taken for it{more}"
        )
    double = np.asarray(recording.frames.sightings.valid) & ~np.asarray(recording.frames.sightings.single)
    if double.any():
        k, slot = np.argwhere(double)[0]
        number = int(recording.frames.sightings.ids[k, slot])
        notes.append(
            f"{int(double.any(axis=1).sum())} frames show an id twice, the first marker {number} at {t[k]:g} s: a copy "
            "or a reflection"
        )
    if (rejected := int((out.status == REJECTED).sum())) > 0:
        notes.append(f"{rejected} sightings that do not fit left out")
    if (waiting := np.unique(np.asarray(recording.frames.sightings.ids)[out.status == WAITING])).size:
        never = [int(number) for number in waiting if not (out.ids == number).any()]
        if never:
            notes.append(f"markers {never} were seen but never clearly enough to be put on the map")
    if (out.status == FULL).any():
        notes.append("more markers than the map holds; the rest is not used")
    for k in np.flatnonzero(out.afresh)[1 if out.afresh[0] else 0 :]:
        notes.append(f"position taken afresh at {t[k]:g} s")
    return tuple(notes + _dark(t, ((out.status == USED) | (out.status == NEW)).any(axis=1)))


def _dark(t: Float[np.ndarray, " n"], seen: Bool[np.ndarray, " n"]) -> list[str]:
    """Times without any marker."""
    edges = np.concatenate([[t[0]], t[seen], [t[-1]]])
    return [f"no marker from {a:g} to {b:g} s" for a, b in zip(edges[:-1], edges[1:], strict=True) if b - a > DARK]
