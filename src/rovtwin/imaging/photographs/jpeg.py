"""Tags into a JPEG file and out of it; the picture itself is not touched.

Reference: ITU-T T.81, annex B (markers and segments); Adobe, XMP Specification part 3 (2020), sec. 1.1.3 (XMP in APP1).
"""

import io
import struct
from datetime import datetime
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, UnidentifiedImageError

from rovtwin.core.errors import ConfigError

EXIF, XMP = b"Exif\x00\x00", b"http://ns.adobe.com/xap/1.0/\x00"
_SOI, _SOS, _APP0, _APP1 = b"\xff\xd8", 0xDA, 0xE0, 0xE1
_LARGEST = 65_533 - 2  # of a segment's content


def tagged(jpeg: bytes, exif: Image.Exif, xmp: bytes, where: str = "picture") -> bytes:
    """A JPEG file with these tags in place of its own; all other segments and the picture stay bit for bit.

    Raises:
        ConfigError: It is no whole JPEG file, or the tags are too large.
    """
    head, rest = _segments(jpeg, where)
    body = exif.tobytes()
    new = []
    for content in (body if body.startswith(EXIF) else EXIF + body, XMP + xmp):
        if len(content) > _LARGEST:
            raise ConfigError(f"{where}: its tags take {len(content):,} bytes, a JPEG file has room for {_LARGEST:,}")
        new.append(b"\xff\xe1" + struct.pack(">H", len(content) + 2) + content)
    kept = [s for s in head if not (s[1] == _APP1 and s[4:].startswith((EXIF, XMP)))]
    first = 1 if kept and kept[0][1] == _APP0 else 0  # JFIF comes first where it is there
    return b"".join([_SOI, *kept[:first], *new, *kept[first:], rest])


def _segments(jpeg: bytes, where: str) -> tuple[list[bytes], bytes]:
    """Segments before the picture's scan, each with its marker, and all that follows."""
    if not jpeg.startswith(_SOI):
        raise ConfigError(f"{where}: is no JPEG file; expected .jpg pictures as the camera has made them")
    at, found = 2, []
    while at + 4 <= len(jpeg) and jpeg[at] == 0xFF:
        if jpeg[at + 1] == 0xFF:  # fill bytes
            at += 1
            continue
        if jpeg[at + 1] == _SOS:
            return found, jpeg[at:]
        length = struct.unpack(">H", jpeg[at + 2 : at + 4])[0]
        found.append(jpeg[at : at + 2 + length])
        at += 2 + length
    raise ConfigError(f"{where}: is cut off before its picture begins; copy it from the camera again")


def exif_in(path: Path) -> Image.Exif:
    """What the camera has written.

    Raises:
        ConfigError: It is no picture.
    """
    try:
        with Image.open(path) as picture:
            if picture.format != "JPEG":
                raise ConfigError(f"{path.name}: is {picture.format}, expected JPEG pictures")
            return picture.getexif()
    except (UnidentifiedImageError, OSError) as error:
        raise ConfigError(f"{path.name}: cannot be read as a picture ({error})") from None


def taken_at(exif: Image.Exif, where: str) -> np.datetime64:
    """When the camera says that it took a picture, by its own clock and zone, or UTC where it states one.

    Raises:
        ConfigError: It does not say.
    """
    own = exif.get_ifd(ExifTags.IFD.Exif)
    text = own.get(ExifTags.Base.DateTimeOriginal) or exif.get(ExifTags.Base.DateTime)
    if not text:
        raise ConfigError(f"{where}: has no DateTimeOriginal; without a time it has no place on the track")
    try:
        time = datetime.strptime(str(text).strip("\x00 "), "%Y:%m:%d %H:%M:%S")
    except ValueError:
        raise ConfigError(f"{where}: DateTimeOriginal: found {text!r}, expected 2026:05:01 12:00:00") from None
    fraction = "".join(c for c in str(own.get(ExifTags.Base.SubsecTimeOriginal, "")) if c.isdigit())
    found = np.datetime64(time, "us") + np.timedelta64(int(fraction[:6].ljust(6, "0") or 0), "us")
    zone = str(own.get(ExifTags.Base.OffsetTimeOriginal, "")).strip("\x00 ")
    if len(zone) == 6 and zone[0] in "+-":
        minutes = int(zone[1:3]) * 60 + int(zone[4:6])
        found -= np.timedelta64(minutes if zone[0] == "+" else -minutes, "m")
    return found


def whole_seconds(exif: Image.Exif) -> bool:
    """Whether the camera states no part of a second."""
    return not any(c.isdigit() for c in str(exif.get_ifd(ExifTags.IFD.Exif).get(ExifTags.Base.SubsecTimeOriginal, "")))


def jpeg_of(picture: np.ndarray, quality: int = 95) -> bytes:
    """A picture, RGB, uint8, as JPEG."""
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=quality, subsampling=0)
    return stream.getvalue()
