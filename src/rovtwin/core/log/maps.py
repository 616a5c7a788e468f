"""Logs on a map: tracks and way-points as GeoJSON for QGIS, GPX for chart plotters, KML for Google Earth."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from rovtwin.core.datum import Datum, datum_of
from rovtwin.core.errors import LogError
from rovtwin.core.log.files import atomic
from rovtwin.core.log.missions import missions_of, point_name
from rovtwin.core.log.reader import Log, Series

# Channels that are tracks, and what people call them.
TRACKS = {"truth/eta": "truth", "autopilot/eta": "estimate"}


@dataclass(frozen=True)
class Track:
    """Where the vehicle was.

    Attributes:
        name: For people.
        t: On the run's clock [s], shape (N,).
        coordinates: Longitude, latitude [deg] and height over the ellipsoid [m], shape (N, 3). Longitudes pass 180
            without a jump.
        depth: Below the water [m], shape (N,).
    """

    name: str
    t: np.ndarray
    coordinates: np.ndarray
    depth: np.ndarray

    @property
    def shape(self) -> str:
        """What GeoJSON and KML call it: one point is no line."""
        return "LineString" if len(self.t) > 1 else "Point"


@dataclass(frozen=True)
class Map:
    """What of a log can be drawn on a map; way-points are tracks of one point, at time zero."""

    name: str
    datum: Datum
    tracks: list[Track]
    waypoints: list[Track]


def export_map(log: Log, path: str | Path, overwrite: bool = False) -> Path:
    """Write tracks (truth and estimate, all samples) and way-points for a map; returns the path.

    Args:
        log: The log; its metadata must hold a datum.
        path: The file to write; the ending says as what: `.geojson` (RFC 7946), `.gpx` (1.1) or `.kml` (2.2).
        overwrite: Whether a file that exists may be replaced.

    Raises:
        LogError: The log has no datum or nothing to draw, the ending is another, or the file can't be written.
    """
    path = Path(path)
    if path.suffix not in WRITERS:
        raise LogError(f"{path}: found the ending {path.suffix!r}, expected {', '.join(WRITERS)}")
    text = WRITERS[path.suffix](map_of(log))
    with atomic(path, overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def tracks_in(log: Log) -> dict[str, str]:
    """Channels of a log that are tracks, with what people call them: x, y, z are a place in n."""
    return {name: title for name, title in TRACKS.items() if name in log and {*"xyz"} <= {*log.channels[name].fields}}


def places(series: Series) -> np.ndarray:
    """North, east, down [m] of a track, shape (N, 3)."""
    return np.column_stack([series[field] for field in "xyz"])


def map_of(log: Log) -> Map:
    """Tracks and way-points of a log.

    Raises:
        LogError: It has no datum, or nothing to draw.
    """
    datum = datum_of(log.metadata)
    if datum is None:
        raise LogError(
            f"{log.source}: has no datum, so nobody knows where on the map it is; runs of this version have one. "
            "Fly its scenario again, or export to .nc or CSV"
        )
    found = [_track(title, log[name].t, places(log[name]), datum) for name, title in tracks_in(log).items()]
    tracks = [track for track in found if len(track.t)]
    waypoints = [_track(label, np.zeros(1), place[None], datum) for label, place in _waypoints(log)]
    if not tracks and not waypoints:
        raise LogError(f"{log.source}: has neither {' nor '.join(TRACKS)} nor way-points: nothing to draw on a map")
    return Map(log.metadata.get("name") or Path(log.source).stem, datum, tracks, waypoints)


def _track(name: str, t: np.ndarray, place: np.ndarray, datum: Datum) -> Track:
    """Places in n on the map; what is not finite is left out."""
    known = np.isfinite(place).all(axis=1)
    t, place = t[known], place[known]
    latitude, longitude, height = datum.geodetic(place)
    longitude = datum.longitude + (longitude - datum.longitude + 180.0) % 360.0 - 180.0
    return Track(name, t, np.column_stack([longitude, latitude, height]), place[:, 2])


def _waypoints(log: Log) -> list[tuple[str, np.ndarray]]:
    """Name and place in n of the way-points in the metadata, of all missions that were flown."""
    missions = missions_of(log.metadata)
    try:
        return [
            (point_name(missions, i, k), np.array(point["position"], dtype=float).reshape(3))
            for i, mission in enumerate(missions)
            for k, point in enumerate(mission.waypoints)
        ]
    except (ValueError, TypeError, KeyError):
        return []


def _rows(track: Track) -> list[list[float]]:
    """Longitude, latitude to 9 digits (0.1 mm) and height to 1 mm."""
    degrees, heights = np.round(track.coordinates[:, :2], 9), np.round(track.coordinates[:, 2:], 3)
    return [[*degree, *height] for degree, height in zip(degrees.tolist(), heights.tolist(), strict=True)]


def _geojson(found: Map) -> str:
    """RFC 7946: longitude first, heights over the ellipsoid [m]; a feature a line, so that versions can be compared."""
    features = [_feature(track, _about_track(track, found.datum)) for track in found.tracks]
    features += [_feature(point, {"kind": "way-point", "depth_m": float(point.depth[0])}) for point in found.waypoints]
    lines = ",\n".join(json.dumps(feature) for feature in features)
    head = json.dumps({"name": found.name, "datum": json.loads(found.datum.metadata())})[1:-1]
    return f'{{"type": "FeatureCollection", {head}, "features": [\n{lines}\n]}}\n'


def _feature(track: Track, properties: dict[str, Any]) -> dict[str, Any]:
    rows = _rows(track)
    geometry = {"type": track.shape, "coordinates": rows if track.shape == "LineString" else rows[0]}
    return {"type": "Feature", "geometry": geometry, "properties": {"name": track.name} | properties}


def _about_track(track: Track, datum: Datum) -> dict[str, Any]:
    start, end = _utc(datum, track.t[[0, -1]])
    return {"kind": "track", "utc_start": start, "utc_end": end}


def _utc(datum: Datum, t: np.ndarray) -> list[str]:
    return [f"{text}Z" for text in np.datetime_as_string(datum.utc(t), unit="ms").tolist()]


def _gpx(found: Map) -> str:
    """GPX 1.1: elevation is that over the mean water level, minus the depth."""
    root = ElementTree.Element(
        "gpx", {"xmlns": "http://www.topografix.com/GPX/1/1", "version": "1.1", "creator": "rovtwin"}
    )
    ElementTree.SubElement(ElementTree.SubElement(root, "metadata"), "name").text = found.name
    for point in found.waypoints:
        place = _gpx_point(root, "wpt", _rows(point)[0], float(point.depth[0]))
        ElementTree.SubElement(place, "name").text = point.name
    for track in found.tracks:
        line = ElementTree.SubElement(root, "trk")
        ElementTree.SubElement(line, "name").text = track.name
        segment = ElementTree.SubElement(line, "trkseg")
        for row, depth, time in zip(_rows(track), track.depth.tolist(), _utc(found.datum, track.t), strict=True):
            ElementTree.SubElement(_gpx_point(segment, "trkpt", row, depth), "time").text = time
    return xml_text(root)


def _gpx_point(parent: ElementTree.Element, tag: str, row: list[float], depth: float) -> ElementTree.Element:
    longitude = (row[0] + 180.0) % 360.0 - 180.0
    point = ElementTree.SubElement(parent, tag, {"lat": f"{row[1]:.9f}", "lon": f"{longitude:.9f}"})
    ElementTree.SubElement(point, "ele").text = height_text(depth)
    return point


def height_text(depth: float) -> str:
    """Above the water to 1 mm [m]; at the surface 0, without a sign."""
    return f"{round(-depth, 3) + 0.0:.3f}"


def _kml(found: Map) -> str:
    """KML 2.2: altitude is that over the sea, minus the depth."""
    root = ElementTree.Element("kml", {"xmlns": "http://www.opengis.net/kml/2.2"})
    document = ElementTree.SubElement(root, "Document")
    ElementTree.SubElement(document, "name").text = found.name
    for track in [*found.tracks, *found.waypoints]:
        mark = ElementTree.SubElement(document, "Placemark")
        ElementTree.SubElement(mark, "name").text = track.name
        shape = ElementTree.SubElement(mark, track.shape)
        ElementTree.SubElement(shape, "altitudeMode").text = "absolute"
        rows = zip(_rows(track), track.depth.tolist(), strict=True)
        text = " ".join(f"{row[0]:.9f},{row[1]:.9f},{height_text(depth)}" for row, depth in rows)
        ElementTree.SubElement(shape, "coordinates").text = text
    return xml_text(root)


def xml_text(root: ElementTree.Element) -> str:
    """A document with its declaration, indented."""
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


WRITERS: dict[str, Callable[[Map], str]] = {".geojson": _geojson, ".gpx": _gpx, ".kml": _kml}
