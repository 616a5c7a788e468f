"""MAVLink frames: bytes to messages and back, with pymavlink's codec of the dialect ardupilotmega."""

import math
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.core.extras import require

CHUNK = 4096  # of a stream; more at once is parsed piece by piece
LONGEST = 280  # bytes of a MAVLink 2 frame with its signature: no more than that is ever kept for later


def dialect() -> Any:
    """pymavlink's module of the dialect.

    Raises:
        LinkError: pymavlink is not installed.
    """
    require("pymavlink", "mavlink", "mavlink", LinkError)
    from pymavlink.dialects.v20 import ardupilotmega

    return ardupilotmega


def text_of(value: Any) -> str:
    """A text field of a message, which codecs give as bytes or as text."""
    return value.decode("ascii", "replace") if isinstance(value, bytes) else str(value)


class Decoder:
    """Frames of one stream or, with a new one each, of one datagram. Bounded memory; what is no frame is counted."""

    def __init__(self) -> None:
        self._mavlink = dialect()
        self._codec = self._mavlink.MAVLink(None)
        self._codec.robust_parsing = True
        self.broken = 0  # pieces that were no frame

    def feed(self, data: bytes) -> list[Any]:
        """Messages that are complete with these bytes, in order; floats in them may be no numbers.

        Raises:
            LinkError: The parser itself failed; its memory is empty then.
        """
        found = []
        for start in range(0, len(data), CHUNK):
            found += self._parse(data[start : start + CHUNK])
        return found

    def _parse(self, data: bytes) -> list[Any]:
        try:
            messages = self._codec.parse_buffer(data) or []
        except Exception as error:  # a fault of pymavlink's must not end a server
            self.reset()
            raise LinkError(f"mavlink: a frame of {len(data)} bytes that the parser cannot take ({error})") from None
        # pymavlink drops what it has read only when nothing is left: a stream that never pauses would pile up.
        del self._codec.buf[: self._codec.buf_index]
        self._codec.buf_index = 0
        known = [m for m in messages if m.get_msgId() >= 0 and not isinstance(m, self._mavlink.MAVLink_unknown)]
        self.broken += len(messages) - len(known)
        return known

    def reset(self) -> None:
        """Forget an unfinished frame."""
        self._codec.buf, self._codec.buf_index = bytearray(), 0

    @property
    def kept(self) -> int:
        """Bytes of an unfinished frame."""
        return len(self._codec.buf)


class Encoder:
    """Frames that one system sends to one peer: they are numbered, so that the peer sees what got lost."""

    def __init__(self, system: int, component: int):
        self._codec, self._component = dialect().MAVLink(None, srcSystem=system, srcComponent=component), component

    def frame(self, message: Any, component: int | None = None) -> bytes:
        """The MAVLink 2 frame of a message of `dialect()`, of another component where one is given."""
        self._codec.srcComponent = self._component if component is None else component
        packed = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        return bytes(packed)


def number(value: Any, otherwise: float = 0.0) -> float:
    """A finite number, or `otherwise`: NaN and infinity come over the wire."""
    value = float(value)
    return value if math.isfinite(value) else otherwise


def whole(value: Any, otherwise: int = -1) -> int:
    """A float of the wire that stands for an integer, or `otherwise` where it does not."""
    value = float(value)
    return int(value) if math.isfinite(value) and value == int(value) else otherwise


def is_addressed(message: Any, system: int, component: int) -> bool:
    """Whether a message is for this system: its target fields, where it has them, name it or everybody (0)."""
    to_system = getattr(message, "target_system", 0)
    to_component = getattr(message, "target_component", 0)
    return to_system in (0, system) and to_component in (0, component)
