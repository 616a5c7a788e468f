"""What lies where: shares of materials at places on the floor, and the spectra of these materials."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import jax, jnp
from rovtwin.imaging.floor import floor_hits
from rovtwin.imaging.spectra.materials import reflectance, reflectance_of_colour
from rovtwin.simulation.camera.shading import mottled
from rovtwin.simulation.imager.hits import Hits, first_hits
from rovtwin.simulation.scene.scene import Scene
from rovtwin.simulation.scene.schema import BANDS, Cover
from rovtwin.simulation.scene.surfaces import Material

_SOFT = 0.06  # of the edge of a patch, in units of the noise that makes it
_GRAIN, _GRAINY = 0.06, 0.12  # finer look of all materials: its coarsest length [m], and how much brightness varies
_RAGGED = 0.05  # how much that grain frays the edges of patches
_ROUGH = 0.25  # how much a patch's brightness varies with that noise
_PER_SEED = (37.7, 91.3)  # way from one seed's piece of the noise to the next, in lengths of the noise
_ABOVE = 2.0  # the floor, from where things on it are looked at [m]
_BLOCK = 1 << 14  # points at a time, so that one program is compiled
_SAMPLE = 0.37 * np.arange(300.0)  # of the noise, in its lengths, of which the level of a share is taken


@dataclass(frozen=True)
class Ground:
    """The floor of a scene and what stands on it, by wavelength.

    Attributes:
        scene: Whose.
        wavelength: [nm].
    """

    scene: Scene
    wavelength: Float[np.ndarray, " band"]

    @cached_property
    def spectra(self) -> Float[np.ndarray, "material band"]:
        """Reflectances: of the floor's surface two, of each cover one, of each thing that stands on it two."""
        rows = list(self._both(self._surface))
        rows += [reflectance(cover.material, self.wavelength) for cover in self._covers]
        rows += [row for standing in self.scene.standing for row in self._both(standing.material)]
        return np.array(rows, np.float32)

    @property
    def materials(self) -> list[str]:
        """Of each row of `spectra`; "" of what has a colour alone."""
        covers = [cover.material for cover in self._covers]
        return [
            *[self._surface.spectrum] * 2,
            *covers,
            *(one.material.spectrum for one in self.scene.standing for _ in range(2)),
        ]

    @property
    def standing_from(self) -> int:
        """Row of the first thing that stands on the floor."""
        return 2 + len(self._covers)

    @property
    def _covers(self) -> list[Cover]:
        return [] if self.scene.file.bottom is None else self.scene.file.bottom.cover

    @cached_property
    def _surface(self) -> Material:
        surface = self.scene.floor_surface
        assert surface is not None
        return Material.of(surface)

    def _both(self, material: Material) -> tuple[np.ndarray, np.ndarray]:
        """Of its colour, and of what its second colour makes of that."""
        if not material.spectrum:
            return (
                reflectance_of_colour(material.colour, BANDS, self.wavelength),
                reflectance_of_colour(material.second, BANDS, self.wavelength),
            )
        first = reflectance(material.spectrum, self.wavelength)
        ratio = material.second / np.maximum(material.colour, 1e-6)
        return first, first * reflectance_of_colour(ratio, BANDS, self.wavelength)

    def shares(self, place: Float[np.ndarray, "n 2"], wide: float) -> Float[np.ndarray, "n material"]:
        """Of each row of `spectra` at places on the floor, brightness included.

        Args:
            place: North and east [m].
            wide: Of a pixel there [m]: what is finer is left out.
        """
        north, east = (np.ascontiguousarray(place[:, i], np.float32) for i in (0, 1))
        look = self._surface
        found = np.zeros((len(place), len(self.spectra)), np.float32)
        rough = _noise(east, north, look.grain, wide)  # right and up of the texture, as cameras have it
        patch = np.clip(look.patches * np.clip(rough, 0.0, 1.0), 0.0, 1.0)
        grain = _noise(east, north, _GRAIN, wide)
        gain = np.maximum(1.0 + look.mottle * rough, 0.0)
        found[:, 0], found[:, 1] = gain * (1.0 - patch), gain * patch
        for k, cover in enumerate(self._covers):
            noise = _noise(*_moved(east, north, cover), cover.length, wide)
            over = _smooth((noise + _RAGGED * grain - _level(cover.share)) / _SOFT)
            found[:, : 2 + k] *= (1.0 - over)[:, None]
            found[:, 2 + k] = over * np.maximum(1.0 + _ROUGH * noise, 0.0)
        return found * (1.0 + _GRAINY * grain)[:, None]

    def seen(self, hits: Hits, wide: float) -> Float[np.ndarray, "*n material"]:
        """Shares of each row of `spectra` where rays end, on the floor or on what stands on it.

        Args:
            hits: Where they end.
            wide: Of a pixel there [m].
        """
        place = np.nan_to_num(hits.point[..., :2]).reshape(-1, 2)
        found = self.shares(place, wide).reshape(*hits.way.shape, -1)
        if (standing := hits.standing >= 0).any():
            found[standing] = 0.0
            row = self.standing_from + 2 * hits.standing[standing]
            found[(*np.nonzero(standing), row)] = 1.0 - hits.printed[standing]
            found[(*np.nonzero(standing), row + 1)] = hits.printed[standing]
        return found

    def from_above(self, place: Float[np.ndarray, "n 2"], wide: float = 1e-3) -> Float[np.ndarray, "n band"]:
        """Reflectance of what is seen straight from above at places north and east [m]: the truth of a map."""
        return self.shares_from_above(place, wide) @ self.spectra

    def shares_from_above(self, place: Float[np.ndarray, "n 2"], wide: float = 1e-3) -> Float[np.ndarray, "n material"]:
        """Shares of each row of `spectra` in what is seen straight from above at places north and east [m]."""
        floor = self.scene.floor
        assert floor is not None
        down = np.tile([0.0, 0.0, 1.0], (len(place), 1))
        origin = np.column_stack([place, floor.depth_and_slope(place)[0] - _ABOVE])
        hits = first_hits(floor_hits(floor, origin, down, np.inf), self.scene.standing, origin, down, np.inf)
        return self.seen(hits, wide)

    def albedo(self, place: Float[np.ndarray, "n 2"], wide: float = 1e-3) -> Float[np.ndarray, "n band"]:
        """Reflectance of the floor at places north and east [m], the truth of a map but for what stands on it."""
        return self.shares(place, wide) @ self.spectra


def _moved(east: np.ndarray, north: np.ndarray, cover: Cover) -> tuple[np.ndarray, np.ndarray]:
    away = cover.length * (1 + cover.seed)
    return east + np.float32(away * _PER_SEED[0]), north + np.float32(away * _PER_SEED[1])


def _smooth(x: np.ndarray) -> np.ndarray:
    """From 0 at -1 to 1 at 1."""
    x = np.clip(0.5 * x + 0.5, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


@jax.jit
def _mottled(u: jax.Array, v: jax.Array, wide: jax.Array, grain: jax.Array) -> jax.Array:
    return mottled(u, v, jnp.broadcast_to(wide, u.shape), jnp.broadcast_to(grain, u.shape))


def _noise(u: np.ndarray, v: np.ndarray, grain: float, wide: float) -> Float[np.ndarray, " n"]:
    found = np.empty(len(u), np.float32)
    for start in range(0, len(u), _BLOCK):
        part = [np.zeros(_BLOCK, np.float32) for _ in range(2)]
        size = min(_BLOCK, len(u) - start)
        for array, given in zip(part, (u, v), strict=True):
            array[:size] = given[start : start + size]
        noise = _mottled(part[0], part[1], np.float32(wide), np.float32(grain))
        found[start : start + size] = np.asarray(noise)[:size]
    return found


@lru_cache(maxsize=64)
def _level(share: float) -> float:
    """Above which that share of the noise lies."""
    if share <= 0.0:
        return np.inf
    u, v = (x.ravel().astype(np.float32) for x in np.meshgrid(_SAMPLE, _SAMPLE))
    return float(np.quantile(_noise(u, v, 1.0, 0.0), 1.0 - share))
