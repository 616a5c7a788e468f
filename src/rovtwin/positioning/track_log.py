"""A track as a log: what was estimated, and readings that identification takes as those of a position sensor."""

import json
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rovtwin.core.frames import euler_from_quaternion
from rovtwin.core.log import Channel, Log, Series
from rovtwin.core.numerics import jax, jnp
from rovtwin.positioning.track import Track

_euler = jax.jit(jax.vmap(euler_from_quaternion))
XYZ, UVW = ("x", "y", "z"), ("vx", "vy", "vz")


def track_log(track: Track, source: Log | None = None, metadata: dict[str, Any] | None = None) -> Log:
    """The log of a track.

    Channels `track/*` are the estimate and what it rests on. `sensor/position` has the fixes of single frames, whose
    noise is independent and stands in the metadata, beside commands and the other sensors of the source: `rovtwin
    identify` reads the log as it would one with a position sensor. Of the source's truth and its own position sensor
    nothing is taken. Its attitude is turned by the estimated offset, so that it has the north that the positions have.

    Args:
        track: The track.
        source: Log that the recording was made with.
        metadata: Added to the provenance.
    """
    channels, data = _own(track)
    entries: dict[str, Any] = dict(source.metadata) if source else {}
    if source is not None:
        for name in source:
            if name == "autopilot/command" or (name.startswith("sensor/") and name != "sensor/position"):
                channels.append(source.channels[name])
                data[name] = (source[name].t, source[name].values)
        if "sensor/attitude" in data:
            data["sensor/attitude"] = source["sensor/attitude"].t, _turned(source["sensor/attitude"], track.offset)
        entries = {key: value for key, value in entries.items() if key not in ("created", "log_format")}
    if "sensor/position" in data:
        sheets = json.loads(entries.get("sensors", "{}"))
        noise = np.nanmedian(track.fix_std[:, :2], axis=0).tolist()
        sheets["position"] = {"noise": noise, "lever": [0.0, 0.0, 0.0], "rotation": np.eye(3).tolist()}
        entries["sensors"] = json.dumps(sheets)
    entries |= {"track_method": track.method, "track_notes": list(track.notes)} | (metadata or {})
    if track.offset.any():
        entries["track_attitude_offset"] = json.dumps(
            {"rotation_vector_n": track.offset.tolist(), "std": track.offset_std.tolist(), "applied": True}
        )
    return Log.from_arrays(channels, data, entries)


def _turned(series: Series, offset: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n fields"]:
    """Values of an attitude channel with an offset taken out, a rotation vector in n [rad]."""
    values = series.values.copy()
    if offset.any():
        columns = [series.channel.index(angle) for angle in ("psi", "theta", "phi")]
        turned = Rotation.from_rotvec(offset) * Rotation.from_euler("ZYX", values[:, columns])
        values[:, columns] = turned.as_euler("ZYX")
    return values


def _own(track: Track) -> tuple[list[Channel], dict[str, tuple[np.ndarray, np.ndarray]]]:
    euler = np.asarray(_euler(jnp.asarray(track.attitude)))
    both = XYZ + UVW
    table = [
        ("track/eta", XYZ + ("phi", "theta", "psi"), ("m",) * 3 + ("rad",) * 3, "n", "estimated pose of CO",
         np.concatenate([track.position, euler], axis=1)),
        ("track/velocity", XYZ, "m/s", "n", "estimated velocity of CO", track.velocity),
        ("track/markers", ("seen", "used", "rejected"), "1", "", "markers in each frame", track.counts),
    ]  # fmt: skip
    if np.isfinite(track.std).all():
        std = tuple(f"std_{name}" for name in both)
        units = ("m",) * 3 + ("m/s",) * 3
        table.append(("track/std", std, units, "n", "standard deviation of position and velocity", track.std))
    channels = [
        Channel(name, fields, unit, frame, description=description)
        for name, fields, unit, frame, description, _ in table
    ]
    data = {row[0]: (track.t, row[-1]) for row in table}
    there = np.isfinite(track.fix).all(axis=1)
    if there.any():
        t, fix = track.t[there], track.fix[there]
        units = ("m",) * 6
        fields = ("north", "east", "down", "std_north", "std_east", "std_down")
        channels.append(Channel("track/fix", fields, units, "n", description="position from each frame alone"))
        data["track/fix"] = t, np.concatenate([fix, track.fix_std[there]], axis=1)
        position = Channel(
            "sensor/position",
            ("north", "east", "t_valid"),
            ("m", "m", "s"),
            "n",
            description="from markers, frame by frame",
        )
        channels.append(position)
        data["sensor/position"] = t, np.concatenate([fix[:, :2], t[:, None]], axis=1)
    for marker in track.markers:
        name = f"map/marker_{marker.id}"
        while name in data:  # a marker that was moved is two
            name += "_moved"
        quaternion = ("qw", "qx", "qy", "qz")
        channels.append(Channel(name, XYZ + quaternion, ("m",) * 3 + ("1",) * 4, "n", description="place on the map"))
        data[name] = track.t[-1:], np.concatenate([marker.position, marker.attitude])[None]
    return channels, data
