"""A seabed of two materials with grain, and how two dives see it: shifted, warped, lit unevenly, noisy."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

CELL = 0.02
WAVELENGTHS = np.linspace(420.0, 690.0, 12)


def grain(rng, shape, length):
    """Noise of unit variance that is smooth over a length [m]."""
    noise = gaussian_filter(rng.standard_normal(shape), length / CELL, mode="wrap")
    return noise / noise.std()


def albedo(rng, shape):
    """Reflectance by cell and band: sand, and patches of weed five times darker, both with grain of 4 and 30 cm."""
    sand = 0.2 + 0.25 * (WAVELENGTHS - 400.0) / 300.0
    weed = 0.03 + 0.05 * np.exp(-(((WAVELENGTHS - 600.0) / 40.0) ** 2))
    rough = np.exp(0.12 * grain(rng, shape, 0.04) + 0.15 * grain(rng, shape, 0.3))
    return np.where(grain(rng, shape, 0.25)[:, :, None] > 0.5, weed, sand) * rough[:, :, None]


def seen(rng, truth, shift, warp, light=0.1, noise=0.004, jump: float | np.ndarray = 0.0):
    """What a dive makes of it, and the displacement that it saw it with (rows, columns of each cell).

    `jump` is more displacement of each cell along the rows [m], as of another line of the survey.

    Nothing of this has the form that the test of changes takes it to have: the warp is smooth where a process with an
    exponential covariance is fitted, light multiplies, noise is the same in dark and bright places.
    """
    shape = truth.shape[:2]
    u = np.stack([shift[k] / CELL + warp / CELL * grain(rng, shape, 0.7) for k in (0, 1)], axis=2)
    u[:, :, 0] += jump / CELL
    rows, columns = np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")
    at = [rows - u[:, :, 0], columns - u[:, :, 1]]
    bands = [map_coordinates(band, at, order=1, cval=np.nan) for band in np.moveaxis(truth, 2, 0)]
    lit = np.exp(light * grain(rng, shape, 0.6))
    return np.stack(bands, axis=2) * lit[:, :, None] + rng.normal(0.0, noise, truth.shape), u


def planted(rng, truth, spacing=0.8, size=0.1):
    """The same with squares by turns 30 % darker and brighter, and their middles in rows and columns."""
    changed, places, side = truth.copy(), [], round(size / CELL)
    step = round(spacing / CELL)
    for row in range(step // 2, truth.shape[0] - step // 2, step):
        for column in range(step // 2, truth.shape[1] - step // 2, step):
            i, j = row + rng.integers(-4, 5), column + rng.integers(-4, 5)
            changed[i : i + side, j : j + side] *= 0.7 if len(places) % 2 else 1.3
            places.append((i + 0.5 * (side - 1), j + 0.5 * (side - 1)))
    return changed, np.array(places)
