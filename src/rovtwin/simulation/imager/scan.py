"""The lines that an imager takes on a path over a scene, a block at a time."""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, UInt16

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.floor import FloorHits, floor_hits
from rovtwin.imaging.imager import Imager, Mount
from rovtwin.imaging.path import PosePath
from rovtwin.imaging.radiance import Radiometry
from rovtwin.imaging.schema import Clock
from rovtwin.simulation.imager.detector import DetectorModel
from rovtwin.simulation.imager.ground import Ground
from rovtwin.simulation.imager.hits import Hits, beside, first_hits
from rovtwin.simulation.imager.radiance import radiometry_of
from rovtwin.simulation.scene.scene import Scene

BLOCK = 16  # lines made at once
LONGEST = 12.0  # way to a floor that a line still sees [m]
_STAMPS = 0x57  # keeps draws of one seed apart
# Where a line's light comes from while the shutter is open: shares of the exposure before or after its middle, and of
# the slit's width. Each is met once in its own quarter: a square of time and slit sampled as by a Latin square.
WITHIN = ((-0.375, 0.125), (-0.125, -0.375), (0.125, 0.375), (0.375, -0.125))


@dataclass(frozen=True)
class Block:
    """Lines that follow each other.

    Attributes:
        first: Number of the first.
        counts: Of them.
    """

    first: int
    counts: UInt16[np.ndarray, "line pixel band"]


@dataclass(frozen=True)
class Scan:
    """An imager on a path over a scene.

    Attributes:
        imager: Which one.
        mount: Where it truly sits.
        path: Of the vehicle.
        scene: With its floor.
        t: Middle of each line's exposure on the run's clock [s].
        seed: Of noise and pattern.
    """

    imager: Imager
    mount: Mount
    path: PosePath
    scene: Scene
    t: Float[np.ndarray, " line"]
    seed: int

    def __post_init__(self) -> None:
        if self.scene.floor is None:
            raise ConfigError(f"{self.scene.where}: has neither bottom nor tank: an imager would see water only")

    @cached_property
    def ground(self) -> Ground:
        """Materials in the imager's bands."""
        return Ground(self.scene, self.imager.wavelengths)

    @cached_property
    def radiometry(self) -> Radiometry:
        """Light and water in the imager's bands."""
        return radiometry_of(self.imager, self.scene.file, LONGEST)

    @cached_property
    def detector(self) -> DetectorModel:
        """With its own pattern."""
        return DetectorModel(self.imager, self.seed)

    def stamps(self, clock: Clock) -> Float[np.ndarray, " line"]:
        """What the imager's clock says at each line [s]; noise never turns two lines about."""
        noise = np.random.default_rng([self.seed, _STAMPS]).standard_normal(len(self.t)) * clock.jitter
        step = np.diff(self.t).min(initial=np.inf)
        noise = np.clip(noise, -0.4 * step, 0.4 * step) if np.isfinite(step) else noise
        return self.t * (1.0 + clock.drift) + clock.offset + noise

    def blocks(self, first: int = 0) -> Iterator[Block]:
        """All lines from one on, made on as many threads as there are processors."""
        self.radiometry.prepare()
        _ = (
            self.detector.response,
            self.detector.dark_rate,
            self.ground.spectra,
            self._bundles,
        )  # once, not on each thread
        starts = range(first, len(self.t), BLOCK)
        many = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        with ThreadPoolExecutor(many) as pool:
            waiting = [pool.submit(self.block, start) for start in starts[: many + 1]]
            for following in [*starts[many + 1 :], *[None] * len(waiting)]:
                if not waiting:
                    return
                done = waiting.pop(0).result()
                if following is not None:
                    waiting.append(pool.submit(self.block, following))
                yield done

    def block(self, first: int) -> Block:
        """Lines from one on, BLOCK at most; the same whichever were made before."""
        t = self.t[first : first + BLOCK]
        floor, hits, position, R_ns = self.middles(t)
        albedo = self._albedo(t, floor, hits)
        shape = (len(t), self.imager.pixels, len(self.imager.wavelengths))
        counts = np.empty(shape, np.uint16)
        for i in range(len(t)):
            one = Hits(hits.way[i], hits.point[i], hits.normal[i], hits.standing[i], hits.printed[i])
            radiance = self.radiometry.radiance(albedo[i], one, position[i], R_ns[i])
            counts[i] = self.detector.counts(radiance, first + i)
        return Block(first, counts)

    def floor_below(self) -> Float[np.ndarray, " line"]:
        """Depth of the floor that the middle pixel of each line sees [m]; no number where it sees none."""
        assert self.scene.floor is not None
        origin, direction, _, _ = self._rays(self.t, 0.0, slice(self.imager.pixels // 2, self.imager.pixels // 2 + 1))
        return floor_hits(self.scene.floor, origin, direction, LONGEST).point[:, 0, 2]

    def middles(
        self, t: Float[np.ndarray, " n"]
    ) -> tuple[FloorHits, Hits, Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
        """Where rays through the slit's middle end at times [s], the centre of projection in n [m], and R_ns."""
        origin, direction, position, R_ns = self._rays(t, 0.0)
        assert self.scene.floor is not None
        floor = floor_hits(self.scene.floor, origin, direction, LONGEST)
        return floor, first_hits(floor, self.scene.standing, origin, direction, LONGEST), position, R_ns

    def _rays(
        self, t: Float[np.ndarray, " n"], across: float, pixels: slice = slice(None)
    ) -> tuple[
        Float[np.ndarray, "n pixel 3"],
        Float[np.ndarray, "n pixel 3"],
        Float[np.ndarray, "n 3"],
        Float[np.ndarray, "n 3 3"],
    ]:
        place, R_nb, _ = self.path.at(t)
        point, direction = (x[pixels] for x in self._bundles[across])
        R_ns = R_nb @ self.mount.rotation
        position = place + R_nb @ self.mount.position
        turned = np.swapaxes(R_ns, -1, -2)
        return position[:, None] + point @ turned, direction @ turned, position, R_ns

    @cached_property
    def _bundles(self) -> dict[float, tuple[np.ndarray, np.ndarray]]:
        return {across: self.imager.rays(across) for across in (0.0, *(one[1] for one in WITHIN))}

    def _albedo(self, t: Float[np.ndarray, " n"], floor: FloorHits, middle: Hits) -> Float[np.ndarray, "n pixel band"]:
        """Reflectance that each pixel sees: the mean over its exposure and the slit's width."""
        far = middle.way[np.isfinite(middle.way)]
        field = 2.0 * float(np.abs(self.imager.view_angles[-1])) / self.imager.pixels
        wide = field * float(np.median(far)) if len(far) else field
        shares = np.zeros((*middle.way.shape, len(self.ground.spectra)), np.float32)
        for time, across in WITHIN:
            origin, direction, _, _ = self._rays(t + time * self.imager.file.exposure, across)
            at = first_hits(beside(floor, origin, direction), self.scene.standing, origin, direction, LONGEST)
            shares += self.ground.seen(at, wide)
        return (shares / np.float32(len(WITHIN))) @ self.ground.spectra
