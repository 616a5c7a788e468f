"""A seabed of patches with soft edges, and a mosaic of it that no estimator's equations have made.

Spectra of the site differ from the library's in shape, vary from place to place and in brightness; cells are blurred
after they were mixed; noise grows with light; height errors vary slowly over the mosaic.
"""

import json

import numpy as np
from rasterio.crs import CRS
from scipy.ndimage import gaussian_filter

from rovtwin.core.datum import Datum
from rovtwin.imaging.spectra.materials import reflectance
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.formats.envi import NO_DATA, header
from rovtwin.mapping.formats.geotiff import write_layers, write_picture
from rovtwin.mapping.projection import project

CELL = 0.02
NAMES = ("sand", "kelp", "maerl", "mud")
WAVELENGTHS = np.arange(420.0, 721.0, 7.5)
FWHM = np.full(len(WAVELENGTHS), 8.0)
DATUM = Datum(59.0, 5.0, 0.0, "2024-05-01T08:00:00Z")
LEFT, TOP = (np.round(project(DATUM, CRS.from_epsg(32632), np.zeros((1, 3)))[0] / CELL)) * CELL  # north, east 0


def field(rng, shape, length):
    """Of unit mean square, its mean included, smooth over a length in cells."""
    noise = gaussian_filter(rng.standard_normal(shape), length, mode="wrap")
    return noise / np.sqrt(np.mean(noise**2))


def shares(rng, shape, count=len(NAMES), length=7.0):
    """Of each material by cell: one nearly everywhere, edges some cells wide."""
    weight = np.exp(6.0 * np.stack([field(rng, shape, length) for _ in range(count)], axis=-1))
    return weight / weight.sum(axis=-1, keepdims=True)


def spectra(rng=None, off=0.0, names=NAMES):
    """Of materials; off by bumps of a relative height, some 40 nm wide, as no Gaussian process would have them."""
    E = np.array([reflectance(name, WAVELENGTHS) for name in names])
    if rng is None:
        return E
    middle = rng.uniform(430.0, 710.0, (len(E), 3, 1))
    height = off * rng.choice([-1.0, 1.0], (len(E), 3, 1)) * rng.uniform(0.5, 1.5, (len(E), 3, 1))
    return E * np.exp(np.sum(height * np.exp(-(((WAVELENGTHS - middle) / 40.0) ** 2)), axis=1))


def cube(rng, a, E, grain=0.2, blur=0.7, noise=0.004, height=0.02):
    """Reflectance of shares of spectra."""
    bright = np.exp(grain * field(rng, a.shape[:2], 2.0))
    x = bright[..., None] * (a @ E)
    x = gaussian_filter(x, (blur, blur, 0.0))
    slope = 1.0 + 2.0 * ((WAVELENGTHS - 420.0) / 300.0) ** 3  # water absorbs red: an error of height is larger there
    x = x * np.exp(height * field(rng, a.shape[:2], 15.0)[..., None] * slope)
    return x + noise * np.sqrt(0.2 + x / 0.2) * rng.standard_normal(x.shape)


def folder_of(folder, x, quantity="reflectance", noise=0.004, errors=(0.02, 0.0, 0.0)):
    """As `rovtwin map` leaves it."""
    folder.mkdir()
    grid = Grid(CRS.from_epsg(32632), LEFT, TOP, CELL, *x.shape[:2])
    np.where(np.isfinite(x), x, NO_DATA).transpose(0, 2, 1).astype(np.float32).tofile(folder / "cube.img")
    (folder / "cube.hdr").write_text(header(grid, WAVELENGTHS, FWHM, quantity))
    layers = {"coverage": (np.ones(grid.shape), "1"), "noise": (np.full(grid.shape, noise), "1")}
    write_layers(folder / "layers.tif", grid, layers, {})
    write_picture(folder / "rgb.tif", grid, np.full((*grid.shape, 4), 120, np.uint8))
    rows = [f"{w},0.02,{','.join(f'{e * (1.0 + ((w - 420.0) / 300.0) ** 3)}' for e in errors)},0" for w in WAVELENGTHS]
    head = "wavelength_nm,noise_of_a_pixel,height,water,lamps,masked_share"
    (folder / "uncertainty.csv").write_text("\n".join([head, *rows]) + "\n")
    about = {
        "quantity": quantity,
        "grid": {"crs": "EPSG:32632", "left_m": LEFT, "top_m": TOP, "cell_m": CELL} | dict(
            zip(("rows", "columns"), grid.shape, strict=True)
        ),
        "datum": json.loads(DATUM.metadata()),
        "wavelengths_nm": WAVELENGTHS.tolist(),
        "fwhm_nm": FWHM.tolist(),
        "figures": {"seen_m2": grid.rows * grid.columns * CELL**2},
    }  # fmt: skip
    (folder / "map.json").write_text(json.dumps(about))
    return folder
