"""Addresses of links and instruments: `scheme://rest?option&option=number,number`."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from urllib.parse import unquote, urlsplit

from rovtwin.core.errors import ConfigError

_OWN = re.compile(r"(?:[a-z]+:)?127(?:\.\d{1,3}){3}(?::\d+)?(?:/.*)?")  # an address of this machine, by number


@dataclass(frozen=True)
class Url:
    """An address as the user gave it: `scheme://rest?option&option=number,number`.

    Attributes:
        text: All of it.
        scheme: What is before `://`.
        rest: What is between that and the options.
        options: Those that were given, each with its numbers [m, degrees].
    """

    text: str
    scheme: str
    rest: str
    options: dict[str, tuple[float, ...]] = field(default_factory=dict)

    @classmethod
    def of(cls, text: str, known: Mapping[str, str], option: str) -> "Url":
        """Taken apart; its scheme is one that somebody speaks, see `registry.parse`.

        Args:
            text: The address.
            known: Options of its scheme, each with the form of the numbers that it takes, "" for none.
            option: Of the command line, for messages.

        Raises:
            ConfigError: An option that there is not, one given twice, or not with such numbers.
        """
        scheme, _, rest = text.partition("://")
        rest, _, query = rest.partition("?")
        options: dict[str, tuple[float, ...]] = {}
        for part in filter(None, query.split("&")):
            name, numbers = _parse_option(unquote(part), known, f"{option} {text}", scheme)
            if name in options:
                raise ConfigError(f"{option} {text}: found the option '{name}' twice, expected it once")
            options[name] = numbers
        return cls(text, scheme, unquote(rest), options)

    def host_port(self, port: int) -> tuple[str, int]:
        """Host and port, the latter as given or the protocol's own.

        Raises:
            ConfigError: There is no host, the port is no number, or there is more than that.
        """
        try:
            parts = urlsplit(f"//{self.rest}")
            host, given = parts.hostname, parts.port
        except ValueError as error:
            raise ConfigError(f"{self.text}: {error}, expected {self.scheme}://HOST[:PORT]") from None
        if not host:
            raise ConfigError(f"{self.text}: found no host, expected {self.scheme}://HOST[:PORT]")
        if parts.path.strip("/"):
            raise ConfigError(f"{self.text}: found '{parts.path}' after it, expected {self.scheme}://HOST[:PORT]")
        return host, given or port

    @property
    def is_loopback(self) -> bool:
        """Whether it names addresses by number only, and all of them are this machine's own."""
        return all(_OWN.fullmatch(part.strip()) for part in self.rest.split(","))


def _parse_option(part: str, known: Mapping[str, str], where: str, scheme: str) -> tuple[str, tuple[float, ...]]:
    """An option's name and numbers."""
    name, given, text = part.partition("=")
    if name not in known:
        forms = ", ".join(f"{n}={form}" if form else n for n, form in known.items())
        expected = forms or f"none: {scheme}:// has no options"
        raise ConfigError(f"{where}: found the option '{name}', expected {expected}")
    form = known[name]
    wrong = ConfigError(f"{where}: found the option '{part}', expected {name}{'=' if form else ''}{form}")
    if not form:
        if given:
            raise wrong
        return name, ()
    try:
        numbers = tuple(float(number) for number in text.split(","))
    except ValueError:
        raise wrong from None
    if len(numbers) != len(form.split(",")) or not all(map(math.isfinite, numbers)):
        raise wrong
    return name, numbers
