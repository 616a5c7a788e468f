"""What others bring: objects by an address `package.module:Name`, or by the name of an installed entry point.

To import a module is to run it. What is installed was chosen by who installed it; an address needs consent (`trust`).
"""

import importlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from rovtwin.core import trust
from rovtwin.core.errors import ConfigError
from rovtwin.core.trust import is_address

BLOCKS, LINKS, READERS = "rovtwin.blocks", "rovtwin.links", "rovtwin.readers"
OWN_SENSORS = "rovtwin.sensors"


def installed(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group by name, of all packages that are installed; of two with one name the first found."""
    found: dict[str, EntryPoint] = {}
    for one in entry_points(group=group):
        found.setdefault(one.name, one)
    return found


def load(text: str, group: str, where: str) -> Any:
    """The object at an address, or of an entry point.

    Args:
        text: `package.module:Name`, or a name of the group.
        group: Of entry points.
        where: Key or option that it was given by, for messages.

    Raises:
        ConfigError: Nobody consented to run the module of an address; there is no such module, attribute or entry
            point, or importing it fails.
    """
    if is_address(text):
        trust.require(text, where)
        return _at(text, where)
    known = installed(group)
    if text not in known:
        names = f"one of {', '.join(sorted(known))}" if known else f"no installed package brings any for {group}"
        raise ConfigError(
            f"{where}: found {text!r}, expected package.module:Name, or the name of an entry point ({names})"
        )
    return _at(known[text].value, f"{where}: {text} (entry point of {_package(known[text])})")


def module_of(text: str, group: str) -> str:
    """Name of the module that an address or an entry point leads to, without importing it; "" for none."""
    if not is_address(text):
        text = one.value if (one := installed(group).get(text)) else ""
    return text.partition(":")[0].strip()


def origin(text: str, group: str) -> dict[str, str]:
    """Which code stands at an address or entry point whose module is imported: `module`; `sha256` of its file; of an
    installed one the `package`, name and version.
    """
    name = module_of(text, group)
    found = {"module": name}
    with suppress(OSError):  # no file, or one that is gone by now
        if file := getattr(sys.modules.get(name), "__file__", None):
            found["sha256"] = sha256(Path(file).read_bytes()).hexdigest()
    one = None if is_address(text) else installed(group).get(text)
    return found | ({"package": f"{one.dist.name} {one.dist.version}"} if one and one.dist else {})


def loaded(group: str) -> Iterator[tuple[str, Any]]:
    """Objects of all entry points of a group by name; in place of one that cannot be loaded, the ConfigError."""
    for name, one in installed(group).items():
        try:
            yield name, _at(one.value, f"{name} (entry point of {_package(one)})")
        except ConfigError as error:
            yield name, error


def _at(address: str, where: str) -> Any:
    module, _, name = address.partition(":")
    try:
        with _files_beside():
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


@contextmanager
def _files_beside() -> Iterator[None]:
    """A command finds the file beside it, as python does, while it looks for it and no longer."""
    here = os.getcwd()
    if here in sys.path or "" in sys.path:
        yield
        return
    sys.path.append(here)  # last: it hides nothing
    try:
        yield
    finally:
        with suppress(ValueError):  # the module that was imported has taken it away itself
            sys.path.remove(here)


def _package(entry: EntryPoint) -> str:
    return entry.dist.name if entry.dist else "an unknown package"
