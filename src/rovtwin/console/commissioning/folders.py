"""Commissionings below the console's data folder: which there are, beginning one, and what was asked for anew."""

import json
import re
from datetime import datetime
from pathlib import Path
from typing import Any

from rovtwin.commission.dossier import INDEX, Dossier
from rovtwin.commission.request import Request
from rovtwin.core.errors import ConfigError
from rovtwin.live.connect import on_this_machine

MOST = 100  # that are listed
NAMED = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,59}")
TEXTS, FIGURES, LISTS = ("vehicle", "link", "tank"), ("minutes", "interval"), ("currents", "seas")
# As the command line has them: least and most of each figure.
RANGES = {"minutes": (1.0, 240.0), "interval": (0.005, 1.0), "currents": (0.0, 5.0), "seas": (0.0, 10.0)}
MOST_SAMPLES, MOST_TEXT, MOST_LIST = 10_000, 500, 10


def listed(root: Path) -> list[dict[str, Any]]:
    """Those in a folder and in folders of it, the one that was worked on last first."""
    found = []
    for index in [*root.glob(f"*/{INDEX}"), *root.glob(f"*/*/{INDEX}")]:
        try:
            changed = index.stat().st_mtime
            data = json.loads(index.read_text(encoding="utf-8"))
            vehicle, link = str(data["request"]["vehicle"]), str(data["request"]["link"])
            last = str(data["attempts"][-1]["stage"]) if data["attempts"] else ""
        except (OSError, ValueError, KeyError, TypeError, IndexError):
            continue  # another file of that name, or a damaged one, which opening it by its name reports
        name = index.parent.relative_to(root).as_posix()
        when = f"{datetime.fromtimestamp(changed):%Y-%m-%d %H:%M}"
        found.append((changed, {"name": name, "vehicle": Path(vehicle).name, "link": link, "last": last, "date": when}))
    return [one for _, one in sorted(found, key=lambda one: one[0], reverse=True)[:MOST]]


def find(root: Path, name: Any) -> Path:
    """The folder of a commissioning.

    Raises:
        ConfigError: There is no such one in the folder; nothing outside of it is one.
    """
    base = root.resolve()
    try:
        path = (base / str(name)).resolve()
        known = path != base and path.is_relative_to(base) and (path / INDEX).is_file()
    except (OSError, ValueError):  # a name that is too long, or holds a zero
        known = False
    if not known:
        raise ConfigError(f"{str(name)[:80]!r}: found no such commissioning in {root}; choose one of the list")
    return path


def file_of(root: Path, name: str, path: str) -> Path:
    """A file within a commissioning; ConfigError where there is none."""
    folder = find(root, name)
    try:
        found = (folder / path).resolve()
        known = found.is_relative_to(folder) and found.is_file()
    except (OSError, ValueError):
        known = False
    if not known:
        raise ConfigError(f"{path[:80]!r}: found no such file in the commissioning {name}")
    return found


def begin(root: Path, name: Any, form: Any) -> str:
    """Begin one in a new folder of that name; its name.

    Raises:
        ConfigError: The name, or what is asked for, cannot be used; nothing is written then.
    """
    if not isinstance(name, str) or not NAMED.fullmatch(name):
        raise ConfigError(f"folder: found {name!r:.80}, expected a name of letters, digits, '.', '_' and '-'")
    if (root / name).exists():
        raise ConfigError(f"folder: {root / name} is there already; open it, or take another name")
    request = request_of(form)
    request.require_usable()
    on_this_machine(request.link)  # refuses what is no link
    Dossier.begin(root / name, request)
    return name


def ask_anew(root: Path, name: Any, form: Any) -> None:
    """Change what was asked for: link, tank, minutes and the like. Of the vehicle only another file of the same name.

    Raises:
        ConfigError: It cannot be used, or another process is at it.
    """
    dossier = Dossier.open(find(root, name))
    request = request_of({**dossier.request.to_dict(), **(form if isinstance(form, dict) else {})})
    if request.absolute().vehicle != dossier.request.vehicle:
        raise ConfigError(f"vehicle: this is the commissioning of {dossier.request.vehicle}; begin another for another")
    request.require_usable()
    on_this_machine(request.link)
    with dossier.locked():
        Dossier.open(dossier.folder).changed(request)


def request_of(form: Any) -> Request:
    """What a page asks for, checked as the command line checks it.

    Raises:
        ConfigError: Something is missing, or is no such thing; the text names the field.
    """
    if not isinstance(form, dict):
        raise ConfigError(f"request: found {type(form).__name__}, expected the fields of the form")
    data: dict[str, Any] = {key: _text(form, key) for key in TEXTS}
    data["prior"] = _text(form, "prior") if form.get("prior") else None
    data["sensors"] = tuple(_text({"sensors": one}, "sensors") for one in _items(form, "sensors"))
    data |= {key: _figure(key, form[key]) for key in FIGURES if form.get(key) is not None}
    data |= {key: tuple(_figure(key, one) for one in _items(form, key)) for key in LISTS if form.get(key)}
    if (samples := form.get("samples")) is not None:
        if isinstance(samples, bool) or not isinstance(samples, int) or not 1 <= samples <= MOST_SAMPLES:
            raise ConfigError(f"missions: found {samples!r:.40}, expected a whole number from 1 to {MOST_SAMPLES}")
        data["samples"] = samples
    kept = {key: form[key] for key in ("speed", "seed") if key in form}  # which no page changes
    return Request.from_dict(data | kept)


def _text(form: dict[str, Any], key: str) -> str:
    found = form.get(key)
    if not isinstance(found, str) or not found.strip() or len(found) > MOST_TEXT:
        raise ConfigError(f"{key}: found {found!r:.80}, expected a text")
    return found.strip()


def _items(form: dict[str, Any], key: str) -> list[Any]:
    found = form.get(key) or []
    if not isinstance(found, list | tuple) or len(found) > MOST_LIST:
        raise ConfigError(f"{key}: found {found!r:.80}, expected a list of {MOST_LIST} at most")
    return list(found)


def _figure(key: str, found: Any) -> float:
    low, high = RANGES[key]
    if isinstance(found, bool) or not isinstance(found, int | float) or not low <= found <= high:
        raise ConfigError(f"{key}: found {found!r:.40}, expected a number from {low:g} to {high:g}")
    return float(found)
