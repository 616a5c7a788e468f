"""What a mosaic shows as points and polygons: GeoJSON in longitude and latitude, and navigation as Immersion reads it.

References: RFC 7946. Immersion's CSV has no header: dd.mm.yyyy, hh:mm:ss.sss, easting, northing, pitch, roll, heading
[deg], depth, altitude [m].
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from rovtwin.core.datum import Datum
from rovtwin.core.log.files import write_error
from rovtwin.core.user_files.files import write_text
from rovtwin.mapping.cells.grid import Grid
from rovtwin.mapping.navigation import Navigation
from rovtwin.mapping.projection import Projection

_LEAST = 4  # cells of a gap that is worth a line


def write_geojson(path: Path, features: list[dict[str, Any]], **about: Any) -> Path:
    """Write a collection of features.

    Raises:
        LogError: It cannot be written.
    """
    try:
        write_text(path, json.dumps({"type": "FeatureCollection", **about, "features": features}, indent=1))
    except OSError as error:
        raise write_error(path, error) from error
    return path


def polygons(mask: Bool[np.ndarray, "row column"], grid: Grid, least: int = _LEAST) -> list[dict[str, Any]]:
    """Features of the connected areas of a mask, largest first, each with its `area_m2`."""
    from rasterio.features import shapes, sieve
    from rasterio.warp import transform_geom

    clean = sieve(mask.astype(np.uint8), max(least, 2)).astype(bool) & mask if mask.any() else mask
    found = []
    for shape, value in shapes(clean.astype(np.uint8), mask=clean, transform=grid.transform):
        if value:
            area = _area(shape["coordinates"])
            there: Any = transform_geom(grid.crs, "EPSG:4326", shape, precision=9)
            found.append({"type": "Feature", "properties": {"area_m2": round(area, 6)}, "geometry": dict(there)})
    return sorted(found, key=lambda feature: -feature["properties"]["area_m2"])


def _area(rings: list[Any]) -> float:
    """Of a polygon with holes, by the shoelace formula [m2]."""
    total = 0.0
    for k, ring in enumerate(rings):
        x, y = np.asarray(ring, float).T
        x, y = x - x[0], y - y[0]
        size = 0.5 * abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])))
        total += size if k == 0 else -size
    return total


def point(datum: Datum, position: Float[np.ndarray, "3"], **properties: Any) -> dict[str, Any]:
    """A feature at a place in n [m]."""
    where = {"type": "Point", "coordinates": _coordinates(datum, position)}
    return {"type": "Feature", "properties": properties, "geometry": where}


def line(datum: Datum, positions: Float[np.ndarray, "k 3"], **properties: Any) -> dict[str, Any]:
    """A feature along places in n [m]."""
    where = {"type": "LineString", "coordinates": [_coordinates(datum, position) for position in positions]}
    return {"type": "Feature", "properties": properties, "geometry": where}


def _coordinates(datum: Datum, position: Float[np.ndarray, "3"]) -> list[float]:
    latitude, longitude, _ = datum.geodetic(position)
    return [round(float(longitude), 10), round(float(latitude), 10)]


def write_immersion(
    path: Path,
    navigation: Navigation,
    datum: Datum,
    projection: Projection,
    altitude: Float[np.ndarray, " k"] | None = None,
) -> Path:
    """Navigation as Immersion reads it, one row for each pose.

    Args:
        path: To write.
        navigation: Of the vehicle's CO.
        datum: Of its times.
        projection: To easting and northing.
        altitude: Over the floor at each pose [m]; -1 where unknown.

    Raises:
        LogError: It cannot be written.
    """
    q = navigation.quaternion[:, [1, 2, 3, 0]]
    heading, pitch, roll = np.degrees(Rotation.from_quat(q).as_euler("ZYX")).T
    easting, northing = projection.to_map(navigation.position[:, :2]).T
    high = np.full(len(q), -1.0) if altitude is None else np.nan_to_num(altitude, nan=-1.0)
    rows = []
    for k, when in enumerate(datum.utc(navigation.t).astype("datetime64[ms]").astype(object)):
        stamp = f"{when:%d.%m.%Y},{when:%H:%M:%S}.{when.microsecond // 1000:03d}"
        figures = (easting[k], northing[k], pitch[k], roll[k], heading[k] % 360.0, navigation.position[k, 2], high[k])
        rows.append(f"{stamp}," + ",".join(f"{x:.4f}" for x in figures))
    try:
        write_text(path, "\n".join(rows) + "\n")
    except OSError as error:
        raise write_error(path, error) from error
    return path
