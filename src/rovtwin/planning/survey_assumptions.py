"""What a plan assumes of that which no reading tells: how far compass, mounting, clock and floor are off."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import near
from rovtwin.gnc.navigation.constants import USUAL_STD
from rovtwin.imaging.imager import BORESIGHT_STD, CLOCK_STD, LEVER_STD


@dataclass(frozen=True)
class Assumptions:
    """Standard deviations: those that smoother and map start from too, so that no plan is more hopeful than its map.

    Attributes:
        heading: Of the compass's bias [deg].
        boresight: Of the imager's attitude on the vehicle, each axis [deg].
        lever: Of its place on the vehicle, each axis [m].
        dvl_yaw: Of the Doppler log's yaw on the vehicle [deg].
        dvl_scale: Of the share by which it reads too much.
        clock: Of the imager's clock against the vehicle's [s].
        floor: Of the floor's height as the map will know it, from place to place [m].
        tie: Of a feature that is found in two lines, each axis [m].
    """

    heading: float = round(math.degrees(USUAL_STD["heading"]), 9)
    boresight: float = round(math.degrees(BORESIGHT_STD), 9)
    lever: float = LEVER_STD
    dvl_yaw: float = round(math.degrees(USUAL_STD["dvl_yaw"]), 9)
    dvl_scale: float = USUAL_STD["dvl_scale"]
    clock: float = CLOCK_STD
    floor: float = 0.03
    tie: float = 0.01

    @classmethod
    def ideal(cls) -> "Assumptions":
        """Nothing is off: what sensors' noise and disturbances do alone."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    @classmethod
    def of(cls, texts: Iterable[str]) -> "Assumptions":
        """The usual ones with changes such as `heading=2`; `ideal` sets all but the tie to 0.

        Raises:
            ConfigError: No such assumption, or no number of at least 0.
        """
        found = cls()
        for text in texts:
            if text.strip() == "ideal":
                found = cls.ideal()
                continue
            key, _, value = (part.strip() for part in text.partition("="))
            if key not in cls.__dataclass_fields__:
                names = list(cls.__dataclass_fields__)
                raise ConfigError(f"--assume {text}: expected ideal, or one of {', '.join(names)}{near(key, names)}")
            changes: dict[str, Any] = {key: _number(text, value)}
            found = replace(found, **changes)
        if found.tie <= 0:
            raise ConfigError("--assume tie: found 0, expected more: no feature is found exactly")
        return found


def _number(text: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not 0 <= number < math.inf:
        raise ConfigError(f"--assume {text}: found {value!r}, expected a number of at least 0, such as heading=2")
    return number
