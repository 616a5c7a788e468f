"""What others bring: objects by an address `package.module:Name`, or by the name of an installed entry point."""

import importlib
import os
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from rovtwin.core.errors import ConfigError

BLOCKS, LINKS, READERS = "rovtwin.blocks", "rovtwin.links", "rovtwin.readers"


def installed(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name, of all packages that are installed; of two with one name the first found."""
    found: dict[str, EntryPoint] = {}
    for one in entry_points(group=group):
        found.setdefault(one.name, one)
    return found


def is_address(text: str) -> bool:
    """Whether a text has the form `package.module:Name`."""
    module, colon, name = text.partition(":")
    return bool(colon) and all(part.isidentifier() for part in f"{module}.{name}".split("."))


def load(text: str, group: str, where: str) -> Any:
    """The object at an address, or of an entry point.

    Args:
        text: `package.module:Name`, or a name of the group.
        group: Of entry points.
        where: Key or option that it was given by, for messages.

    Raises:
        ConfigError: There is no such module, attribute or entry point, or importing it fails.
    """
    if is_address(text):
        return _at(text, where)
    known = installed(group)
    if text not in known:
        names = f"one of {', '.join(sorted(known))}" if known else f"no installed package brings any for {group}"
        raise ConfigError(
            f"{where}: found {text!r}, expected package.module:Name, or the name of an entry point ({names})"
        )
    return _at(known[text].value, f"{where}: {text} (entry point of {_package(known[text])})")


def loaded(group: str) -> Iterator[tuple[str, Any]]:
    """Objects of all entry points of a group by name; in place of one that cannot be loaded, the ConfigError."""
    for name, one in installed(group).items():
        try:
            yield name, _at(one.value, f"{name} (entry point of {_package(one)})")
        except ConfigError as error:
            yield name, error


def _at(address: str, where: str) -> Any:
    module, _, name = address.partition(":")
    if (here := os.getcwd()) not in sys.path and "" not in sys.path:
        sys.path.append(here)  # last: a command finds the file beside it, as python does, and hides nothing
    try:
        found: Any = importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name and (module == error.name or module.startswith(f"{error.name}.")):
            raise ConfigError(
                f"{where}: {address}: found no module {error.name!r}, expected one that Python finds: install its "
                "package, or name its folder in PYTHONPATH"
            ) from None
        raise ConfigError(f"{where}: {address}: importing {module} failed: {error}") from error
    except Exception as error:  # a module of somebody else may raise anything
        raise ConfigError(f"{where}: {address}: importing {module} failed: {type(error).__name__}: {error}") from error
    for part in name.split("."):
        if not hasattr(found, part):
            raise ConfigError(
                f"{where}: {address}: found no {part!r} in {module}, expected the name of an object there"
            )
        found = getattr(found, part)
    return found


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else "an unknown package"
