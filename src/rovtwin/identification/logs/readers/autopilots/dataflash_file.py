r"""The bytes of an ArduPilot dataflash log: every message that is whole, by name, as arrays.

A message is \xa3 \x95, its type, and a body whose length, letters and columns an FMT message said before. Nothing tells
whether a body is damaged; a message is taken when another one, or the end of the file, follows it. pymavlink reads
these files too, but gives up at one damaged FMT and prints a line for every byte that belongs to none.

Reference: ArduPilot, libraries/AP_Logger/LogStructure.h (letters, FMT, FMTU).
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files import files as given

HEADER, FMT = b"\xa3\x95", 128
_FMT = struct.Struct("<BB4s16s64s")

# NumPy's type of each letter, and what its numbers are multiplied by.
_LETTERS: dict[str, tuple[str, float]] = {
    **{"b": ("i1", 1.0), "B": ("u1", 1.0), "M": ("u1", 1.0), "h": ("<i2", 1.0), "H": ("<u2", 1.0), "i": ("<i4", 1.0)},
    **{
        "I": ("<u4", 1.0),
        "q": ("<i8", 1.0),
        "Q": ("<u8", 1.0),
        "g": ("<f2", 1.0),
        "f": ("<f4", 1.0),
        "d": ("<f8", 1.0),
    },
    **{"c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01), "L": ("<i4", 1e-7)},
    **{"n": ("S4", 1.0), "N": ("S16", 1.0), "Z": ("S64", 1.0), "a": ("S64", 1.0)},
}


@dataclass(frozen=True)
class Format:
    """What an FMT message said: name, length of the whole message [bytes], letters and columns of its body."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype:
        """Of the body."""
        return np.dtype([(c, _LETTERS[letter][0]) for c, letter in zip(self.columns, self.letters, strict=True)])


@dataclass(frozen=True, eq=False)
class Message:
    """All messages of one name.

    Attributes:
        rows: Structured array; numbers as floats, multiplied as their letters say, text as bytes.
        instance: Column that says which of several sensors it is of, or None.
    """

    rows: np.ndarray
    instance: str | None


def read_messages(path: Path) -> tuple[dict[str, Message], int, int]:
    """Messages by name, how many bytes are in no message, and how many there are.

    Raises:
        IdentificationError: The file cannot be opened, or has no messages.
    """
    try:
        data = given.read_bytes(path)
    except OSError as error:
        raise IdentificationError(f"{path}: cannot be read ({error.strerror})") from None
    formats, places = _scan(data)
    found, read, raw = {}, 0, np.frombuffer(data, np.uint8)
    types = {fmt.name: number for number, fmt in formats.items()}
    instances = _instances(raw, formats, places, types)
    for number, at in places.items():
        fmt = formats[number]
        read += fmt.length * len(at)
        rows = _scaled(_bodies(raw, fmt, at), fmt)
        found[fmt.name] = Message(rows, instances.get(number))
    if not any("TimeUS" in fmt.columns and number in places for number, fmt in formats.items()):
        raise IdentificationError(f"{path}: found no messages, expected a dataflash log (.BIN) of ArduPilot")
    return found, len(data) - read, len(data)


def _scan(data: bytes) -> tuple[dict[int, Format], dict[int, list[int]]]:
    """Formats by type, and where the messages of each begin [byte]."""
    formats = {FMT: Format("FMT", 3 + _FMT.size, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))}
    places: dict[int, list[int]] = {}
    at, size = data.find(HEADER), len(data)
    while 0 <= at < size - 2:
        fmt = formats.get(data[at + 2])
        end = at + fmt.length if fmt else size + 1
        if end > size or (end < size and data[end : end + 2] != HEADER[: size - end]):
            at = data.find(HEADER, at + 1)
            continue
        places.setdefault(data[at + 2], []).append(at)
        if data[at + 2] == FMT:
            described = _format(data, at)
            # What is said twice and differently is damaged.
            if described is not None and described[0] not in formats:
                formats[described[0]] = described[1]
        at = end
    return formats, places


def _format(data: bytes, at: int) -> tuple[int, Format] | None:
    """The type that an FMT message describes and its format; None where it contradicts itself."""
    number, length, name, letters, columns = _FMT.unpack_from(data, at + 3)
    text = [part.split(b"\0")[0].decode("ascii", "replace") for part in (name, letters, columns)]
    names = tuple(text[2].split(",")) if text[2] else ()
    if len(names) != len(text[1]) or len(set(names)) != len(names) or not set(text[1]) <= set(_LETTERS):
        return None
    fmt = Format(text[0], length, text[1], names)
    return (number, fmt) if fmt.dtype.itemsize + 3 == length else None


def _bodies(raw: np.ndarray, fmt: Format, at: list[int]) -> np.ndarray:
    body = raw[np.array(at)[:, None] + np.arange(3, fmt.length)]
    return np.ascontiguousarray(body).view(fmt.dtype)[:, 0]


def _scaled(rows: np.ndarray, fmt: Format) -> np.ndarray:
    letters = dict(zip(fmt.columns, fmt.letters, strict=True))
    kinds = [(c, rows.dtype[c] if rows.dtype[c].kind == "S" else np.dtype(float)) for c in fmt.columns]
    scaled = np.empty(len(rows), np.dtype(kinds))
    with np.errstate(invalid="ignore"):  # of damaged numbers
        for column, kind in kinds:
            scaled[column] = rows[column] if kind.kind == "S" else rows[column] * _LETTERS[letters[column]][1]
    return scaled


def _instances(
    raw: np.ndarray, formats: dict[int, Format], places: dict[int, list[int]], types: dict[str, int]
) -> dict[int, str]:
    """Of each type the column that FMTU marks with #."""
    number = types.get("FMTU", -1)
    if number not in places or not {"FmtType", "UnitIds"} <= set(formats[number].columns):
        return {}
    found = {}
    for row in _bodies(raw, formats[number], places[number]):
        of, mark = formats.get(int(row["FmtType"])), row["UnitIds"].find(b"#")
        if of is not None and 0 <= mark < len(of.columns):
            found[int(row["FmtType"])] = of.columns[mark]
    return found
