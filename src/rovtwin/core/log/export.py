"""Logs for other programs: netCDF for xarray, MATLAB and archives, CSV for the rest."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rovtwin.core.datum import INVERSE_FLATTENING, SEMI_MAJOR_AXIS, Datum, datum_of
from rovtwin.core.log.channel import unique
from rovtwin.core.log.files import atomic, exists_error, write_error
from rovtwin.core.log.maps import places, tracks_in
from rovtwin.core.log.reader import Log, Series

if TYPE_CHECKING:
    from netCDF4 import Dataset

_TIME_COMMENT = "seconds since the start of the run on its own clock (k * dt); utc_start, where given, is its zero"
_CRS = "crs"  # no channel's variable is called so: those have an underscore
_WGS84 = {
    "grid_mapping_name": "latitude_longitude",
    "semi_major_axis": SEMI_MAJOR_AXIS,
    "inverse_flattening": INVERSE_FLATTENING,
    "longitude_of_prime_meridian": 0.0,
    "geographic_crs_name": "WGS 84",
    "horizontal_datum_name": "World Geodetic System 1984",
}


def export_netcdf(log: Log, path: str | Path, title: str = "", overwrite: bool = False) -> Path:
    """Write a log as netCDF4 under the CF conventions, version 1.11; returns the path.

    Every field of a channel becomes a variable such as `truth_position_x` on the channel's own `truth_position_time`.
    Variables are flat because xarray opens only the root group, and one-dimensional because the fields of a channel may
    differ in unit, of which CF allows one a variable. Where the metadata hold a datum, the tracks have latitude and
    longitude beside them.

    Args:
        log: The log.
        path: The file to write, by custom with the ending `.nc`.
        title: Title of the data set; by default where the log is from.
        overwrite: Whether a file that exists may be replaced.

    Raises:
        LogError: The file can't be written, or it exists.
    """
    import netCDF4

    path, taken, datum, tracks = Path(path), set(), datum_of(log.metadata), tracks_in(log)
    try:
        with atomic(path, overwrite) as temporary, netCDF4.Dataset(temporary, "w", format="NETCDF4") as dataset:
            for name in log:
                _add_channel(dataset, log[name], taken, datum if name in tracks else None)
            dataset.setncatts(_global_attributes(log, title))
    except RuntimeError as error:  # of the netCDF library, such as a full disk
        raise write_error(path, error) from error
    return path


def export_csv(log: Log, path: str | Path, channel: str | None = None, overwrite: bool = False) -> list[Path]:
    """Write a folder with a CSV file for every channel, their units and frames in `channels.csv`, and `metadata.json`.

    Every number is written in the fewest digits that give the same double when read.

    Args:
        log: The log.
        path: The folder; with `channel`, the file.
        channel: Write only this channel.
        overwrite: Whether files that exist may be replaced.

    Returns:
        The paths written.

    Raises:
        LogError: There is no such channel, or a file can't be written or exists.
    """
    path = Path(path)
    if channel is not None:
        return [_write_text(path, _csv(log[channel]), overwrite)]
    taken = {"channels", "metadata"}
    files = {name: path / f"{unique(_flat(name), taken)}.csv" for name in log.channels}
    texts = {
        path / "channels.csv": _channel_table(log, files),
        path / "metadata.json": json.dumps(log.metadata, indent=2) + "\n",
    }
    existing = [file for file in (*files.values(), *texts) if file.exists()]
    if existing and not overwrite:
        raise exists_error(existing[0])
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise write_error(path, error) from error
    written = [_write_text(file, _csv(log[name]), overwrite) for name, file in files.items()]
    return written + [_write_text(file, text, overwrite) for file, text in texts.items()]


def _add_channel(dataset: Dataset, series: Series, taken: set[str], datum: Datum | None) -> None:
    channel, base = series.channel, _flat(series.channel.name)
    time = unique(f"{base}_time", taken)
    # A coordinate variable of CF has no value twice; a channel that has a time twice gets a dimension of samples.
    twice = bool((np.diff(series.t) <= 0).any())
    dimension = unique(f"{base}_sample", taken) if twice else time
    dataset.createDimension(dimension, len(series))
    # No standard_name "time" and no axis "T": those ask for "seconds since" a date, which this clock doesn't have.
    about: dict[str, str | float] = {"units": "s", "long_name": f"time of {channel.name}", "comment": _TIME_COMMENT}
    _add_variable(dataset, time, dimension, series.t, about)
    names = [unique(f"{base}_{field}", taken) for field in channel.fields]
    beside = [time] if twice else []
    if datum is not None:
        beside += _add_coordinates(dataset, series, dimension, taken, datum)
    for k, (field, unit) in enumerate(zip(channel.fields, channel.units, strict=True)):
        about = {
            "units": unit,
            "long_name": f"{channel.name} {field}",
            "channel": channel.name,
            "field": field,
            "frame": channel.frame,
            "comment": channel.description,
            "coordinates": " ".join(beside),
            "grid_mapping": _CRS if datum is not None else "",
        }
        if channel.rate is not None:
            about["nominal_rate_hz"] = channel.rate
        _add_variable(dataset, names[k], dimension, series.values[:, k], about)


def _add_variable(
    dataset: Dataset, name: str, dimension: str, values: np.ndarray, attributes: Mapping[str, str | float]
) -> None:
    """A variable of doubles; attributes that are empty are left out."""
    variable = dataset.createVariable(name, "f8", (dimension,), compression="zlib", complevel=1)
    variable.setncatts({key: value for key, value in attributes.items() if value != ""})
    variable[:] = values


def _add_coordinates(dataset: Dataset, series: Series, dimension: str, taken: set[str], datum: Datum) -> list[str]:
    """Latitude and longitude of a track, and once the ellipsoid they refer to; returns their names."""
    if _CRS not in dataset.variables:
        dataset.createVariable(_CRS, "i4").setncatts(_WGS84)
    base, names = _flat(series.channel.name), []
    latitude, longitude, _ = datum.geodetic(places(series))
    for what, unit, values in (("latitude", "degrees_north", latitude), ("longitude", "degrees_east", longitude)):
        about = {"standard_name": what, "units": unit, "long_name": f"{what} of {series.channel.name}"}
        names.append(unique(f"{base}_{what}", taken))
        _add_variable(dataset, names[-1], dimension, values, about)
    return names


def _global_attributes(log: Log, title: str) -> Mapping[str, str]:
    now = datetime.now(UTC).isoformat(timespec="seconds")
    provenance = {re.sub(r"\W", "_", f"rovtwin_{key}", flags=re.ASCII): value for key, value in log.metadata.items()}
    version, datum = log.metadata.get("version", ""), datum_of(log.metadata)
    # Time zero of all channels; time_coverage_start is what catalogues look for (ACDD 1.3).
    start = {} if datum is None else {"utc_start": datum.utc_start, "time_coverage_start": datum.utc_start}
    return {
        "Conventions": "CF-1.11",
        "title": title or f"rovtwin log {Path(log.source).name}",
        "history": f"{now} exported from {Path(log.source).name}",
        "source": f"rovtwin {version}".strip(),
        **start,
        **provenance,
    }


def _csv(series: Series) -> str:
    channel = series.channel
    header = ["t [s]", *(f"{field} [{unit}]" for field, unit in zip(channel.fields, channel.units, strict=True))]
    rows = (",".join(map(repr, (t, *row))) for t, row in zip(series.t.tolist(), series.values.tolist(), strict=True))
    return "\n".join([",".join(map(_quoted, header)), *rows]) + "\n"


def _channel_table(log: Log, files: Mapping[str, Path]) -> str:
    lines = [["channel", "file", "samples", "fields", "unit", "frame", "rate [Hz]", "description"]]
    for name, file in files.items():
        channel = log.channels[name]
        lines.append(
            [
                name,
                file.name,
                str(len(log[name])),
                " ".join(channel.fields),
                "; ".join(channel.units),
                channel.frame,
                "" if channel.rate is None else repr(channel.rate),
                channel.description,
            ]
        )
    return "".join(",".join(map(_quoted, line)) + "\n" for line in lines)


def _quoted(cell: str) -> str:
    return '"' + cell.replace('"', '""') + '"' if any(mark in cell for mark in ',"\n') else cell


def _write_text(path: Path, text: str, overwrite: bool) -> Path:
    with atomic(path, overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _flat(name: str) -> str:
    return name.replace("/", "_")
