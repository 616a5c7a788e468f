"""Scenario and mission files: find, read, override, write."""

import re
from collections.abc import Iterable, Sequence
from importlib.resources import files
from itertools import takewhile
from pathlib import Path
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.core.sensors import SENSORS, kind_of
from rovtwin.core.trust import consent_to_addresses
from rovtwin.core.user_files.config import Strict, near, parse, parse_yaml, read_yaml
from rovtwin.core.user_files.files import is_file
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.scenario.assets import found_beside
from rovtwin.scenario.paths import is_name, separated, set_at, steps_of
from rovtwin.scenario.schema import PRESETS, MissionSection, Scenario, SensorsSection

_ROOT = Path(str(files("rovtwin.scenario")))

VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "dvl": ("sensors", {"dvl": {"on_board": True}}),
    "tether": ("world", {"tethers": True}),
    "ugps": ("sensors", {"position": {"errors": "acoustic", "rate_hz": 2.0, "noise": 0.035, "dropout": 0.14}}),
}
"""What NAME_dvl, NAME_tether and NAME_ugps add to a shipped scenario: the section, and the keys in it."""


def list_scenarios() -> list[str]:
    """Names of the shipped scenarios; each also comes with a DVL, tethers, an Underwater GPS: see `VARIANTS`."""
    return sorted(path.stem for path in (_ROOT / "library").glob("*.yaml"))


def list_missions() -> list[str]:
    """Names of the shipped missions."""
    return sorted(path.stem for path in (_ROOT / "missions").glob("*.yaml"))


def load_scenario(name: str | Path, overrides: Iterable[str] = (), seed: int | None = None) -> Scenario:
    """A scenario by library name or from a file.

    Args:
        name: One of `list_scenarios()`, the same with `_dvl`, `_tether` or both behind it, or a path to a YAML file.
        overrides: `path=value` texts (`scenario/paths.py`); the value is read as YAML. Code that it names may be run
            (`core/trust.py`).
        seed: In place of the file's.

    Raises:
        ConfigError: The file is missing or cannot be used; the message says where and why.
    """
    return overridden(*find_scenario(str(name)), overrides, seed)


def overridden(
    data: dict[str, Any], where: str, base: Path | None, overrides: Iterable[str] = (), seed: int | None = None
) -> Scenario:
    """A scenario from what stands in a file, with some of it changed; arguments as of the two beside it."""
    overrides = list(overrides)
    for text in overrides:
        _apply(data, text)
    if seed is not None:
        data["seed"] = seed
    try:
        return scenario_of(data, where, base)
    except ConfigError as error:
        lines = [_by_override(line, where, overrides) for line in str(error).splitlines()]
        raise ConfigError("\n".join(lines)) from None


def _by_override(line: str, where: str, overrides: Sequence[str]) -> str:
    """A mistake in what an override sets names the override, not the file of the scenario, which need not be there."""
    place = line.removeprefix(f"{where}: ").partition(": ")[0]
    for text in reversed(overrides):
        key = text.partition("=")[0].strip()
        near_by = place == key or place.startswith((f"{key}.", f"{key}[")) or (place and key.startswith(f"{place}."))
        if line.startswith(f"{where}: ") and near_by:
            return f"--set {text}: {line.removeprefix(f'{where}: ')}"
    return line


def scenario_of(data: dict[str, Any], where: str, base: Path | None = None) -> Scenario:
    """A scenario from what stands in a file.

    Args:
        data: As `read_yaml` returned it.
        where: Name of the file, for messages.
        base: Folder in which mission, vehicle, autopilot, scene and mesh files are looked for first.

    Raises:
        ConfigError: It cannot be used; the message says where and why.
    """
    data = dict(data)
    if isinstance(data.get("mission"), str):
        data["mission"] = load_mission(data["mission"], base).model_dump(exclude_unset=True)
    if isinstance(data.get("autopilot"), str):
        data["autopilot"] = _autopilot(data["autopilot"], base)
    if base is not None and isinstance(data.get("vehicle"), str) and is_file(base / data["vehicle"]):
        data["vehicle"] = str(base / data["vehicle"])
    return parse(Scenario, data if base is None else found_beside(data, base), where)


def load_mission(name: str, base: Path | None = None) -> MissionSection:
    """A mission by library name or from a file, relative to `base` first.

    Raises:
        ConfigError: No such mission, or it cannot be used.
    """
    shipped = _ROOT / "missions" / f"{name}.yaml"
    candidates = [*([base / name] if base else []), Path(name), shipped]
    for path in candidates:
        if is_file(path):
            return parse(MissionSection, read_yaml(path), path.name)
    raise ConfigError(_no_such("mission", name, list_missions()))


def _autopilot(name: str, base: Path | None = None) -> str | dict[str, Any]:
    """What stands in the file of an autopilot; the name itself where it is a preset, or nothing that is there."""
    if name not in PRESETS:
        for path in (*([base / name] if base else []), Path(name)):
            if is_file(path):
                return read_yaml(path)
    return name


def find_scenario(name: str) -> tuple[dict[str, Any], str, Path | None]:
    """What stands in the file of a scenario, the file's name, and the folder that its own files lie in.

    Args:
        name: As in `load_scenario`; a shipped one has no such folder.
    """
    known = list_scenarios()
    stem, added = _without_variants(name, known)
    path = _ROOT / "library" / f"{stem}.yaml" if stem in known else Path(name)
    if not is_file(path):
        raise ConfigError(_no_such("scenario", name, known))
    data = read_yaml(path)
    called = _name_from(path)
    if called:
        data.setdefault("name", called)
    if added:
        data["name"] = name
    for variant in added:
        section, more = VARIANTS[variant]
        data[section] = (data.get(section) or {}) | more
    return data, path.name, None if stem in known else path.parent


def _name_from(path: Path) -> str:
    """The file's name as a scenario may be called, for one that says no name; empty where nothing is left of it."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", path.stem).lstrip("_.-")


def _without_variants(name: str, known: list[str]) -> tuple[str, list[str]]:
    """The shipped scenario that a name is a variant of, and what is added to it; the name itself where it is none."""
    stem, added = name, []
    while stem not in known:
        variant = stem[stem.rfind("_") + 1 :]
        if variant not in VARIANTS or variant in added:
            return name, []
        stem, added = stem.removesuffix(f"_{variant}"), [variant, *added]
    return stem, added


def _no_such(kind: str, name: str, known: list[str]) -> str:
    return f"{name}: no such {kind}: neither a file nor the name of a shipped one.{near(name, known)}"


def _apply(data: dict[str, Any], text: str) -> None:
    """Set `a.b.c=value` in nested dictionaries."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {text}: expected key=value, such as world.current=[0.1,0,0]")
    found = parse_yaml(f"value: {value}", f"--set {text}")["value"]
    if key.strip().partition(".")[0] in ("autopilot", "sensors", "world"):
        consent_to_addresses(found)  # whoever calls the program names this code, no file does
    put(data, key.strip(), found, f"--set {text}")


def put(data: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Set what stands at a path (`scenario.paths`) in a scenario's data as its file has it, without defaults.

    Raises:
        ConfigError: There is no such key or element; the message begins with `where`.
    """
    steps = steps_of(key, where)
    names = [str(step) for step in takewhile(is_name, steps)]
    _check_path(names, where)
    if len(steps) > 1 and names[0] == "vehicle" and not isinstance(data.get("vehicle"), dict):
        named = data.get("vehicle") or Scenario.model_fields["vehicle"].default
        raise ConfigError(
            f"{where}: the scenario names its vehicle ({named}) and does not describe it: change a file of it (rovtwin "
            "vehicle add, remove and ballast write one) and name that: --set vehicle=my_vehicle.yaml"
        )
    data |= {name: separated(section) for name, section in data.items()}
    at, (*sections, last) = data, names
    for step in sections:
        if not isinstance(at.get(step), dict):
            # A section given by its short form (a name, a list, nothing) is opened before a key is set in it.
            at[step] = _opened(step, at.get(step))
        at = at[step]
    if len(names) == len(steps):
        at[last] = value
    elif isinstance(at.get(last), list):
        set_at(at, steps[len(sections) :], value, where, ".".join(sections), complete=False)
    else:
        named = ".".join(names)
        raise ConfigError(f"{where}: the scenario's file gives no list {named}: set it whole, {named}=[...]")


def _opened(step: str, value: Any) -> dict[str, Any]:
    if step == "mission" and isinstance(value, str):
        return load_mission(value).model_dump(exclude_unset=True)
    if step == "sensors" and isinstance(value, str):
        return {"preset": value}
    if step in ("tethers", "mismatch") and value is True:
        return {}
    if step == "autopilot" and isinstance(value, str):
        found = _autopilot(value)
        return dict(PRESETS.get(value, {})) if isinstance(found, str) else found
    return {}


def _check_path(path: list[str], where: str) -> None:
    """Raise with a near name where the first steps of an override are not in the schema."""
    section: type[Strict] | None = Scenario
    for depth, step in enumerate(path):
        if section is None:
            return
        names = list(section.model_fields)
        if section is SensorsSection and kind_of(step) in SENSORS:
            step = kind_of(step)  # the vehicle says how many there are
        elif section is SensorsSection and step not in names:
            return  # of one's own, or a mistake: the section knows
        if step not in names:
            raise ConfigError(f"{where}: {'.'.join(path[: depth + 1])}: no such key.{near(step, names)}")
        annotation = section.model_fields[step].annotation
        section = annotation if isinstance(annotation, type) and issubclass(annotation, Strict) else None


def dump_scenario(scenario: Scenario) -> str:
    """The complete scenario as YAML, ready to be flown again."""
    return dump_yaml(scenario.model_dump(mode="json"))
