"""Messages as bytes for files: plain CDR, little endian, and the `ros2msg` text that describes them."""

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Shaped, UInt8

from rovtwin.links.ros2.messages import layout, ros_name

_FORMATS = {"bool": "?", "uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}
_ENCAPSULATION = b"\x00\x01\x00\x00"  # plain CDR, little endian; alignment counts from behind it


class _Encoder:
    """Bytes of a message, and where each number of it lies: offset and format by its path."""

    def __init__(self) -> None:
        self.body = bytearray()
        self.places: dict[str, tuple[int, str]] = {}

    def number(self, path: str, form: str, *values: float) -> None:
        size = struct.calcsize(form)
        self.body += b"\0" * (-len(self.body) % size)
        self.places[path] = len(self.body), form
        self.body += struct.pack(f"<{len(values)}{form}", *values)

    def field(self, path: str, ros: str, inner: type | None, value: Any) -> None:
        base, _, size = ros.partition("[")
        if size == "]":
            self.number(f"{path}.length", "I", len(value))
        if inner is not None or base == "string":
            for k, item in enumerate(value if size else [value]):
                at = f"{path}.{k}" if size else path
                if inner is None:
                    raw = item.encode() + b"\0"
                    self.number(f"{at}.length", "I", len(raw))
                    self.body += raw
                else:
                    self.message(f"{at}.", item)
        elif not size:
            self.number(path, _FORMATS[base], value)
        elif len(value):
            self.number(path, _FORMATS[base], *value)

    def message(self, path: str, message: Any) -> None:
        for name, ros, inner in layout(type(message)):
            self.field(path + name, ros, inner, getattr(message, name))


def encode(message: Any) -> bytes:
    """One message as ROS 2 writes it into bags."""
    encoder = _Encoder()
    encoder.message("", message)
    return _ENCAPSULATION + bytes(encoder.body)


def encode_many(template: Any, columns: Mapping[str, Shaped[np.ndarray, "N ..."]]) -> UInt8[np.ndarray, "N length"]:
    """Many messages that differ from a template only in numbers; shape (N, length of one), uint8.

    Args:
        template: One of `messages`, with strings and lists of the right length.
        columns: Numbers by path, such as `pose.pose.position.x`, shape (N,), or (N, k) for a list of k.
    """
    encoder = _Encoder()
    encoder.message("", template)
    count = len(next(iter(columns.values())))
    block = np.tile(np.frombuffer(bytes(encoder.body), np.uint8), (count, 1))
    for path, values in columns.items():
        offset, form = encoder.places[path]
        raw = np.ascontiguousarray(np.reshape(values, (count, -1)), dtype=np.dtype(f"<{form}")).view(np.uint8)
        block[:, offset : offset + raw.shape[1]] = raw
    return np.concatenate([np.tile(np.frombuffer(_ENCAPSULATION, np.uint8), (count, 1)), block], axis=1)


def definition(kind: type) -> str:
    """The `ros2msg` schema of a message class: its own fields, then those of all that it is made of."""
    text, seen, rest = _fields(kind), {kind}, _parts(kind)
    while rest:
        part = rest.pop(0)
        if part not in seen:
            seen.add(part)
            rest += _parts(part)
            text += "=" * 80 + f"\nMSG: {_short(part)}\n" + _fields(part)
    return text


def _short(kind: type) -> str:
    package, _, word = ros_name(kind).split("/")
    return f"{package}/{word}"


def _fields(kind: type) -> str:
    rows = [
        (name, ros if inner is None else _short(inner) + ros[len(ros_name(inner)) :], inner)
        for name, ros, inner in layout(kind)
    ]
    return "".join(f"{ros} {name}\n" for name, ros, _ in rows)


def _parts(kind: type) -> list[type]:
    return [inner for _, _, inner in layout(kind) if inner is not None]
