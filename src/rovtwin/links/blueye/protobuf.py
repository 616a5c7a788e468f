"""The messages of blueye.protocol by name, as plain protobuf classes: a tenth of the time of the SDK's wrappers."""

from functools import cache
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.core.extras import imported

PACKAGE = "blueye.protocol."
LONGEST_NAME = 80  # bytes; the longest of protocol 3.5 has 50


@cache
def message(name: str) -> Any:
    """The protobuf class of a message, by its name without the package.

    Raises:
        LinkError: There is no such message, or blueye.sdk is not installed.
    """
    protocol = imported("blueye.protocol", "blueye", "Blueye's protocol", LinkError)
    if name not in names():
        raise LinkError(f"message {name[:LONGEST_NAME]!r}: not one of Blueye's protocol")
    wrapper = getattr(protocol, name)
    return wrapper.pb(None, coerce=True)


def text(words: str) -> bytes:
    """The bytes of a google.protobuf.StringValue."""
    from google.protobuf.wrappers_pb2 import StringValue

    return StringValue(value=words).SerializeToString()


@cache
def names(suffix: str = "") -> frozenset[str]:
    """Names of all messages that end so: `Tel` for telemetry, `Ctrl`, `Req`, `Rep`.

    Raises:
        LinkError: blueye.sdk is not installed.
    """
    protocol = imported("blueye.protocol", "blueye", "Blueye's protocol", LinkError)
    import proto

    found = {name: getattr(protocol, name) for name in dir(protocol) if name.endswith(suffix)}
    return frozenset(name for name, kind in found.items() if isinstance(kind, type) and issubclass(kind, proto.Message))


def frame_name(frame: bytes, suffix: str) -> str:
    """Name of a message as the first frame gives it, without the package.

    Raises:
        LinkError: It is no name of the protocol with this ending.
    """
    if len(frame) > LONGEST_NAME:
        raise LinkError(f"name of a message: {len(frame)} bytes, expected at most {LONGEST_NAME}")
    try:
        name = frame.decode("ascii").removeprefix(PACKAGE)
    except UnicodeDecodeError:
        raise LinkError(f"name of a message: {frame[:20]!r} is no text") from None
    if name not in names(suffix):
        raise LinkError(f"message {name!r}: expected one of Blueye's protocol that ends in {suffix}")
    return name


def parse(name: str, payload: bytes) -> Any:
    """A message from its bytes.

    Raises:
        LinkError: The bytes are not this message.
    """
    try:
        return message(name).FromString(payload)
    except LinkError:
        raise
    # Truncated and garbled bytes: DecodeError, and by version of protobuf ValueError or RecursionError as well.
    except Exception as error:
        raise LinkError(f"{name}: {len(payload)} bytes that are no such message ({type(error).__name__})") from None
