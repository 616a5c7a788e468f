"""Where, when and how a picture was taken, as EXIF and XMP say it.

Angles are those that photogrammetry programs read in `Camera:Yaw`, `Camera:Pitch`, `Camera:Roll`: zyx Euler angles of
the frame whose x axis is the top of the picture, y its right and z the line of sight. So a camera that looks straight
down with the top of its pictures to the north has 0, 0, 0; one that looks level ahead has a pitch of 90 degrees.

References: CIPA DC-008-2023, Exif 2.32/3.0; Adobe, XMP Specification part 3 (2020), sec. 1.1.3; Pix4D, specification of
the XMP Camera tags; OpenDroneMap, opendm/photo.py, for the same convention.
"""

import math
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import numpy as np
from jaxtyping import Float
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational

from rovtwin.vehicle.physics.camera import Lens

STEEPEST = math.radians(89.9)  # of pitch: beyond, yaw and roll are one turn, and all of it is called yaw
FILM = 36.0  # width of the film that focal lengths are told for [mm]
SECONDS, METRES = 10**6, 10**4  # denominators of seconds of arc, and of lengths
CAMERA = "http://pix4d.com/camera/1.0/"
_IFD, _GPS, _BASE = ExifTags.IFD, ExifTags.GPS, ExifTags.Base


@dataclass(frozen=True)
class Shot:
    """One picture.

    Attributes:
        time: When it was taken, UTC.
        latitude: Of the camera, WGS-84 [deg].
        longitude: The same.
        altitude: Over the mean water level, negative below [m].
        yaw: Of the picture, see the module [deg], 0 to 360.
        pitch: The same [deg].
        roll: The same [deg].
        horizontal_std: Of north and east together, root of the sum of variances [m]; None where nothing is known.
        vertical_std: Of the altitude [m].
        direction: That the camera looks to, or the top of the picture where it looks down, from true north [deg].
        focal: Focal length in the water over the picture's width; None where no lens is known.
        make: Of the camera or vehicle.
        model: Of the camera.
    """

    time: np.datetime64
    latitude: float
    longitude: float
    altitude: float
    yaw: float
    pitch: float
    roll: float
    horizontal_std: float | None
    vertical_std: float | None
    direction: float
    focal: float | None
    make: str
    model: str


def picture_angles(R_nc: Float[np.ndarray, "3 3"]) -> tuple[float, float, float]:
    """Yaw, pitch and roll of a picture [rad] from the attitude in n of its camera's frame: x right, y down, z ahead."""
    R = np.stack([-R_nc[:, 1], R_nc[:, 0], R_nc[:, 2]], axis=1)  # top, right, line of sight
    pitch = math.asin(float(np.clip(-R[2, 0], -1.0, 1.0)))
    if abs(pitch) > STEEPEST:
        return math.atan2(-R[0, 1], R[1, 1]) % (2 * math.pi), pitch, 0.0
    return math.atan2(R[1, 0], R[0, 0]) % (2 * math.pi), pitch, math.atan2(R[2, 1], R[2, 2])


def direction_of(R_nc: Float[np.ndarray, "3 3"]) -> float:
    """That the camera looks to, or the top of the picture where it looks down, clockwise from north [rad]."""
    ahead, top = R_nc[:2, 2], -R_nc[:2, 1]
    along = ahead if np.linalg.norm(ahead) >= np.linalg.norm(top) else top
    return math.atan2(float(along[1]), float(along[0])) % (2 * math.pi)


def focal_in_water(lens: Lens) -> float:
    """Focal length near the axis as the water sees it, over the picture's width: a flat port makes it longer."""
    # As lenses are calibrated in water: by how far apart rays of neighbouring pixels are there.
    stretch = 1.0 if lens.port is None else float(lens.port.water)
    return float(lens.focal[0]) * stretch / lens.size[0]


def exif_of(shot: Shot, kept: Image.Exif | None = None) -> Image.Exif:
    """EXIF of a picture.

    Args:
        shot: What to say.
        kept: What the camera had written, whose other tags stay; None: nothing.
    """
    exif = Image.Exif()
    if kept is not None:
        exif.load(kept.tobytes())
    when, fraction = _seconds(shot.time)
    date, clock = when.split("T")
    exif[_BASE.Make], exif[_BASE.Model] = exif.get(_BASE.Make, shot.make), exif.get(_BASE.Model, shot.model)
    exif[_BASE.DateTime] = stamp = f"{date.replace('-', ':')} {clock}"
    own = exif.get_ifd(_IFD.Exif)
    own.update({_BASE.DateTimeOriginal: stamp, _BASE.DateTimeDigitized: stamp})
    own.update({_BASE.SubsecTime: fraction, _BASE.SubsecTimeOriginal: fraction, _BASE.SubsecTimeDigitized: fraction})
    own.update({_BASE.OffsetTime: "+00:00", _BASE.OffsetTimeOriginal: "+00:00", _BASE.OffsetTimeDigitized: "+00:00"})
    own[_BASE.ExifVersion] = b"0232"
    if shot.focal is not None and _BASE.FocalLength not in own:
        own[_BASE.FocalLength] = _ratio(FILM * shot.focal, METRES)
        own[_BASE.FocalLengthIn35mmFilm] = round(FILM * shot.focal)
    exif.get_ifd(_IFD.GPSInfo).update(_gps(shot, date, clock, fraction))
    return exif


def _gps(shot: Shot, date: str, clock: str, fraction: str) -> dict[int, object]:
    hours, minutes, seconds = (int(part) for part in clock.split(":"))
    second = _ratio(seconds + float(f"0.{fraction}"), SECONDS)
    found: dict[int, object] = {
        _GPS.GPSVersionID: b"\x02\x03\x00\x00",
        _GPS.GPSLatitudeRef: "N" if shot.latitude >= 0 else "S",
        _GPS.GPSLatitude: _arc(shot.latitude),
        _GPS.GPSLongitudeRef: "E" if shot.longitude >= 0 else "W",
        _GPS.GPSLongitude: _arc(shot.longitude),
        _GPS.GPSAltitudeRef: b"\x01" if shot.altitude < 0 else b"\x00",
        _GPS.GPSAltitude: _ratio(abs(shot.altitude), METRES),
        _GPS.GPSTimeStamp: (IFDRational(hours), IFDRational(minutes), second),
        _GPS.GPSDateStamp: date.replace("-", ":"),
        _GPS.GPSImgDirectionRef: "T",
        _GPS.GPSImgDirection: _ratio(shot.direction % 360.0, 100),
        _GPS.GPSMapDatum: "WGS-84",
    }
    if shot.horizontal_std is not None:
        found[_GPS.GPSHPositioningError] = _ratio(shot.horizontal_std, METRES)
    return found


def xmp_of(shot: Shot) -> bytes:
    """XMP packet with the angles and how well the place is known, in Pix4D's namespace `Camera`."""
    values = {"Yaw": f"{shot.yaw:.4f}", "Pitch": f"{shot.pitch:.4f}", "Roll": f"{shot.roll:.4f}"}
    values |= {"HorizCS": "EPSG:4326"}
    if shot.horizontal_std is not None:
        values["GPSXYAccuracy"] = f"{shot.horizontal_std / math.sqrt(2.0):.4f}"
    if shot.vertical_std is not None:
        values["GPSZAccuracy"] = f"{shot.vertical_std:.4f}"
    attributes = "".join(f"\n   Camera:{key}={quoteattr(value)}" for key, value in values.items())
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>\n<x:xmpmeta xmlns:x="adobe:ns:meta/">\n'
        ' <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">\n'
        f'  <rdf:Description rdf:about="" xmlns:Camera="{CAMERA}"{attributes}/>\n </rdf:RDF>\n</x:xmpmeta>\n'
        '<?xpacket end="w"?>'
    ).encode()


def _seconds(time: np.datetime64) -> tuple[str, str]:
    """ISO 8601 to the second, and what is beyond it in microseconds."""
    whole, fraction = str(time.astype("datetime64[us]")).split(".")
    return whole, fraction


def _arc(angle: float) -> tuple[IFDRational, IFDRational, IFDRational]:
    total = round(abs(angle) * 3600 * SECONDS)  # whole micro-seconds of arc: 60 seconds never come out
    minutes, rest = divmod(total, 60 * SECONDS)
    degrees, minutes = divmod(minutes, 60)
    return IFDRational(degrees), IFDRational(minutes), IFDRational(rest, SECONDS)


def _ratio(value: float, denominator: int) -> IFDRational:
    return IFDRational(round(value * denominator), denominator)
