"""Dotted paths into a scenario's nested data: `world.current.velocity[1]`, `mission.waypoints[*].speed`."""

import re
from typing import Any

from rovtwin.core.config import near, said_kind
from rovtwin.core.errors import ConfigError

_STEP = re.compile(r"([A-Za-z_][\w-]*)|\[(\d+|\*)\]")
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
    if at != len(path) or not steps or not isinstance(steps[0], str) or steps[0] == "*":
        raise ConfigError(f"{where}: {path!r} is no path, expected one such as world.current.velocity[1]")
    return steps


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
    places: list[tuple[Any, str]] = [(data, "")]
    *ahead, last = steps_of(path, where)
    for step in ahead:
        places = [inner for here, said in places for inner in _inside(here, step, said, where)]
    for here, said in places:
        for key in _keys(here, last, said, where):
            if isinstance(here[key] if isinstance(here, list) else here.get(key), dict | list) and not isinstance(
                value, str | bool | dict | list
            ):
                found = here[key]
                within = (
                    f"one of {', '.join(map(str, found))} in it"
                    if isinstance(found, dict)
                    else f"{_said(said, key)}[0]"
                )
                raise ConfigError(
                    f"{where}: {_said(said, key)} is {said_kind(found)}, expected a number's path; name {within}"
                )
            here[key] = value


def _inside(here: Any, step: str | int, said: str, where: str) -> list[tuple[Any, str]]:
    return [(here[key], _said(said, key)) for key in _keys(here, step, said, where)]


def _keys(here: Any, step: str | int, said: str, where: str) -> list[Any]:
    """Keys that a step means: one, or all numbers of a list for "*"."""
    if here is None:
        hint = f"; switch it on: set: {{{said}: {SWITCHES[said]}}}" if said in SWITCHES else ""
        raise ConfigError(f"{where}: the scenario has no {said}{hint}")
    if isinstance(here, list) and step == "*":
        return list(range(len(here)))
    if isinstance(here, list) and isinstance(step, int):
        if step >= len(here):
            raise ConfigError(f"{where}: {said} has {len(here)} elements, counted from 0; there is no {said}[{step}]")
        return [step]
    if isinstance(here, dict) and isinstance(step, str) and step != "*":
        # A vehicle's data holds no defaults: what it lacks there may still be a key, as its own schema will say.
        if step not in here and not said.startswith("vehicle"):
            raise ConfigError(f"{where}: {_said(said, step)}: no such key.{near(step, here)}")
        return [step]
    wanted = "a list" if not isinstance(step, str) or step == "*" else "a mapping"
    raise ConfigError(
        f"{where}: {said or 'the scenario'} is {said_kind(here)}, expected {wanted} for the path to go on"
    )


def _said(before: str, step: str | int) -> str:
    if isinstance(step, int):
        return f"{before}[{step}]"
    return f"{before}.{step}" if before else step
