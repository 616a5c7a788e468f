"""The imager of a survey: what it sees from the planned height, how fast it may go, and what it will record."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.footprint import Footprint, footprint_of
from rovtwin.imaging.imager import Imager, load_imager, mount_of
from rovtwin.planning.survey_request import MapRequest
from rovtwin.survey.room import Swath
from rovtwin.vehicle import Vehicle

COUNT_BYTES = 2  # of a pixel in a band
STEERED = 0.2  # share of the vehicle's own speed, below which it is slow to keep its course


@dataclass(frozen=True)
class Imaging:
    """An imager over a flat floor.

    Attributes:
        imager: Which one.
        footprint: What it sees.
        altitude: Of the vehicle's origin over the floor [m].
        swath: That the survey may count on.
    """

    imager: Imager
    footprint: Footprint
    altitude: float
    swath: Swath

    def speed(self) -> float:
        """At which pixels are square [m/s]."""
        return self.footprint.square_speed(self.imager.file.line_rate_hz)

    def figures(self, speed: float, seeing: float) -> dict[str, Any]:
        """Plain numbers, SI, for a speed [m/s] and the length of lines and laps [m]."""
        file, seen = self.imager.file, self.footprint
        lines = int(np.ceil(seeing / speed * file.line_rate_hz))
        bands = len(self.imager.wavelengths)
        return {
            "imager": file.name,
            "altitude_m": self.altitude,
            "swath_m": self.swath.width,
            "swath_level_m": seen.level_width,
            "pixel_across_m": seen.across[0],
            "pixel_along_m": speed / file.line_rate_hz,
            "slit_along_m": seen.along,
            "square_speed_m_s": self.speed(),
            "square_binning": max(1, round(speed / file.line_rate_hz / seen.across[0])),
            "gapless_speed_m_s": min(seen.gapless_speed(file.line_rate_hz, file.exposure), 1e9),
            "scan_lines": lines,
            "file_bytes": lines * file.pixels * bands * COUNT_BYTES,
        }

    def remarks(self, speed: float, own: float) -> list[str]:
        """What to know of a speed on the lines; `own`: the vehicle's [m/s]."""
        file, seen, out = self.imager.file, self.footprint, []
        figures = self.figures(speed, 1.0)
        along, across = figures["pixel_along_m"], figures["pixel_across_m"]
        if along > 1.5 * across:
            rate = speed / across
            text = (
                f"pixels are {1e3 * across:.2g} mm across and {1e3 * along:.2g} mm along: square with "
                f"{figures['square_binning']} binned to one, at {self.speed():.2g} m/s, or at {rate:.0f} lines a second"
            )
            if rate * file.exposure > 1.0:
                text += f", for which an exposure of {1e3 * file.exposure:g} ms is too long"
            out.append(text)
        gapless = figures["gapless_speed_m_s"]
        if speed > gapless:
            unseen = 1.0 - (seen.along + speed * file.exposure) * file.line_rate_hz / speed
            out.append(
                f"at {speed:g} m/s {unseen:.0%} of the floor lies between one line and the next; none does up to "
                f"{gapless:.2g} m/s, or with a longer exposure"
            )
        if speed * file.exposure > 3.0 * max(across, seen.along):
            out.append(f"a line is drawn out by {1e3 * speed * file.exposure:.2g} mm while it collects light")
        if speed < STEERED * own:
            out.append(
                f"{speed:.2g} m/s is slow for this vehicle, which flies lines at {own:.2g} m/s: it keeps course badly "
                "in a current. More height, binning or a higher line rate allow for more"
            )
        return out


def imaging_of(
    request: MapRequest, vehicle: Vehicle, sees: str | None, altitude: float | None, followed: bool
) -> Imaging:
    """The imager as the vehicle carries it.

    Args:
        request: Which imager, and what is allowed for.
        vehicle: That carries it.
        sees: Name of the sensor; None: the vehicle's first imager.
        altitude: Of the vehicle's origin over the floor [m].
        followed: Whether the altitude was asked for, rather than what depth and floor leave.

    Raises:
        ConfigError: Nobody has said how high, no such imager, none on the vehicle, or one that sees no swath.
    """
    if altitude is None:
        raise ConfigError(
            "--imager: its swath depends on the height; say --altitude 1.5, and --floor where no altimeter is on board"
        )
    imager, mount = load_imager(request.imager), mount_of(vehicle, sees)
    try:
        seen = footprint_of(imager, mount, altitude, np.radians(request.roll_deg))
    except ConfigError as error:
        where = "" if followed else f" (--depth leaves {altitude:.2f} m over the floor)"
        raise ConfigError(f"{error}{where}") from None
    return Imaging(imager, seen, altitude, Swath(seen.width, request.overlap))
