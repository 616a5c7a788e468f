"""Packets of QTM's real-time protocol 1.25, little endian, as Qualisys describes them and `protocols.md` verified them.

Pure functions: bytes in, dataclass out, and no exception but LinkError.
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError

ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT = 0, 1, 2, 3, 4, 6
HEADER = struct.Struct("<II")
FRAME = struct.Struct("<qII")  # time stamp [us], frame number, number of components
BODIES = struct.Struct("<Ihh")  # bodies, drop rate, rate out of sync [per thousand]
COMPONENTS = {"6d": 5, "6deuler": 6, "6dres": 11, "6deulerres": 12}  # of the body
COMPONENTS |= {"3d": 1, "3dnolabels": 2, "3dres": 9, "3dnolabelsres": 10}  # of its markers
COMPONENTS |= {"2d": 7, "2dlin": 8}  # of cameras, of which the twin has none
# Components that QTM has and a twin has not: accepted, and left out.
OTHERS = ("analog", "analogsingle", "force", "forcesingle")
OTHERS += ("gazevector", "eyetracker", "image", "timecode", "skeleton", "skeleton:global")
SECTIONS = ("general", "3d", "6d")  # of the settings
# Places of the markers in the body's axes (x ahead, y to the left, z up) [m]: chosen, not in a plane and unlike from
# every side, as markers are glued on.
MARKERS = np.array([[0.2, 0.12, 0.1], [0.2, -0.12, 0.1], [-0.2, 0.12, 0.1], [-0.14, -0.12, 0.16]])
LONGEST_COMMAND = 4096  # bytes of a packet from a client; QTM itself takes longer XML settings, which are refused here
LONGEST_PACKET = 1 << 20  # bytes of a packet from QTM; a frame of 100 bodies has 6000
FASTEST = 10_000  # frames a second and divisors beyond it are refused


@dataclass(frozen=True)
class Stream:
    """What a client wants streamed: its components, and which frames.

    `every` n-th frame, or at most `rate` frames a second where that is not 0.
    """

    components: tuple[str, ...]
    every: int = 1
    rate: int = 0


def parse_header(header: bytes, longest: int) -> tuple[int, int]:
    """Size of a packet with its header [bytes], and its type.

    Raises:
        LinkError: The size is none that is taken here.
    """
    size, kind = HEADER.unpack(header)
    if not HEADER.size <= size <= longest:
        raise LinkError(f"packet of {size} bytes; expected {HEADER.size} to {longest}")
    return size, kind


def split_packets(data: bytes, longest: int = LONGEST_PACKET) -> tuple[list[bytes], bytes]:
    """Whole packets with their headers, and what is left of the last one.

    Raises:
        LinkError: A size is none that is taken here; nothing after it makes sense.
    """
    packets = []
    at = 0
    while len(data) - at >= HEADER.size:
        size, _ = parse_header(data[at : at + HEADER.size], longest)
        if len(data) - at < size:
            break
        packets.append(data[at : at + size])
        _check_components(packets[-1])
        at += size
    return packets, data[at:]


def _check_components(packet: bytes) -> None:
    """A frame announces no more components than it holds: the vendor's client relies on it."""
    if HEADER.unpack_from(packet)[1] != DATA:
        return
    if len(packet) < HEADER.size + FRAME.size:
        raise LinkError("frame without its head")
    count = FRAME.unpack_from(packet, HEADER.size)[2]
    if count * HEADER.size > len(packet):
        raise LinkError(f"frame of {len(packet)} bytes announces {count} components")


def command_words(body: bytes) -> list[str]:
    """The words of a command; the null at its end may be missing.

    Raises:
        LinkError: It is no text, or empty.
    """
    try:
        words = body.rstrip(b"\0").decode("ascii").split()
    except UnicodeDecodeError:
        raise LinkError("command is no ASCII") from None
    if not words:
        raise LinkError("command is empty")
    return words


def parse_components(words: Sequence[str]) -> tuple[str, ...]:
    """Those of the desired components that a twin has; `all` is all of them.

    Raises:
        LinkError: None named, or one that QTM has not.
    """
    names = tuple(dict.fromkeys(word.lower() for word in words))
    if not names or not set(names) <= {*COMPONENTS, *OTHERS, "all"}:
        raise LinkError("unknown component")
    return tuple(COMPONENTS) if "all" in names else tuple(name for name in names if name in COMPONENTS)


def parse_stream(words: Sequence[str]) -> Stream | None:
    """Parameters of StreamFrames; None for `stop`.

    Raises:
        LinkError: They are none that are taken here (UDP among them).
    """
    how, *names = [word.lower() for word in words] or [""]
    if how == "stop":
        return None
    name, _, value = how.partition(":")
    if how == "allframes":
        return Stream(parse_components(names))
    if name not in ("frequency", "frequencydivisor") or not (value.isascii() and value.isdecimal() and len(value) < 6):
        raise LinkError("expected allframes, frequency:n, frequencydivisor:n or stop")
    n = int(value)
    if not 1 <= n <= FASTEST:
        raise LinkError(f"expected 1 to {FASTEST}")
    components = parse_components(names)
    return Stream(components, rate=n) if name == "frequency" else Stream(components, every=n)


def packet(kind: int, body: bytes) -> bytes:
    """A packet of a type."""
    return HEADER.pack(HEADER.size + len(body), kind) + body


def text_packet(kind: int, text: str) -> bytes:
    """An error, a command or its response, or XML: ends with a null."""
    return packet(kind, text.encode() + b"\0")


def event_packet(event: int) -> bytes:
    """An event."""
    return packet(EVENT, bytes([event]))


def data_packet(
    t: float, frame: int, components: Sequence[str], place: Float[np.ndarray, "3"], R: Float[np.ndarray, "3 3"]
) -> bytes:
    """One body of one frame.

    Args:
        t: Time since the measurement began [s].
        frame: Number of the frame.
        components: Names in COMPONENTS.
        place: Of the body in the lab [m]; NaN for a body that is lost, as QTM has it.
        R: Maps the body's axes to the lab's.
    """
    lost = not (np.isfinite(place).all() and np.isfinite(R).all())
    bodies: dict[str, bytes] = _body(place, R, lost) | _markers(place, R, lost)
    labelled, seen = len(MARKERS), 0 if lost else len(MARKERS)
    counts: dict[str, int] = {"3d": labelled, "3dres": labelled, "3dnolabels": seen, "3dnolabelsres": seen}
    counts |= {"6d": 1, "6dres": 1, "6deuler": 1, "6deulerres": 1}
    parts = []
    for name in components:
        content = bodies.get(name, b"")
        parts.append(HEADER.pack(HEADER.size + BODIES.size + len(content), COMPONENTS[name]))
        parts.append(BODIES.pack(counts.get(name, 0), 0, 0) + content)
    stamp = min(max(round(1e6 * t), -(2**63)), 2**63 - 1)
    return packet(DATA, FRAME.pack(stamp, frame % 2**32, len(components)) + b"".join(parts))


def _body(place: Float[np.ndarray, "3"], R: Float[np.ndarray, "3 3"], lost: bool) -> dict[str, bytes]:
    """The body as each component has it."""
    where = struct.pack("<3f", *((math.nan,) * 3 if lost else 1e3 * place))
    turn = struct.pack("<9f", *((math.nan,) * 9 if lost else R.T.ravel()))  # column by column
    angles = struct.pack("<3f", *((math.nan,) * 3 if lost else np.degrees(qualisys_euler(R))))
    residual = struct.pack("<f", math.nan if lost else 0.0)
    bodies = {"6d": where + turn, "6dres": where + turn + residual}
    return bodies | {"6deuler": where + angles, "6deulerres": where + angles + residual}


def _markers(place: Float[np.ndarray, "3"], R: Float[np.ndarray, "3 3"], lost: bool) -> dict[str, bytes]:
    """Its markers likewise: of a body that is lost, those with a label are NaN and those without are not there."""
    places = 1e3 * (place + MARKERS @ R.T)
    labelled, residual = (math.nan,) * 3, math.nan if lost else 0.0
    rows = [labelled if lost else tuple(map(float, row)) for row in places]
    seen = [] if lost else [struct.pack("<3fI", *row, i + 1) for i, row in enumerate(rows)]
    return {
        "3d": b"".join(struct.pack("<3f", *row) for row in rows),
        "3dres": b"".join(struct.pack("<4f", *row, residual) for row in rows),
        "3dnolabels": b"".join(seen),
        "3dnolabelsres": b"".join(row + struct.pack("<f", residual) for row in seen),
    }


def qualisys_euler(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Roll, pitch, yaw [rad] of Qualisys' standard: about x, then the new y, then the new z.

    R = Rx(roll) Ry(pitch) Rz(yaw), whereas Fossen's zyx angles are Rz Ry Rx: near level flight they look alike, and are
    not the same.
    """
    pitch = math.asin(min(1.0, max(-1.0, float(R[0, 2]))))
    return np.array([math.atan2(-R[1, 2], R[2, 2]), pitch, math.atan2(-R[0, 1], R[0, 0])])


def parameters_xml(version: str, bodies: Sequence[str], sections: Sequence[str], rate: float) -> str:
    """Settings as GetParameters gives them: frequency (general), labels of the markers (3d), bodies (6d)."""
    made = {"general": f"<General><Frequency>{rate:g}</Frequency></General>"}
    made |= {"3d": _labels(bodies), "6d": _bodies(bodies)}
    parts = [made[section] for section in SECTIONS if {section, "all"} & set(sections)]
    name = f"QTM_Parameters_Ver_{version}"
    return f"<{name}>{''.join(parts)}</{name}>"


def _labels(bodies: Sequence[str]) -> str:
    names = [f"{body}-{i + 1}" for body in bodies for i in range(len(MARKERS))]
    labels = "".join(f"<Label><Name>{escape(name)}</Name><RGBColor>65280</RGBColor></Label>" for name in names)
    up = "<AxisUpwards>+Z</AxisUpwards><CalibrationTime></CalibrationTime>"
    return f"<The_3D>{up}<Labels>{len(names)}</Labels>{labels}<Bones></Bones></The_3D>"


def _bodies(bodies: Sequence[str]) -> str:
    looks = '<Enabled>true</Enabled><Color R="0" G="255" B="0"/>'
    named = "".join(
        f"<Body><Name>{escape(body)}</Name>{looks}<Points>{_points(body)}</Points></Body>" for body in bodies
    )
    angles = "<Euler><First>Roll</First><Second>Pitch</Second><Third>Yaw</Third></Euler>"
    return f"<The_6D><Bodies>{len(bodies)}</Bodies>{named}{angles}</The_6D>"


def _points(body: str) -> str:
    """Where its markers are on it, in millimetres."""
    return "".join(
        f'<Point X="{x:g}" Y="{y:g}" Z="{z:g}" Virtual="0" PhysicalId="0" Name={quoteattr(f"{body}-{i + 1}")}/>'
        for i, (x, y, z) in enumerate((1e3 * MARKERS).tolist())
    )


def body_names(xml: bytes) -> list[str]:
    """Names of the rigid bodies, in the order of the stream.

    Raises:
        LinkError: It is no XML that QTM sends.
    """
    if len(xml) > LONGEST_PACKET or b"<!DOCTYPE" in xml or b"<!ENTITY" in xml:
        raise LinkError("settings too long, or with declarations that QTM does not make")
    try:
        root = ElementTree.fromstring(xml.rstrip(b"\0").decode("utf-8", "replace"))
    except (ElementTree.ParseError, ValueError) as error:
        raise LinkError(f"settings are no XML: {error}") from None
    return [(body.findtext("Name") or "").strip() for body in root.findall("./The_6D/Body")]
