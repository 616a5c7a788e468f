"""Dotted paths into a scenario's nested data: `world.current.velocity[1]`, `mission.waypoints[*].speed`.

Overrides (`--set`) and campaigns (`set`, `vary`) name places by them.
"""

import re
from copy import deepcopy
from typing import Any, TypeGuard

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import kind_in_words, near
from rovtwin.core.user_files.quantity import is_number
from rovtwin.scenario.schema import Waypoint

_STEP = re.compile(r"([A-Za-z_][\w-]*)|\[(\d+|\*)\]")
ADDED_UP = ("mass", "volume", "inertia", "center_of_gravity", "center_of_buoyancy")  # of a vehicle of parts
SWITCHES = {"world.mismatch": "true", "world.tethers": "true", "battery": "true", "world.waves": "{drift: 0.03}"}


def steps_of(path: str, where: str) -> list[str | int]:
    """Keys and numbers of a path; "*" is all elements of a list.

    Raises:
        ConfigError: It is no path.
    """
    steps: list[str | int] = []
    at = 0
    while match := _STEP.match(path, at):
        key, number = match.groups()
        steps.append(key or (number if number == "*" else int(number)))
        at = match.end()
        if path[at : at + 1] == "." and re.match(r"[A-Za-z_]", path[at + 1 :]):
            at += 1
        elif path[at : at + 1] != "[":
            break
    if at != len(path) or not steps or not is_name(steps[0]):
        raise ConfigError(f"{where}: {path!r} is no path, expected one such as world.current.velocity[1]")
    return steps


def is_name(step: str | int) -> TypeGuard[str]:
    """Whether a step is a key, and no element or all elements of a list."""
    return isinstance(step, str) and step != "*"


def assign(data: dict[str, Any], path: str, value: Any, where: str) -> None:
    """Set the scalar at a path in place.

    Args:
        data: A complete scenario, nested dictionaries and lists.
        path: What to set.
        value: A scalar, or the name that stands for a section (`autopilot`, `mission`).
        where: Begins the messages.

    Raises:
        ConfigError: There is nothing at the path, or a number would take the place of a section.
    """
    set_at(data, steps_of(path, where), value, where)


def set_at(
    data: dict[str, Any], steps: list[str | int], value: Any, where: str, below: str = "", complete: bool = True
) -> None:
    """Set what the steps of a path lead to, as `assign`.

    Args:
        data: A complete scenario, or a section of it.
        steps: From there.
        value: See `assign`.
        where: Begins the messages.
        below: Path of the section, for messages.
        complete: Whether `data` holds defaults, too; else its last key may be new.
    """
    places: list[tuple[Any, str]] = [(data, below)]
    *ahead, last = steps
    for step in ahead:
        places = [(here[k], _joined(written, k)) for here, written in places for k in _keys(here, step, written, where)]
    for here, written in places:
        for key in _keys(here, last, written, where, new=not complete or _may_be_new(written, last)):
            _require_no_sum(here, written, key, where)
            found = here.get(key) if isinstance(here, dict) else here[key]
            if isinstance(found, dict | list) and is_number(value):
                within = ", ".join(map(str, found)) if isinstance(found, dict) else f"[0] to [{len(found) - 1}]"
                raise ConfigError(
                    f"{where}: {_joined(written, key)} is {kind_in_words(found)}, expected a number's path; "
                    f"name one of {within} in it"
                )
            here[key] = deepcopy(value)  # one for each place


def _keys(here: Any, step: str | int, path: str, where: str, new: bool = False) -> list[Any]:
    """Keys that a step means: one, or all numbers of a list for "*".

    A `new` key need not be there yet, see `_may_be_new`.
    """
    if here is None:
        hint = f"; switch it on: set: {{{path}: {SWITCHES[path]}}}" if path in SWITCHES else ""
        raise ConfigError(f"{where}: the scenario has no {path}{hint}")
    if isinstance(here, list) and step == "*":
        if not here:
            raise ConfigError(f"{where}: {path} has no elements, so that {path}[*] names nothing")
        return list(range(len(here)))
    if isinstance(here, list) and isinstance(step, int):
        if step >= len(here):
            raise ConfigError(f"{where}: {path} has {len(here)} elements, counted from 0; there is no {path}[{step}]")
        return [step]
    if isinstance(here, dict) and is_name(step):
        if step not in here and not new:
            raise ConfigError(f"{where}: {_joined(path, step)}: no such key.{near(step, here)}")
        return [step]
    expected = "a mapping" if is_name(step) else "a list"
    raise ConfigError(
        f"{where}: {path or 'the scenario'} is {kind_in_words(here)}, expected {expected} for the path to go on"
    )


def separated(value: Any) -> Any:
    """Mappings and lists anew: those that YAML's aliases (`*name`, `<<: *name`) share become each its own."""
    if isinstance(value, dict):
        return {key: separated(one) for key, one in value.items()}
    return [separated(one) for one in value] if isinstance(value, list) else value


def _require_no_sum(here: Any, path: str, key: Any, where: str) -> None:
    """What parts add up to is not set from above: a mass of the whole would be one more body, at the origin.

    Raises:
        ConfigError: It is one of those, with the parts that have it.
    """
    if path.split(".")[0] != "vehicle" or key not in ADDED_UP or key in here or not here.get("parts"):
        return
    found = [f"{path}.parts[{i}].{key} ({part.get('name', 'without a name')})"
             for i, part in enumerate(here["parts"]) if key in part]  # fmt: skip
    instead = f"name {' or '.join(found)}" if found else "its parts are files: change them, or choose among vehicles"
    raise ConfigError(
        f"{where}: {path}.{key} is what its parts add up to, and another would be added to them; {instead}"
    )


def _may_be_new(path: str, key: str | int) -> bool:
    """Whether a key need not be there yet below what is `path`: what the vehicle fills in is left out of a mission.

    A vehicle's data holds no defaults, and its own schema says what it knows.
    """
    if path.startswith("mission.waypoints["):
        return key in Waypoint.model_fields
    return path.startswith("vehicle") or (not path and key == "duration")


def _joined(before: str, step: str | int) -> str:
    if isinstance(step, int):
        return f"{before}[{step}]"
    return f"{before}.{step}" if before else step
