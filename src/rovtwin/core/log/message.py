"""How samples become bytes: one fixed-size CDR message a sample, described by a ROS 2 message definition.

A message is the stamp (`builtin_interfaces/Time`) followed by one float64 for every field. The stamp fills 8 bytes, so
every double lies on a multiple of 8 after the encapsulation header as CDR asks, nothing is padded, and a block of
samples is one numpy structured array.
"""

import json

import numpy as np
from numpy.typing import ArrayLike

from rovtwin.core.errors import LogError
from rovtwin.core.log.channel import Channel, unique

NANOSECONDS = 1_000_000_000
LATEST = 2**31  # s, the end of what a stamp holds
CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_TIME_DEFINITION = "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
HEADER_SIZE = 9  # of any MCAP record: opcode and length
MESSAGE_OPCODE = 5


def check_block(channel: Channel, t: ArrayLike, values: ArrayLike, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and samples as arrays that can be stored.

    Args:
        channel: What the samples should be.
        t: Times on the data clock [s], shape (N,).
        values: Samples, shape (N, n), or (N,) when n = 1.
        where: What a message starts with, such as the path of the log.

    Returns:
        Times, shape (N,), and samples, shape (N, n), float64.

    Raises:
        LogError: A shape is wrong, or a time isn't finite, is out of range or goes backwards.
    """
    times, samples, size = np.asarray(t, np.float64), np.asarray(values, np.float64), len(channel.fields)
    if times.ndim == samples.ndim == 1 and size == 1:
        samples = samples[:, None]
    if times.ndim != 1 or samples.shape != (len(times), size):
        raise LogError(
            f"{where}: {channel.name}: times of shape {times.shape} and values of shape {samples.shape}, expected "
            f"(N,) and (N, {size}) for the fields {', '.join(channel.fields)}"
        )
    bad = np.flatnonzero(~((times >= 0) & (times < LATEST)))
    if len(bad):
        raise LogError(
            f"{where}: {channel.name}: t = {times[bad[0]]} s at sample {bad[0]}, expected seconds since the start of "
            f"the data clock, from 0 to {LATEST}. Wall-clock time belongs in the metadata"
        )
    back = np.flatnonzero(np.diff(times) < 0)
    if len(back):
        raise backwards(channel, float(times[back[0] + 1]), float(times[back[0]]), where)
    return times, samples


def backwards(channel: Channel, t: float, previous: float, where: str) -> LogError:
    """The error for a time that goes backwards."""
    return LogError(
        f"{where}: {channel.name}: t = {t} s after t = {previous} s: time goes backwards. Write the samples of a "
        "channel in the order of their times"
    )


def record_dtype(size: int) -> np.dtype:
    """Layout of one MCAP message record that holds `size` doubles, without padding."""
    return np.dtype(
        [
            ("opcode", "u1"),
            ("length", "<u8"),
            ("channel", "<u2"),
            ("sequence", "<u4"),
            ("log_time", "<u8"),
            ("publish_time", "<u8"),
            ("encapsulation", "V4"),
            ("sec", "<i4"),
            ("nanosec", "<u4"),
            ("values", "<f8", (size,)),
        ]
    )


def encode(channel_id: int, sequence: int, stamps: np.ndarray, values: np.ndarray) -> bytes:
    """A block of MCAP message records.

    Args:
        channel_id: The channel's number in the file.
        sequence: Number of messages the channel has so far.
        stamps: Times [ns], shape (N,), int64.
        values: Samples, shape (N, n).
    """
    records = np.zeros(len(stamps), record_dtype(values.shape[1]))
    records["opcode"] = MESSAGE_OPCODE
    records["length"] = records.dtype.itemsize - HEADER_SIZE
    records["channel"] = channel_id
    records["sequence"] = (sequence + np.arange(len(stamps))) % 2**32
    records["log_time"] = records["publish_time"] = stamps
    records["encapsulation"] = np.void(CDR_LITTLE_ENDIAN)
    records["sec"], records["nanosec"] = np.divmod(stamps, NANOSECONDS)
    records["values"] = values
    return records.tobytes()


def to_nanoseconds(t: np.ndarray) -> np.ndarray:
    """Times [s], shape (N,), rounded to the nanoseconds they are stored in, int64."""
    return np.rint(np.asarray(t, np.float64) * NANOSECONDS).astype(np.int64)


def to_seconds(stamps: np.ndarray) -> np.ndarray:
    """Stored times [ns], shape (N,), as seconds: the double nearest to the decimal number."""
    return np.asarray(stamps).astype(np.float64) / NANOSECONDS


def message_type(channel: Channel, taken: set[str]) -> str:
    """Name of the channel's generated message type, such as `rovtwin_msgs/msg/TruthPosition`; adds it to `taken`."""
    words = channel.name.replace("/", "_").split("_")
    name = "rovtwin_msgs/msg/" + "".join(word[:1].upper() + word[1:] for word in words)
    return unique(name, taken, "")


def message_definition(channel: Channel) -> str:
    """The `ros2msg` schema of a channel. ROS 2 wants lower-case field names; the channel's own are in its metadata."""
    taken = {"stamp"}
    names = [unique("_".join(filter(None, field.lower().split("_"))), taken) for field in channel.fields]
    lines = [
        f"float64 {name}  # {field} [{unit}]"
        for name, field, unit in zip(names, channel.fields, channel.units, strict=True)
    ]
    return "\n".join(["builtin_interfaces/Time stamp", *lines, _TIME_DEFINITION])


def channel_metadata(channel: Channel) -> dict[str, str]:
    """What the file says about a channel beside its schema."""
    return {
        "fields": json.dumps(channel.fields),
        "unit": json.dumps(channel.unit),
        "frame": channel.frame,
        "description": channel.description,
        "rate": "" if channel.rate is None else repr(channel.rate),
    }


def channel_from_metadata(topic: str, metadata: dict[str, str]) -> Channel | None:
    """The channel that `channel_metadata` described, or None when the metadata are not ours."""
    try:
        unit = json.loads(metadata["unit"])
        return Channel(
            topic.removeprefix("/"),
            tuple(json.loads(metadata["fields"])),
            unit if isinstance(unit, str) else tuple(unit),
            metadata["frame"],
            metadata.get("description", ""),
            float(metadata["rate"]) if metadata.get("rate") else None,
        )
    except (KeyError, ValueError, TypeError, AttributeError, LogError):
        return None
