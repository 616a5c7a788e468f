"""Where on Earth the world frame lies, and when the run begins."""

from typing import Annotated

from pydantic import AfterValidator, Field

from rovtwin.core.datum import FARTHEST, Datum, check_coordinates, utc_text
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import Number, Strict

_DEFAULT = Datum()


def _utc(text: str) -> str:
    try:
        return utc_text(text)
    except ConfigError as error:
        raise ValueError(str(error).removeprefix("utc_start: ")) from None


class DatumSection(Strict):
    """The origin of the world frame on the map (WGS-84), and time zero. Physics does not depend on it."""

    latitude: Annotated[Number, Field(ge=-90, le=90)] = Field(
        default=_DEFAULT.latitude, description="north positive [deg]"
    )
    longitude: Annotated[Number, Field(ge=-180, le=180)] = Field(
        default=_DEFAULT.longitude, description="east positive [deg]"
    )
    height: Number = Field(
        default=_DEFAULT.height, description="of the mean water level over the ellipsoid [m]; 0 if nobody looked it up"
    )
    utc_start: Annotated[str, AfterValidator(_utc)] = Field(
        default=_DEFAULT.utc_start, description="UTC of time zero, ISO 8601 with Z"
    )

    @property
    def is_given(self) -> bool:
        """Whether the place is another than the default, which is one for examples: files written in full have it."""
        return (self.latitude, self.longitude) != (_DEFAULT.latitude, _DEFAULT.longitude)

    @property
    def origin(self) -> Datum:
        """What converts."""
        return Datum(self.latitude, self.longitude, self.height, self.utc_start)


def on_earth(place: list[float]) -> list[float]:
    """Validates latitude, longitude [deg] and depth [m] of a way-point."""
    try:
        check_coordinates(place[0], place[1])
    except ConfigError as error:
        raise ValueError(f"found {error}") from None
    if place[2] < 0:
        raise ValueError(f"found {place[2]:g} m as the third number, expected a depth of at least 0 (down is positive)")
    return place


def require_near(datum: Datum, geodetic: list[float], where: str) -> None:
    """Raise ValueError where a place on the map is so far from the datum that one of them must be wrong."""
    latitude, longitude, _ = geodetic
    away = float(datum.distance(latitude, longitude))
    if away <= FARTHEST:
        return
    swapped = abs(longitude) <= 90 and float(datum.distance(longitude, latitude)) <= FARTHEST
    hint = "swap latitude and longitude" if swapped else "mend it, or set datum.latitude and datum.longitude"
    raise ValueError(
        f"{where}: {latitude:g}, {longitude:g} is {away / 1000:,.0f} km from the datum "
        f"({datum.latitude:g}, {datum.longitude:g}), expected at most {FARTHEST / 1000:.0f} km: {hint}"
    )
