"""Recording the vehicle's cameras while a run goes on: pictures rendered from where the twin is, chunk by chunk."""

import csv
import io
import zlib
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.log.pictures import PictureWriter
from rovtwin.core.numerics import jax
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.positioning.calibration.camera_file import as_data
from rovtwin.runs.compose.world import on_world_floor
from rovtwin.runs.loop import Record
from rovtwin.runs.track import LAYOUT
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.camera.sensor import CameraSection, camera_renderer, frames
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import Vehicle

QUALITY = 95  # of JPEG: corners of markers move by less than their noise

_rotations = jax.jit(jax.vmap(rotation_from_quaternion))


class Filming:
    """Takes the chunks of a run and writes what each camera sees of them; a context manager.

    Each camera gets `<camera>.mcap` and its lens, `<camera>.yaml`, beside the log, on request a film `<camera>.mp4`
    with the times of its frames in `<camera>.csv`; where the markers hang goes into `layout.yaml`. See `runs.track`.

    Args:
        scenario: Its `cameras`.
        vehicle: That carries them.
        folder: Of the run.
        film: Whether films are recorded.

    Raises:
        ConfigError: The scenario has no cameras, or a scene or camera is not there.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, folder: Path, film: bool = False) -> None:
        if not scenario.cameras:
            raise ConfigError(
                f"{scenario.name}: has no cameras to record. Add 'cameras: [{{scene: pool}}]' to the scenario, or fly "
                "with --set 'cameras=[{scene: pool}]'"
            )
        self._dt, self._ticks = scenario.control_dt, 0
        self._last: tuple[np.ndarray, ...] | None = None
        _check(scenario)
        _write_yaml(folder / LAYOUT, load_scene(scenario.cameras[0].scene).layout.model_dump())
        with ExitStack() as stack:
            self._cameras = [_Camera(one, scenario, vehicle, folder, film, stack) for one in scenario.cameras]
            self._open = stack.pop_all()

    def take(self, record: Record) -> None:
        """One chunk, leading axis ticks."""
        state = record.state
        arrays = [np.asarray(x) for x in (state.position, state.attitude, state.nu)]
        t = (self._ticks + np.arange(len(arrays[0]))) * self._dt
        self._ticks += len(t)
        path = (t, *arrays)
        if self._last is not None:
            path = tuple(np.concatenate([old, new]) for old, new in zip(self._last, path, strict=True))
        self._last = tuple(x[-1:] for x in path)
        for camera in self._cameras:
            camera.take(*path)

    def __enter__(self) -> "Filming":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._open.close()


def _check(scenario: Scenario) -> None:
    scenes = list(dict.fromkeys(one.scene for one in scenario.cameras))
    if len(scenes) > 1:
        raise ConfigError(f"{scenario.name}: cameras: found scenes {', '.join(scenes)}, expected one for all cameras")
    names = [one.camera for one in scenario.cameras]
    if len(set(names)) < len(names):
        raise ConfigError(f"{scenario.name}: cameras: found one camera twice, expected each once")


class _Camera:
    def __init__(
        self, section: CameraSection, scenario: Scenario, vehicle: Vehicle, folder: Path, film: bool, stack: ExitStack
    ) -> None:
        self._frames = frames(section, scenario.duration, scenario.seed)
        self._next, self._seed = 0, scenario.seed
        self._renderer = camera_renderer(section, on_world_floor(load_scene(section.scene), scenario.world), vehicle)
        name = self._renderer.camera.name
        stem = folder / name.replace(".", "_")
        lens = self._renderer.camera.lens
        _write_yaml(stem.with_suffix(".yaml"), as_data(name, lens, f"{vehicle.name}, as rendered"))
        self._pictures = stack.enter_context(PictureWriter(stem.with_suffix(".mcap"), name))
        self._film = _Film(stem, section.rate_hz, lens.size, stack) if film else None

    def take(
        self,
        t: Float[np.ndarray, " n"],
        position: Float[np.ndarray, "n 3"],
        attitude: Float[np.ndarray, "n 4"],
        nu: Float[np.ndarray, "n 6"],
    ) -> None:
        """Pictures taken up to the end of a stretch of the path."""
        due = np.searchsorted(self._frames.taken, t[-1] + 1e-9, side="right")
        rows = np.arange(self._next, due)
        self._next = int(due)
        if not len(rows):
            return
        at = self._frames.taken[rows]
        places, speeds, turned = (_between(at, t, x) for x in (position, nu, _continuous(attitude)))
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        for i, row in enumerate(rows):
            number = int(self._frames.number[row])
            R_nb = np.asarray(_rotations(turned[i : i + 1]))[0]
            picture = self._renderer.image(places[i], R_nb, speeds[i], self._noise_of(number))
            self._pictures.write(float(at[i]), float(self._frames.delivered[row]), jpeg(picture))
            if self._film:
                self._film.write(float(at[i]), picture)

    def _noise_of(self, number: int) -> int:
        """Seed of a picture's noise: of this run, this camera and this picture."""
        words = [self._seed, zlib.crc32(self._renderer.camera.name.encode()), number]
        return int(np.random.SeedSequence(words).generate_state(1)[0] >> 1)


class _Film:
    """MP4 with a table of when each frame was taken: lost pictures leave gaps that a film of fixed rate hides."""

    def __init__(self, stem: Path, rate: float, size: tuple[int, int], stack: ExitStack) -> None:
        from rovtwin.core.vision import opencv

        self._cv2: Any = opencv("writing films")
        path = stem.with_suffix(".mp4")
        self._writer = self._cv2.VideoWriter(str(path), self._cv2.VideoWriter_fourcc(*"mp4v"), rate, size)
        if not self._writer.isOpened():
            raise ConfigError(f"{path}: cannot be written as film; record without --film")
        stack.callback(self._writer.release)
        table = stack.enter_context(open(stem.with_suffix(".csv"), "w", newline="", encoding="utf-8"))
        self._times = csv.writer(table)
        self._times.writerow(["t"])

    def write(self, t: float, picture: UInt8[np.ndarray, "H W 3"]) -> None:
        self._writer.write(np.ascontiguousarray(picture[..., ::-1]))
        self._times.writerow([f"{t:.6f}"])


def _write_yaml(path: Path, data: dict[str, Any]) -> None:
    write_text(path, dump_yaml(data, default_flow_style=None))


def jpeg(picture: UInt8[np.ndarray, "H W 3"]) -> bytes:
    """A picture, RGB, uint8, as JPEG with its colours at full resolution."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=QUALITY, subsampling=0)
    return stream.getvalue()


def _between(
    at: Float[np.ndarray, " m"], t: Float[np.ndarray, " n"], values: Float[np.ndarray, "n k"]
) -> Float[np.ndarray, "m k"]:
    return np.stack([np.interp(at, t, column) for column in values.T], axis=1)


def _continuous(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 4"]:
    """Quaternions with signs that do not jump."""
    flips = np.cumprod(np.where(np.sum(q[1:] * q[:-1], axis=1) < 0, -1.0, 1.0))
    return q * np.concatenate([[1.0], flips])[:, None]
