"""Tables of the report: sensors, mission, the vehicle's model, provenance."""

from typing import Any

import numpy as np

from rovtwin.core.datum import METADATA_KEY, coordinates_text
from rovtwin.core.log import Series
from rovtwin.report.flight import Flight
from rovtwin.report.parts.tables import Table, text


def sensor_table(flight: Flight) -> Table | None:
    """What each sensor delivered; None when there was no sensor."""
    live = flight.log.metadata.get("live") == "true"
    rows = [_sensor_row(name, series, live) for name, series in flight.sensors.items()]
    head = ["Sensor", "Measures", "Readings", "Rate [Hz]", "Nominal [Hz]", "Longest gap [s]", "Mean delay [ms]"]
    return Table("Sensors", head, rows, _OWN_CLOCK if live else "") if rows else None


# What is left of a time stamp then is the lateness of ticks and the variation of the way, of either sign.
_OWN_CLOCK = (
    "Over a link the delay is not known: readings are stamped when they come, or by a clock whose difference to ours "
    "is known only but for the shortest time under way."
)


def _sensor_row(name: str, series: Series, live: bool) -> list[str]:
    channel, t = series.channel, series.t
    units = dict(zip(channel.fields, channel.units, strict=True))
    values = [f for f in channel.fields if f not in ("t_valid", "valid")]
    span = float(t[-1] - t[0])
    rate = f"{(len(t) - 1) / span:.3g}" if span > 0 else "-"
    gap = f"{np.diff(t).max():.3g}" if len(t) > 1 else "-"
    delay = f"{1000 * np.nanmean(t - series['t_valid']):.1f}" if "t_valid" in channel.fields else "-"
    delay = "not known" if live else delay
    unit = sorted({units[f] for f in values})
    return [name, f"{', '.join(values)} [{', '.join(unit)}]", str(len(t)), rate,
            f"{channel.rate:g}" if channel.rate else "-", gap, delay]  # fmt: skip


def mission_table(flight: Flight) -> Table | None:
    """Way-points as commanded, and on the map where there is a datum; None without a mission."""
    known = [("x", "North [m]"), ("y", "East [m]"), ("z", "Depth [m]"), ("speed", "Speed [m/s]"),
             ("acceptance", "Acceptance [m]"), ("hold_time", "Hold [s]"), ("heading_deg", "Heading [deg]")]  # fmt: skip
    shown = [(key, label) for key, label in known if any(w.get(key) is not None for w in flight.waypoints)]
    rows = [[w["name"], *(text(_to_mm(w.get(key))) for key, _ in shown)] for w in flight.waypoints]
    head, note = ["Way-point", *(label for _, label in shown)], ""
    if len(flight.missions) > 1:
        head.append("Flown from [s]")
        rows = [[*row, f"{flight.missions[w['mission']].t:.1f}"] for row, w in zip(rows, flight.waypoints, strict=True)]
    if (datum := flight.datum) is not None and rows:
        head += ["Latitude [deg]", "Longitude [deg]"]
        places = np.array([[w["x"], w["y"], w.get("z") or 0.0] for w in flight.waypoints], dtype=float)
        degrees = np.stack(datum.geodetic(places)[:2], axis=1)
        rows = [[*row, *(f"{one:.7f}" for one in pair)] for row, pair in zip(rows, degrees, strict=True)]
        note = f"North and east from {coordinates_text(datum.latitude, datum.longitude)}, WGS 84."
    return Table("Mission", head, rows, note) if rows else None


def _to_mm(value: Any) -> Any:
    """A number to three digits: a way-point given as latitude and longitude is 1e-12 m off its neighbour's line."""
    return round(value, 3) if isinstance(value, float) else value


def fault_table(flight: Flight) -> Table | None:
    """What broke and when, by the numbers in the figures; None where nothing did."""
    end = flight.span[1]
    rows = [[str(f.number), f.what, f"{f.start:g}", "the end" if f.end >= end else f"{f.end:g}"] for f in flight.faults]
    return Table("Faults", ["Number", "What", "From [s]", "Until [s]"], rows) if rows else None


def manoeuvre_table(flight: Flight) -> Table | None:
    """What a test did and when; None where the log is of a mission."""
    spans = flight.json("test")
    if not isinstance(spans, list):
        return None
    rows = [
        [
            str(one["manoeuvre"]),
            one["what"] + (" (tilted by hand)" if one["hand"] else ""),
            *(f"{one[key]:.5g}" for key in ("start", "end")),
        ]
        for one in spans
    ]
    return Table("Manoeuvres", ["Number", "What", "From [s]", "Until [s]"], rows)


def provenance_table(flight: Flight) -> Table:
    """Where the log comes from: all short metadata."""
    long = {"scenario", "summary", "vehicle_table", "mission", "waves", "faults", "test", "sensors", "thrusters"}
    rows = [
        [key, value] for key, value in flight.log.metadata.items() if key not in long and not key.startswith("missions")
    ]
    if flight.datum is not None:
        rows = [[key, str(flight.datum) if key == METADATA_KEY else value] for key, value in rows]
    return Table("Provenance", ["Entry", "Value"], [*rows, *([["note", n] for n in flight.log.notes])])
