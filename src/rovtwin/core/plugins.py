"""What others bring: objects by an address `package.module:Name`, or by the name of an installed entry point.

To import a module is to run it. What is installed was chosen by who installed it; an address needs consent (`trust`).
"""

import ast
import importlib
import importlib.util
import os
import pkgutil
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from rovtwin.core import trust
from rovtwin.core.errors import ConfigError
from rovtwin.core.trust import is_address
from rovtwin.core.user_files.yamlfile import near

BLOCKS, LINKS, READERS = "rovtwin.blocks", "rovtwin.links", "rovtwin.readers"
OWN_SENSORS, EVIDENCE, VIEWS = "rovtwin.sensors", "rovtwin.evidence", "rovtwin.views"


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
    return _at(*_entry(text, group, where))


def require_there(text: str, group: str, where: str) -> None:
    """Raise ConfigError, as `load` would, where an address or an entry point certainly leads nowhere.

    Nothing is imported but the packages around a module, so that a mistyped name is seen at once: importing the module
    would import JAX. Names that its file does not show are left to `load`.
    """
    address = text
    if is_address(text):
        trust.require(text, where)
    else:
        address, where = _entry(text, group, where)
    module, _, name = address.partition(":")
    with _files_beside():
        try:
            spec = importlib.util.find_spec(module)
        except ModuleNotFoundError as error:
            raise ConfigError(f"{where}: {address}: {_not_imported(error, module)}") from None
        except Exception:  # of a package around it: `load` says what
            return
        if spec is None:
            raise ConfigError(f"{where}: {address}: {_no_module(module)}")
    first = name.partition(".")[0]
    names = _names_in(Path(spec.origin)) if spec.origin and spec.origin.endswith(".py") else None
    if names is not None and first not in names:
        raise ConfigError(f"{where}: {address}: {_no_name(first, module, names)}")


def _entry(text: str, group: str, where: str) -> tuple[str, str]:
    """Address of an entry point, and where it was named, for messages."""
    known = installed(group)
    if text not in known:
        names = f"one of {', '.join(sorted(known))}" if known else f"no installed package brings any for {group}"
        raise ConfigError(
            f"{where}: found {text!r}, expected package.module:Name, or the name of an entry point ({names})"
            f"{near(text, known) if known else ''}"
        )
    return known[text].value, f"{where}: {text} (entry point of {_package(known[text])})"


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
        with _files_beside():
            raise ConfigError(f"{where}: {address}: {_not_imported(error, module)}") from None
    except Exception as error:  # a module of somebody else may raise anything
        raise ConfigError(f"{where}: {address}: importing {module} failed: {type(error).__name__}: {error}") from error
    for part in name.split("."):
        if not hasattr(found, part):
            raise ConfigError(f"{where}: {address}: {_no_name(part, module, _own_names(found, module))}")
        found = getattr(found, part)
    return found


def _own_names(found: Any, module: str) -> list[str]:
    """What is defined in an object of a module and not merely imported there."""
    return [
        name for name, value in getattr(found, "__dict__", {}).items() if getattr(value, "__module__", module) == module
    ]


def _no_name(name: str, module: str, names: Iterable[str]) -> str:
    public = [one for one in names if not one.startswith("_")]
    return f"found no {name!r} in {module}, expected the name of an object there.{near(name, public)}"


def _not_imported(error: ModuleNotFoundError, module: str) -> str:
    """That a module is missing: the one that was asked for, or one that it imports itself."""
    if error.name and (module == error.name or module.startswith(f"{error.name}.")):
        return _no_module(error.name)
    return f"importing {module} failed: {error}"


def _no_module(name: str) -> str:
    """That there is no such module, and where it was looked for; called while the working directory is looked into."""
    package, _, last = name.rpartition(".")
    around = getattr(sys.modules.get(package), "__path__", None)
    if package and around is None:
        return f"found no module {name!r}, as {package} is a module and no package; expected {package}:NAME"
    hint = near(last, {one.name for one in pkgutil.iter_modules(around)})
    if not package and not hint.startswith(" Did"):
        hint = ""  # names of all that is installed help nobody
    own = [os.path.abspath(one) for one in around or sys.path if not one.startswith((sys.prefix, sys.base_prefix))]
    folders = ", ".join(one for one in dict.fromkeys(own) if os.path.isdir(one))
    return (
        f"found no module {name!r}, expected one that Python finds: install its package, or name its folder in "
        f"PYTHONPATH (looked for in {folders}{'' if package else ' and among installed packages'}).{hint}"
    )


def _names_in(file: Path) -> set[str] | None:
    """Names that a module's file gives at its top level; None where only running it tells."""
    try:
        body = ast.parse(file.read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        return None
    names: set[str] = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)}
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {(one.asname or one.name).partition(".")[0] for one in node.names}
        elif not isinstance(node, ast.Expr):
            return None  # a condition, a loop, ..
    return None if names & {"*", "__getattr__"} else names


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
