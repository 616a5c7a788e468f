"""JSON from the network: an object with fields of the expected types, or a LinkError."""

import json
import math
from typing import Any

from rovtwin.core.errors import LinkError

LONGEST = 64 * 1024  # bytes of one message; a velocity report has about 1500


def read_object(data: bytes | str) -> dict[str, Any]:
    """The object that a message is.

    Raises:
        LinkError: It is too long, no JSON, none that the standard has (NaN, Infinity), or no object.
    """
    if len(data) > LONGEST:
        raise LinkError(f"message of {len(data)} bytes; expected at most {LONGEST}")
    try:
        found = json.loads(data, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise LinkError(f"message is no JSON: {error}") from None
    if not isinstance(found, dict):
        raise LinkError(f"message is a JSON {type(found).__name__}; expected an object")
    return found


def _refuse(name: str) -> float:
    raise ValueError(f"{name} is no number in JSON")


def number(found: dict[str, Any], key: str, default: float | None = None) -> float:
    """A finite number; `default`, where one is given, for a missing one."""
    value = found.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise LinkError(f"{key}: found {_brief(value)}, expected a number")
    try:
        real = float(value)
    except OverflowError:
        real = math.inf
    if not math.isfinite(real):
        raise LinkError(f"{key}: expected a finite number")
    return real


def numbers(found: dict[str, Any], key: str, count: int | None = None, most: int = 16) -> tuple[float, ...]:
    """A list of finite numbers, `count` of them or at most `most`."""
    value = found.get(key)
    if not isinstance(value, list) or len(value) > most or (count is not None and len(value) != count):
        raise LinkError(f"{key}: expected a list of {count if count is not None else f'at most {most}'} numbers")
    return tuple(number({key: item}, key) for item in value)


def flag(found: dict[str, Any], key: str) -> bool:
    """True or false."""
    value = found.get(key)
    if not isinstance(value, bool):
        raise LinkError(f"{key}: found {_brief(value)}, expected true or false")
    return value


def text(found: dict[str, Any], key: str, default: str | None = None) -> str:
    """A text; `default`, where one is given, for a missing one."""
    value = found.get(key, default)
    if not isinstance(value, str):
        raise LinkError(f"{key}: found {_brief(value)}, expected a text")
    return value


def _brief(value: Any) -> str:
    """Enough of a value to know it by; a number may have a million digits and a list anything."""
    if isinstance(value, dict | list):
        return "an object" if isinstance(value, dict) else "a list"
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) > 10**20:
        return "a huge number"
    return "nothing" if value is None else ascii(value)[:40]
