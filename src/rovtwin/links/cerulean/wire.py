"""Sentences of Cerulean's DVLs: $DVPDL and, of the Tracker 650, $DVPDX, which adds the distance to the floor.

Source: docs.ceruleansonar.com, "$DVPDL and $DVPDX: DVL Position and Angle Deltas Messages".
"""

import math
from dataclasses import dataclass
from functools import reduce

from rovtwin.core.errors import LinkError

LONGEST = 512  # bytes of a sentence that are looked at
STANDOFF = 12  # of the numbers of $DVPDX, from 0


@dataclass(frozen=True)
class Deltas:
    """How far the vehicle came since the last message.

    Attributes:
        time: When it was sent, since the DVL was switched on [s].
        interval: Since the last message [s].
        moved: Along the axes of the vehicle [m].
        confidence: 0 to 100; 0: nothing else means anything.
        standoff: Distance from the sensor to the floor, along its normal [m]; None where the message has none.
    """

    time: float
    interval: float
    moved: tuple[float, float, float]
    confidence: float
    standoff: float | None = None


def parse(sentence: bytes) -> Deltas | None:
    """The deltas of a sentence; None of another sentence.

    Raises:
        LinkError: It is none, its checksum is wrong, or a field is no number.
    """
    fields = _fields(sentence)
    if fields[0] not in ("DVPDL", "DVPDX"):
        return None
    try:
        numbers = [float(text) for text in fields[1:]]
    except ValueError:
        raise LinkError(f"cerulean: found {sentence[:80]!r}, expected numbers") from None
    if len(numbers) < 9 or not all(map(math.isfinite, numbers)):
        raise LinkError(f"cerulean: found {len(numbers)} fields in {fields[0]}, expected 9 finite numbers")
    moved = (numbers[5], numbers[6], numbers[7])
    standoff = numbers[STANDOFF] if fields[0] == "DVPDX" and len(numbers) > STANDOFF else None
    return Deltas(1e-6 * numbers[0], 1e-6 * numbers[1], moved, numbers[8], standoff)


def _fields(sentence: bytes) -> list[str]:
    """Of an NMEA sentence whose checksum is right."""
    try:
        text = sentence[:LONGEST].decode("ascii").strip()
    except UnicodeDecodeError:
        raise LinkError("cerulean: found bytes that are no text, expected a sentence") from None
    body, star, given = text.removeprefix("$").partition("*")
    if not text.startswith("$") or not star:
        raise LinkError(f"cerulean: found {text[:80]!r}, expected $..*hh")
    if given.strip().upper() != f"{checksum(body):02X}":
        raise LinkError(f"cerulean: found the checksum {given!r}, expected {checksum(body):02X}")
    return body.split(",")


def checksum(body: str) -> int:
    """Of what stands between $ and *: all bytes by exclusive or, as NMEA 0183 has it."""
    return reduce(lambda value, byte: value ^ byte, body.encode("ascii"), 0)
