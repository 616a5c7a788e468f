"""Quantities as people type them, "20mm" or "200 g", in SI. A plain number is in the SI unit already."""

import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeGuard

from rovtwin.core.errors import ConfigError

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*")


def is_number(value: object) -> TypeGuard[float]:
    """Whether what was read from a file is a number; true and false are none."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def is_finite(value: object) -> TypeGuard[float]:
    """Whether it is a number, and neither infinite nor NaN, nor an integer beyond what a float holds."""
    return is_number(value) and abs(value) <= sys.float_info.max


@dataclass(frozen=True)
class Kind:
    """What a quantity may be.

    Attributes:
        name: With its article, for messages.
        unit: Of plain numbers.
        units: What one of each unit is in SI.
        example: As one would type it.
    """

    name: str
    unit: str
    units: Mapping[str, float]
    example: str


LENGTH = Kind("a length", "m", {"m": 1.0, "cm": 0.01, "mm": 0.001}, "20mm")
MASS = Kind("a mass", "kg", {"kg": 1.0, "g": 0.001}, "10g")
DENSITY = Kind("a density", "kg/m3", {"kg/m3": 1.0, "kg/m^3": 1.0, "g/cm3": 1000.0, "kg/l": 1000.0}, "1025")


def quantity(text: str, kind: Kind, where: str) -> float:
    """The value in SI.

    Args:
        text: A number, or a number and a unit of the kind.
        kind: What is expected.
        where: Option or key, for messages.

    Raises:
        ConfigError: No number, a unit of another kind, or not finite.
    """
    matched = _QUANTITY.fullmatch(text)
    units = ", ".join(kind.units)
    expected = f"expected {kind.name} such as {kind.example}; units: {units}; a plain number is {kind.unit}"
    if matched is None or not math.isfinite(float(matched[1])):
        raise ConfigError(f"{where}: found '{text}', {expected}")
    number, unit = float(matched[1]), matched[2]
    if unit and unit not in kind.units:
        raise ConfigError(f"{where}: found the unit '{unit}' in '{text}', {expected}")
    return number * kind.units[unit] if unit else number


def positive(text: str, kind: Kind, where: str) -> float:
    """The same of a quantity that must be more than zero."""
    value = quantity(text, kind, where)
    if value <= 0:
        raise ConfigError(f"{where}: found '{text}', expected {kind.name} above 0 such as {kind.example}")
    return value


def point(text: str, where: str) -> tuple[float, float, float]:
    """Three lengths separated by commas, "0.2,0,-100mm", in metres."""
    parts = text.split(",")
    if len(parts) != 3:
        raise ConfigError(f"{where}: found '{text}', expected x,y,z such as 0.2,0,-0.1 (m) or 200mm,0,-100mm")
    x, y, z = (quantity(part, LENGTH, where) for part in parts)
    return x, y, z


def plain(value: float, digits: int = 2) -> str:
    """A number for a sentence: so many significant digits or all before the point, `142` and never `1.4e+02`."""
    text = f"{float(value) + 0.0:.{digits}g}"
    return f"{float(value):.0f}" if "e+" in text else text


ENDINGS = {
    "rad_s": "rad/s", "deg_s": "deg/s", "m_s2": "m/s2", "n_per_s": "N/s", "m_s": "m/s", "n_m": "N m", "n2s": "N2 s",
    "share": "1", "hz": "Hz", "ms": "ms", "mm": "mm", "deg": "deg", "rad": "rad", "kg": "kg", "wh": "Wh", "m": "m",
    "s": "s", "n": "N", "v": "V", "a": "A",
}  # fmt: skip
"""Units by how names of columns and keys end, longer ones first: `rate_hz`, `speed_m_s`."""


def named_unit(name: str) -> tuple[str, str]:
    """A name without the unit that it ends with, and that unit; "" where it ends with none."""
    ending = next((one for one in ENDINGS if name.endswith(f"_{one}")), None)
    return (name, "") if ending is None else (name.removesuffix(f"_{ending}"), ENDINGS[ending])
