"""Log and video joined: the frames of a recording, each with what the cameras saw and the attitude at that time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation, Slerp

from rovtwin.core.errors import LogError
from rovtwin.core.log import Log
from rovtwin.positioning.images.detection import Detections, Detector
from rovtwin.positioning.images.observations import Frames, sightings
from rovtwin.positioning.images.video import Video
from rovtwin.vehicle.description.cameras import Camera

ATTITUDES = ("sensor/attitude", "autopilot/eta")  # in which channels to look for it
APART = 1e-3  # frames of several cameras that are nearer than this are one instant [s]: at 1 m/s they differ by 1 mm
GAP = 0.5  # attitude readings further apart than this are not bridged [s]


@dataclass(frozen=True, eq=False)
class Attitude:
    """Readings of the attitude: times [s], and rotations; `channel` they come from."""

    t: Float[np.ndarray, " n"]
    rotation: Rotation
    channel: str

    @classmethod
    def of(cls, log: Log) -> "Attitude":
        """Of a log's attitude sensor, else of its autopilot's estimate.

        Raises:
            LogError: It has neither.
        """
        for name in ATTITUDES:
            if name in log and len(log[name]) > 1:
                series = log[name]
                t = series["t_valid"] if "t_valid" in series.channel.fields else series.t
                euler = np.stack([series[angle] for angle in ("psi", "theta", "phi")], axis=1)
                order = np.unique(t, return_index=True)[1]
                return cls(t[order], Rotation.from_euler("ZYX", euler[order]), name)
        raise LogError(f"{log.source}: found no attitude; expected a channel {' or '.join(ATTITUDES)}")

    def at(self, t: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 4"], Bool[np.ndarray, " n"]]:
        """Quaternions R_nb, at times t, and at which of them there are readings near."""
        inside = (t >= self.t[0]) & (t <= self.t[-1])
        after = np.clip(np.searchsorted(self.t, t), 1, len(self.t) - 1)
        inside &= self.t[after] - self.t[after - 1] <= GAP
        q = Slerp(self.t, self.rotation)(np.clip(t, self.t[0], self.t[-1])).as_quat(scalar_first=True)
        return q, inside


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames with the time from which they were seen, detections of each, and what was left out."""

    frames: Frames
    detections: list[list[Detections]]
    notes: tuple[str, ...]


def record(
    log: Log,
    videos: Sequence[Video],
    cameras: Sequence[Camera],
    detector: Detector,
    sizes: Float[np.ndarray, " ids"],
    slots: int = 16,
    progress: Callable[[float], None] | None = None,
) -> Recording:
    """Goes through the videos once.

    Args:
        log: With the attitude.
        videos: One for each camera, by the log's clock.
        cameras: In the same order.
        detector: For all of them.
        sizes: Side of each marker by its id [m].
        slots: Largest number of markers in one instant.
        progress: Called with the time of each frame [s].

    Raises:
        LogError: No attitude, or none at the time of any frame.
        ConfigError: A video that cannot be read.
    """
    attitude = Attitude.of(log)
    seen: list[tuple[float, int, Detections]] = []
    for number, video in enumerate(videos):
        for t, image in video:
            seen.append((t, number, detector(image)))
            if progress:
                progress(t)
    times, instants = _instants(seen, len(cameras))
    q, inside = attitude.at(times)
    notes = [note for video in videos for note in video.notes]
    if not inside.any():
        raise LogError(
            f"{log.source}: {attitude.channel} has readings from {attitude.t[0]:g} to {attitude.t[-1]:g} s, the video "
            f"frames from {times[0]:g} to {times[-1]:g} s. Give the time of the first frame (--video-start)"
        )
    if not inside.all():
        notes.append(f"{int((~inside).sum())} of {len(times)} frames without attitude left out")
    keep = np.flatnonzero(inside)
    notes += _shared_readings(attitude, times[keep])
    rows = [sightings(instants[k], cameras, sizes, slots) for k in keep]
    return Recording(Frames.of(times[keep], q[keep], rows), [instants[k] for k in keep], tuple(notes))


def _shared_readings(attitude: Attitude, t: Float[np.ndarray, " n"]) -> list[str]:
    """Whether neighbouring frames at times t share readings of the attitude, and with them their errors."""
    near = attitude.t[(attitude.t >= t[0]) & (attitude.t <= t[-1])]
    if len(t) < 2 or len(near) < 2:
        return []
    reading, frame = float(np.median(np.diff(near))), float(np.median(np.diff(t)))
    if reading <= 1.05 * frame:  # clocks are not exact
        return []
    return [
        f"{attitude.channel} is read every {reading:.3g} s, frames come every {frame:.3g} s: frames between two "
        "readings share their errors, so that positions of single frames are less independent than their noise says"
    ]


def _instants(
    seen: list[tuple[float, int, Detections]], cameras: int
) -> tuple[Float[np.ndarray, " n"], list[list[Detections]]]:
    """Frames of all cameras in order of time, those of different cameras at one instant together."""
    times: list[float] = []
    found: list[list[Detections]] = []
    taken: set[int] = set()
    for t, number, detections in sorted(seen, key=lambda item: item[:2]):
        if not times or t - times[-1] > APART or number in taken:
            # Two frames of one camera are never one instant, however near they are.
            times.append(t)
            found.append([Detections.none()] * cameras)
            taken = set()
        found[-1][number] = detections
        taken.add(number)
    return np.array(times), found
