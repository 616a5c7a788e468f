"""netCDF by the CF conventions: the cube with its layers, `spatial_ref` with the map's system and GDAL's GeoTransform.

Reference: CF conventions 1.11, sec. 5.6 (grid mappings). GDAL loses the system of cells without `GeoTransform`.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from jaxtyping import Float

from rovtwin.core.log.files import atomic
from rovtwin.mapping.cells.grid import Grid

_ROWS = 64


def write_netcdf(
    path: Path,
    grid: Grid,
    cube: Float[np.ndarray, "row band column"],
    bands: tuple[Float[np.ndarray, " band"], Float[np.ndarray, " band"]],
    quantity: tuple[str, str],
    layers: Mapping[str, tuple[Float[np.ndarray, "row column"], str]],
    no_data: float,
    about: Mapping[str, str],
) -> Path:
    """Write a mosaic.

    Args:
        path: By custom with the ending `.nc`.
        grid: Where its cells lie.
        cube: Of them.
        bands: Wavelengths and their widths [nm].
        quantity: Name and unit of what the cube holds.
        layers: By name, with their units.
        no_data: What stands for no number in the cube.
        about: Attributes of the file.

    Raises:
        LogError: It cannot be written.
    """
    with atomic(path, True) as temporary, netCDF4.Dataset(temporary, "w") as file:
        mapping = _grid_mapping(grid.crs)
        file.setncatts(({"Conventions": "CF-1.11"} if mapping else {}) | dict(about))
        for name, size in (("wavelength", len(bands[0])), ("y", grid.rows), ("x", grid.columns)):
            file.createDimension(name, size)
        _coordinates(file, grid, bands, mapping)
        name, unit = quantity
        data = file.createVariable(
            name,
            "f4",
            ("wavelength", "y", "x"),
            zlib=True,
            complevel=1,
            fill_value=np.float32(no_data),
            chunksizes=(min(len(bands[0]), 16), min(grid.rows, 128), min(grid.columns, 128)),
        )
        data.setncatts({"units": unit, "grid_mapping": "spatial_ref", "long_name": name})
        file.set_auto_mask(False)
        for row in range(0, grid.rows, _ROWS):
            data[:, row : row + _ROWS] = np.swapaxes(cube[row : row + _ROWS], 0, 1)
        for name, (layer, unit) in layers.items():
            one = file.createVariable(name, "f4", ("y", "x"), zlib=True, fill_value=np.float32(np.nan))
            one.setncatts({"units": unit, "grid_mapping": "spatial_ref"})
            one[:] = layer
    return path


def _grid_mapping(crs: Any) -> dict[str, Any]:
    """As CF appendix F asks for it, of UTM on WGS-84; nothing of other systems, which only `crs_wkt` describes."""
    south, zone = divmod((crs.to_epsg() or 0) - 32600, 100)
    if south not in (0, 1) or not 1 <= zone <= 60:
        return {}
    return {
        "grid_mapping_name": "transverse_mercator",
        "longitude_of_central_meridian": 6.0 * zone - 183.0,
        "latitude_of_projection_origin": 0.0,
        "scale_factor_at_central_meridian": 0.9996,
        "false_easting": 500_000.0,
        "false_northing": 1e7 * south,
        "semi_major_axis": 6_378_137.0,
        "inverse_flattening": 298.257223563,
        "longitude_of_prime_meridian": 0.0,
    }


def _coordinates(
    file: netCDF4.Dataset, grid: Grid, bands: tuple[np.ndarray, np.ndarray], mapping: dict[str, Any]
) -> None:
    step = grid.transform
    system = file.createVariable("spatial_ref", "i4", ())
    wkt = grid.crs.to_wkt()
    transform = " ".join(f"{v:.12g}" for v in (step.c, step.a, step.b, step.f, step.d, step.e))
    system.setncatts({"crs_wkt": wkt, "spatial_ref": wkt, "GeoTransform": transform} | mapping)
    for name, values in (("x", grid.x), ("y", grid.y)):
        one = file.createVariable(name, "f8", (name,))
        one.setncatts({"units": "m", "standard_name": f"projection_{name}_coordinate", "axis": name.upper()})
        one[:] = values
    for name, values in (("wavelength", bands[0]), ("fwhm", bands[1])):
        one = file.createVariable(name, "f8", ("wavelength",))
        one.setncatts({"units": "nm"} | ({"standard_name": "radiation_wavelength"} if name == "wavelength" else {}))
        one[:] = values
