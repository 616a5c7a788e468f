"""The water a vehicle is in: its density, given or from temperature and salinity.

A neutral vehicle of 30 kg floats with 8 N when it goes from a pool of 1000 kg/m3 into the sea at 5 deg C and 35.

Reference: IOC, SCOR and IAPSO (2010), The international thermodynamic equation of seawater (TEOS-10), as gsw has it.
"""

import re

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.quantity import DENSITY, quantity

NAMED = {"fresh": 1000.0, "sea": 1025.0}  # [kg/m3]
LIGHTEST, HEAVIEST = 900.0, 1100.0  # what can be meant by a density of water [kg/m3]
WARMEST, SALTIEST = 40.0, 42.0  # where TEOS-10 ends at the surface [deg C, practical salinity]


def density(temperature: float, salinity: float) -> float:
    """Density of water at the surface [kg/m3], exact Gibbs function of TEOS-10.

    The salt is that of the ocean (reference composition), which needs no place on Earth; the composition of real
    places changes the density by less than 0.1 kg/m3.

    Args:
        temperature: In situ [deg C], from freezing to 40.
        salinity: Practical salinity (PSS-78), 0 (fresh water) to 42; the open sea has about 35.

    Raises:
        ConfigError: Outside of that.
    """
    import gsw  # not at the top: loading a vehicle does not need it

    if not 0 <= salinity <= SALTIEST:
        raise ConfigError(
            f"salinity {salinity:g}: expected practical salinity from 0 (fresh) to {SALTIEST:g}; the sea has about 35"
        )
    absolute = gsw.SR_from_SP(salinity)
    freezing = min(0.0, float(gsw.t_freezing(absolute, 0.0, 1.0)))  # of pure water 0.002, which nobody writes
    if not freezing <= temperature <= WARMEST:
        hint = " Is it in kelvin?" if temperature > 250 else ""
        raise ConfigError(
            f"temperature {temperature:g} deg C: expected {freezing:.2g} (it freezes) to {WARMEST:g} deg C at salinity "
            f"{salinity:g}.{hint}"
        )
    return float(gsw.rho_t_exact(absolute, temperature, 0.0))


def check_density(value: float) -> float:
    """The density [kg/m3], or a ConfigError where it cannot be that of water."""
    if not LIGHTEST <= value <= HEAVIEST:
        hint = " Is it in g/cm3?" if 0.9 <= value <= 1.1 else ""
        raise ConfigError(
            f"water density {value:g} kg/m3, expected {LIGHTEST:g} to {HEAVIEST:g} (fresh 1000, sea 1025).{hint}"
        )
    return float(value)


def water_in_words(text: str) -> dict[str, float]:
    """What `fresh`, `sea`, `1025` or `12C 34` means: density, or temperature and salinity, by these names.

    Raises:
        ConfigError: It is none of these.
    """
    words = text.strip().lower()
    if words in NAMED:
        return {"density": NAMED[words]}
    number = r"([-+]?\d+(?:\.\d*)?)"
    if found := re.fullmatch(rf"{number}\s*°?\s*c[\s,]+{number}", words):
        return {"temperature": float(found[1]), "salinity": float(found[2])}
    try:
        return {"density": quantity(words, DENSITY, "water")}
    except ConfigError:
        raise ConfigError(
            f"water {text!r}: expected fresh, sea, a density such as 1025 [kg/m3], or temperature and practical "
            "salinity such as '12C 34'"
        ) from None


def density_of(text: str) -> float:
    """Density [kg/m3] of water in the words of `water_in_words`.

    Raises:
        ConfigError: No such water.
    """
    found = water_in_words(text)
    return check_density(found["density"]) if "density" in found else density(**found)
