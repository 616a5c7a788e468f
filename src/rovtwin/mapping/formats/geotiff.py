"""Cloud-optimised GeoTIFF: pictures, layers and whole cubes, with overviews, band names and wavelengths.

Wavelengths stand twice, as GDAL 3.10 and later has them (domain IMAGERY, in um) and as QGIS and EnMAP-Box read them.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from jaxtyping import Float, UInt8

from rovtwin.core.log.files import atomic, write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.formats.class_colours import ClassMap
from rovtwin.mapping.projection import rasterio

_ROWS = 256
_COG = {"driver": "COG", "compress": "DEFLATE", "level": 1, "overview_resampling": "average", "bigtiff": "IF_SAFER"}


def write_picture(path: Path, grid: Grid, rgb: UInt8[np.ndarray, "row column 4"]) -> Path:
    """Red, green, blue and opacity.

    Raises:
        LogError: It cannot be written.
    """
    from rasterio.enums import ColorInterp

    colours = [ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha]
    blocks = [(0, np.moveaxis(rgb, -1, 0))]
    return _written(path, grid, 4, "uint8", blocks, {}, lambda file: setattr(file, "colorinterp", colours))


def write_layers(
    path: Path, grid: Grid, layers: Mapping[str, tuple[Float[np.ndarray, "row column"], str]], about: Mapping[str, str]
) -> Path:
    """One band for each layer, float32, no number where nothing was seen; its unit in the band's tags.

    Raises:
        LogError: It cannot be written.
    """

    def named(file: Any) -> None:
        file.update_tags(**about)
        for band, (name, (_, unit)) in enumerate(layers.items(), 1):
            file.set_band_description(band, name)
            file.update_tags(band, units=unit)

    block = np.stack([layer for layer, _ in layers.values()]).astype(np.float32)
    return _written(path, grid, len(layers), "float32", [(0, block)], {"nodata": np.nan, "predictor": 3}, named)


def write_classes(path: Path, grid: Grid, classes: ClassMap) -> Path:
    """A map of classes with a table of colours; names lie beside it, as GDAL looks for them.

    Args:
        path: Of the file; names and colours go to `path.aux.xml`, as category names and as attribute table.
        grid: Where the cells lie.
        classes: Of them.

    Raises:
        LogError: It cannot be written.
    """
    table = {k: (*colour, 255) for k, colour in enumerate(classes.colours)}
    profile = {"nodata": classes.no_data, "overview_resampling": "mode"}
    blocks = [(0, classes.value[None])]
    _written(path, grid, 1, "uint8", blocks, profile, lambda file: file.write_colormap(1, table))
    beside = path.with_name(f"{path.name}.aux.xml")
    try:
        write_text(beside, _categories(classes.names, classes.colours))
    except OSError as error:
        raise write_error(beside, error) from error
    return path


def _categories(names: Sequence[str], colours: Sequence[tuple[int, int, int]]) -> str:
    """GDAL's PAM: category names, and an attribute table (usage: 5 value, 2 name, 6 to 8 colours)."""
    root = Element("PAMDataset")
    band = SubElement(root, "PAMRasterBand", band="1")
    listed = SubElement(band, "CategoryNames")
    table = SubElement(band, "GDALRasterAttributeTable", tableType="thematic")
    for k, (name, kind, usage) in enumerate(
        (("Value", 0, 5), ("Class", 2, 2), ("Red", 0, 6), ("Green", 0, 7), ("Blue", 0, 8))
    ):
        field = SubElement(table, "FieldDefn", index=str(k))
        for tag, text in (("Name", name), ("Type", kind), ("Usage", usage)):
            SubElement(field, tag).text = str(text)
    for k, (name, colour) in enumerate(zip(names, colours, strict=True)):
        SubElement(listed, "Category").text = name
        row = SubElement(table, "Row", index=str(k))
        for cell in (k, name, *colour):
            SubElement(row, "F").text = str(cell)
    indent(root)
    return tostring(root, encoding="unicode") + "\n"


def write_cube(
    path: Path,
    grid: Grid,
    cube: Float[np.ndarray, "row band column"],
    wavelengths: Float[np.ndarray, " band"],
    fwhm: Float[np.ndarray, " band"],
    no_data: float,
    about: Mapping[str, str],
) -> Path:
    """All bands, float32.

    Raises:
        LogError: It cannot be written.
    """

    def named(file: Any) -> None:
        file.update_tags(**about)
        for band, (w, wide) in enumerate(zip(wavelengths, fwhm, strict=True), 1):
            file.set_band_description(band, f"{w:.1f} nm")
            file.update_tags(band, wavelength=f"{w:.4f}", wavelength_units="Nanometers", fwhm=f"{wide:.4f}")
            um = {"CENTRAL_WAVELENGTH_UM": f"{1e-3 * w:.7f}", "FWHM_UM": f"{1e-3 * wide:.7f}"}
            file.update_tags(band, ns="IMAGERY", **um)

    blocks = ((row, np.swapaxes(cube[row : row + _ROWS], 0, 1)) for row in range(0, grid.rows, _ROWS))
    return _written(path, grid, len(wavelengths), "float32", blocks, {"nodata": no_data, "predictor": 3}, named)


def _written(
    path: Path,
    grid: Grid,
    bands: int,
    kind: str,
    blocks: Iterable[tuple[int, np.ndarray]],
    profile: Mapping[str, Any],
    dress: Any,
) -> Path:
    """A plain GeoTIFF first, block by block; the copy puts it in order and adds overviews."""
    rio = rasterio("a GeoTIFF")
    from rasterio.shutil import copy

    base: dict[str, Any] = {"driver": "GTiff", "width": grid.columns, "height": grid.rows, "count": bands}
    base |= {"dtype": kind, "crs": grid.crs, "transform": grid.transform, "BIGTIFF": "IF_SAFER"}
    if "nodata" in profile:
        base["nodata"] = profile["nodata"]
    if bands > 4:
        base |= {"interleave": "band"}
    plain = path.with_name(f".{path.name}.plain.tif")
    more = {name: profile[name] for name in ("predictor", "overview_resampling") if name in profile}
    try:
        with atomic(path, True) as temporary:
            try:
                with rio.open(plain, "w", **base) as file:
                    for row, block in blocks:
                        file.write(block, window=rio.windows.Window(0, row, grid.columns, block.shape[1]))
                    dress(file)
                copy(plain, temporary, **_COG | more)
            except rio.errors.RasterioError as error:
                raise OSError(str(error)) from error
    finally:
        for left in (plain, plain.with_name(f"{plain.name}.aux.xml")):
            left.unlink(missing_ok=True)
    return path
