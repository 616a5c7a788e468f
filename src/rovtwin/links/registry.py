"""The registry of endpoints: a line for each protocol of ours, and the entry points `rovtwin.links` of others.

Endpoints are loaded when they are asked for. One of another package that cannot be loaded disturbs none of the others.
"""

import importlib
from collections.abc import Iterable, Iterator, Sequence

from rovtwin.core.errors import ConfigError
from rovtwin.links.endpoint import Endpoint
from rovtwin.links.url import Url

# Scheme -> where its endpoint stands. The first that is a vehicle's own is what `rovtwin serve` speaks for it.
BUILT_IN = {
    "blueye": "rovtwin.links.blueye.endpoint:BLUEYE",
    "mavlink": "rovtwin.links.mavlink.endpoint:MAVLINK",
    "ros2": "rovtwin.links.ros2.endpoint:ROS2",
    "ugps": "rovtwin.links.waterlinked.endpoint:UGPS",
    "qtm": "rovtwin.links.qualisys.endpoint:QTM",
    "dvl": "rovtwin.links.waterlinked.endpoint:DVL",
    "cerulean": "rovtwin.links.cerulean.endpoint:CERULEAN",
    "ardusub-json": "rovtwin.links.ardusub_json.endpoint:ARDUSUB_JSON",
}


def built_in() -> list[Endpoint]:
    """Our own endpoints, in the order of the table."""
    return [_ours(scheme) for scheme in BUILT_IN]


def endpoints() -> list[Endpoint]:
    """All endpoints that can be loaded: ours, then those of installed packages."""
    return [one for _, one in found() if isinstance(one, Endpoint)]


def found() -> Iterator[tuple[str, Endpoint | ConfigError]]:
    """All endpoints by scheme; in place of one that is of no use, why."""
    from rovtwin.core.plugins import LINKS, loaded

    for scheme in BUILT_IN:
        yield scheme, _ours(scheme)
    for scheme, one in loaded(LINKS):
        try:
            yield scheme, one if isinstance(one, ConfigError) else _checked(scheme, one)
        except ConfigError as error:
            yield scheme, error


def find(scheme: str) -> Endpoint | None:
    """The endpoint of a scheme; None where nobody speaks it.

    Raises:
        ConfigError: An installed package says that it does, and cannot be used.
    """
    if scheme in BUILT_IN:
        return _ours(scheme)
    from rovtwin.core.plugins import LINKS, installed, load

    if scheme not in installed(LINKS):
        return None
    return _checked(scheme, load(scheme, LINKS, f"{scheme}://"))


def parse(text: str, kind: str, option: str, also: Sequence[str] = ()) -> tuple[Url, Endpoint | None]:
    """An address taken apart, and its endpoint.

    Args:
        text: The address.
        kind: What it must be able to make: `link` or `source`.
        option: Of the command line, for messages.
        also: Schemes that the caller serves itself; their endpoint is None.

    Raises:
        ConfigError: No scheme, or one that nobody speaks; options that it has not.
    """
    scheme, colon, _ = text.partition("://")
    if colon and scheme in also:
        return Url.of(text, {}, option), None
    endpoint = find(scheme) if colon else None
    if endpoint is None or getattr(endpoint, kind) is None:
        names = ", ".join(f"{name}://" for name in [*also, *names_of(kind)])
        reason = repr(scheme) if colon else "no scheme"
        raise ConfigError(f"{option} {text}: found {reason}, expected one of {names}")
    return Url.of(text, endpoint.options, option), endpoint


def names_of(*kinds: str, of: Iterable[Endpoint] | None = None) -> list[str]:
    """Schemes of endpoints that can make one of these: `link`, `source`, `server`, `firmware`."""
    known = endpoints() if of is None else of
    return [one.scheme for one in known if any(getattr(one, kind) is not None for kind in kinds)]


def forms(kind: str) -> str:
    """Forms of the addresses of our own endpoints, for a command's help."""
    return ", ".join(one.address for one in built_in() if getattr(one, kind) is not None)


def _ours(scheme: str) -> Endpoint:
    module, _, name = BUILT_IN[scheme].partition(":")
    return getattr(importlib.import_module(module), name)


def _checked(scheme: str, one: object) -> Endpoint:
    """An installed package's endpoint.

    Raises:
        ConfigError: It is none, has another scheme, or one of ours.
    """
    if not isinstance(one, Endpoint):
        raise ConfigError(f"{scheme}://: found {type(one).__name__}, expected a rovtwin.links.endpoint.Endpoint")
    if one.scheme != scheme:
        raise ConfigError(f"{scheme}://: found an endpoint of {one.scheme}://, expected the entry point's own name")
    if scheme in BUILT_IN:
        raise ConfigError(
            f"{scheme}://: found an entry point of that name, expected another: the package has one itself"
        )
    return one
