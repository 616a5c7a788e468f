"""Areas to be surveyed: polygons with holes from GeoJSON (WGS-84) or from a YAML file in metres, into the plane of n.

Reference: Butler et al. (2016), The GeoJSON format, RFC 7946: positions are longitude, latitude.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import Field

from rovtwin.core.datum import FARTHEST, Datum, check_coordinates, coordinates_text
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files import files as given
from rovtwin.core.user_files.config import Number, Strict, parse
from rovtwin.core.user_files.jsontext import parse_json
from rovtwin.core.user_files.quantity import is_number
from rovtwin.core.user_files.yamlfile import kind_in_words, read_yaml
from rovtwin.survey.library import shapely_library

SMALLEST = 1e-4  # less is no area [m^2]
_ON_EARTH = ("CRS84", "EPSG::4326", "EPSG:4326")
_ENDINGS = {".geojson": "GeoJSON", ".json": "GeoJSON", ".yaml": "metres", ".yml": "metres"}

Place = Annotated[list[Number], Field(min_length=2, max_length=2)]
Outline = Annotated[list[Place], Field(min_length=3)]
Ring = tuple[str, np.ndarray]  # where it stands in the file; its corners, shape (n, 2)


class AreaFile(Strict):
    """An area in metres; corners are [north, east]."""

    outline: Outline = Field(description="corners [north, east] [m], in order")
    holes: list[Outline] = Field(default_factory=list, description="what to keep out of: corners of each")


@dataclass(frozen=True, eq=False)
class Area:
    """What is to be surveyed.

    Attributes:
        shape: A shapely MultiPolygon in the plane of n: x north, y east [m].
        datum: Origin of n.
        name: Of the file, without its ending.
    """

    shape: Any
    datum: Datum
    name: str


def read_area(path: str | Path, datum: Datum | None = None, slivers: bool = False) -> Area:
    """An area from a file.

    Args:
        path: `.geojson` or `.json` with longitude and latitude, `.yaml` or `.yml` with metres (`AreaFile`).
        datum: Origin of n; None puts it into the middle of an area on the map, to six digits of a degree.
        slivers: Whether polygons without area, as a program may have left them, are passed over.

    Raises:
        ConfigError: No such file, not an area, or one that nobody can have meant.
    """
    path = Path(path)
    kind = _ENDINGS.get(path.suffix.lower())
    if kind is None:
        raise ConfigError(f"{path}: expected a GeoJSON file (.geojson, .json) or metres in YAML (.yaml, .yml)")
    if kind == "metres":
        file = parse(AreaFile, read_yaml(path), path.name)
        holes = ((f"holes[{i}]", np.array(hole)) for i, hole in enumerate(file.holes))
        polygons = [[("outline", np.array(file.outline)), *holes]]
        datum = datum or Datum()
    else:
        polygons = _found(path)
        if not polygons:
            raise ConfigError(f"{path.name}: has no Polygon or MultiPolygon, expected at least one")
        datum = datum or _middle(polygons, path.name)
    on_map = datum if kind == "GeoJSON" else None
    if slivers:
        polygons = [rings for rings in polygons if _area(rings, on_map) >= SMALLEST] or polygons[:1]
    shapes = [_polygon(rings, on_map, path.name) for rings in polygons]
    _require_near(polygons, shapes, datum, path.name, on_map=kind == "GeoJSON")
    shapely = shapely_library()
    whole = shapely.union_all(shapes)
    return Area(whole if whole.geom_type == "MultiPolygon" else shapely.MultiPolygon([whole]), datum, path.stem)


def read_json(path: Path) -> dict[str, Any]:
    """A GeoJSON object, in WGS-84 as far as it says so.

    Raises:
        ConfigError: No such file, not JSON, or of another coordinate system.
    """
    if not given.is_file(path):
        read_yaml(path)  # says what is wrong with the path
    try:
        data = parse_json(given.read_text(path), path.name)
    except UnicodeDecodeError:
        raise ConfigError(f"{path.name}: is not JSON text, expected GeoJSON") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{path.name}: found {kind_in_words(data)}, expected GeoJSON: an object with a type")
    require_on_earth(data, path.name)
    return data


def require_on_earth(data: dict[str, Any], where: str) -> None:
    """Raise ConfigError where a GeoJSON object names another coordinate system than WGS-84."""
    crs = data.get("crs")
    if crs is not None and not any(known in json.dumps(crs) for known in _ON_EARTH):
        raise ConfigError(f"{where}: crs: found {json.dumps(crs)[:80]}, expected WGS-84: export it as EPSG:4326")


def _found(path: Path) -> list[list[Ring]]:
    data = read_json(path)
    try:
        return list(_polygons(data, ""))
    except ConfigError as error:
        raise ConfigError(f"{path.name}: {error}") from None


def _polygons(data: Any, where: str) -> Iterator[list[Ring]]:
    """Rings of each polygon in a GeoJSON object, the outline first."""
    dot = f"{where}." if where else ""
    kind = data.get("type") if isinstance(data, dict) else None
    match kind:
        case "FeatureCollection":
            for i, feature in enumerate(_list(data.get("features"), f"{dot}features")):
                yield from _polygons(feature, f"{dot}features[{i}]")
        case "GeometryCollection":
            for i, geometry in enumerate(_list(data.get("geometries"), f"{dot}geometries")):
                yield from _polygons(geometry, f"{dot}geometries[{i}]")
        case "Feature":
            yield from _polygons(data.get("geometry"), f"{dot}geometry")
        case "Polygon":
            yield _rings(data.get("coordinates"), f"{dot}coordinates")
        case "MultiPolygon":
            for i, rings in enumerate(_list(data.get("coordinates"), f"{dot}coordinates")):
                yield _rings(rings, f"{dot}coordinates[{i}]")
        case _:
            found = repr(kind) if isinstance(data, dict) else kind_in_words(data)
            raise ConfigError(f"{dot}type: found {found}, expected Polygon, MultiPolygon, Feature or FeatureCollection")


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise ConfigError(f"{where}: found {kind_in_words(value)}, expected a list that is not empty")
    return value


def _rings(value: Any, where: str) -> list[Ring]:
    return [(f"{where}[{i}]", _corners(ring, f"{where}[{i}]")) for i, ring in enumerate(_list(value, where))]


def _corners(ring: Any, where: str) -> Float[np.ndarray, "n 2"]:
    """Longitude and latitude of a ring, shape (n, 2) [deg]; a height is left out."""
    corners = []
    for i, place in enumerate(_list(ring, where)):
        good = isinstance(place, list) and len(place) >= 2 and all(is_number(value) for value in place[:2])
        if not good:
            raise ConfigError(f"{where}[{i}]: found {kind_in_words(place)}, expected [longitude, latitude] in degrees")
        try:
            check_coordinates(place[1], place[0])
        except ConfigError as error:
            raise ConfigError(f"{where}[{i}]: {error} GeoJSON has longitude first.") from None
        corners.append(place[:2])
    return np.array(corners, dtype=float)


def _polygon(rings: list[Ring], datum: Datum | None, file: str) -> Any:
    """One polygon in the plane of n; `datum` converts rings on the map, None leaves metres as they are."""
    shapely = shapely_library()
    for where, corners in rings:
        if len(np.unique(corners, axis=0)) < 3:
            raise ConfigError(f"{file}: {where}: found {len(np.unique(corners, axis=0))} corners, expected at least 3")
    metres = [_in_plane(corners, datum) for _, corners in rings]
    if shapely.convex_hull(shapely.LineString(metres[0])).area < SMALLEST:
        raise ConfigError(f"{file}: {rings[0][0]}: found corners on one line, an area of zero; expected an outline")
    shape = shapely.Polygon(metres[0], metres[1:])
    if not shape.is_valid:
        # Said in the file's own numbers, so that the place can be found there.
        own = shapely.Polygon(rings[0][1], [corners for _, corners in rings[1:]])
        raise ConfigError(
            f"{file}: {rings[0][0]}: {shapely.is_valid_reason(own if not own.is_valid else shape)}; expected an "
            "outline that does not cross itself, holes inside it and apart from each other"
        )
    if shape.area < SMALLEST:
        raise ConfigError(f"{file}: {rings[0][0]}: the holes leave an area of zero")
    return shape


def _area(rings: list[Ring], datum: Datum | None) -> float:
    metres = [_in_plane(corners, datum) for _, corners in rings]
    return float(shapely_library().Polygon(metres[0], metres[1:]).area) if len(metres[0]) > 2 else 0.0


def _in_plane(corners: Float[np.ndarray, "n _"], datum: Datum | None) -> Float[np.ndarray, "n 2"]:
    return corners if datum is None else datum.position(corners[:, 1], corners[:, 0], np.zeros(len(corners)))[:, :2]


def _middle(polygons: list[list[Ring]], file: str) -> Datum:
    corners = np.concatenate([rings[0][1] for rings in polygons])
    low, high = corners.min(0), corners.max(0)
    if (high - low).max() > 180:
        raise ConfigError(f"{file}: reaches across the date line or half the Earth: give the datum, and split it there")
    longitude, latitude = np.round(0.5 * (low + high), 6)
    return Datum(float(latitude), float(longitude))


def _require_near(polygons: list[list[Ring]], shapes: list[Any], datum: Datum, file: str, on_map: bool) -> None:
    """ConfigError where an area lies so far from the datum that one of them must be wrong."""
    for rings, shape in zip(polygons, shapes, strict=True):
        away = max(abs(value) for value in shape.bounds)
        if on_map:
            longitude, latitude = rings[0][1].mean(0)
            away = max(away, float(datum.distance(latitude, longitude)))
        if away <= FARTHEST:
            continue
        where = f"{file}: {rings[0][0]}: reaches {away / 1000:,.0f} km from the datum"
        if not on_map:
            raise ConfigError(f"{where}, expected metres, at most {FARTHEST / 1000:.0f} km; degrees go into GeoJSON")
        swapped = abs(longitude) <= 90 and float(datum.distance(longitude, latitude)) <= FARTHEST
        fix = (
            "latitude and longitude are swapped, GeoJSON has longitude first"
            if swapped
            else f"mend it, or lay the datum there: --datum {latitude:.6f},{longitude:.6f} (or --datum auto)"
        )
        raise ConfigError(
            f"{where} at {coordinates_text(datum.latitude, datum.longitude)}, "
            f"expected at most {FARTHEST / 1000:.0f} km: {fix}"
        )
