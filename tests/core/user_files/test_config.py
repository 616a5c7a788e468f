"""Reading YAML strictly and answering mistakes in the words of the file."""

from typing import Literal

import pytest
from pydantic import Field

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import Number, Positive, Radians, Strict, Vector3, parse, parse_yaml, read_yaml


class Thruster(Strict):
    gain: Positive = Field(description="N per command")
    curve: Literal["linear", "power"] = "linear"
    angle: Radians = 0.0


class Named(Strict):
    kind: Literal["named"]
    name: str


class Part(Strict):
    thrusters: list[Thruster] = []
    position: Vector3 = [0.0, 0.0, 0.0]
    either: Named | float | None = None


class Vehicle(Strict):
    parts: list[Part]
    count: int = 1
    on: bool = False
    size: tuple[Number, Number, Number] = (1.0, 1.0, 1.0)


def message(text):
    with pytest.raises(ConfigError) as error:
        parse(Vehicle, parse_yaml(text, "v.yaml"), "v.yaml")
    return str(error.value)


PARTS = [
    (
        "parts: [{thrusters: [{gain: 1, gian: 3}]}]",
        "v.yaml: parts[0].thrusters[0].gian: no such key. Did you mean 'gain'?",
    ),
    ("parts: [{wings: 2}]", "v.yaml: parts[0].wings: no such key. Known: either, position, thrusters."),
    ("parts: [{thrusters: [{}]}]", "v.yaml: parts[0].thrusters[0].gain: missing (N per command)"),
    (
        "parts: [{thrusters: [{gain: -3}]}]",
        "v.yaml: parts[0].thrusters[0].gain: found -3, expected a number greater than 0",
    ),
    ("parts: [{thrusters: [{gain: .nan}]}]", "v.yaml: parts[0].thrusters[0].gain: found nan, expected a finite number"),
    ("parts: [{thrusters: [{gain: .inf}]}]", "v.yaml: parts[0].thrusters[0].gain: found inf, expected a finite number"),
    ("parts: [{thrusters: [{gain: true}]}]", "v.yaml: parts[0].thrusters[0].gain: found True, expected a number"),
    (
        "parts: [{thrusters: [{gain: 3 N}]}]",
        "v.yaml: parts[0].thrusters[0].gain: found '3 N', expected a number; units are fixed (SI) and are not written",
    ),
    (
        "parts: [{thrusters: [{gain: 1, curve: liner}]}]",
        "v.yaml: parts[0].thrusters[0].curve: found 'liner', expected 'linear' or 'power'. Did you mean 'linear'?",
    ),
    (
        "parts: [{thrusters: [{gain: 1, angle: 90}]}]",
        "v.yaml: parts[0].thrusters[0].angle: found 90 rad, which looks like degrees: write 1.571",
    ),
    ("parts: [{position: [1, 2]}]", "v.yaml: parts[0].position: found 2 values, expected 3"),
    ("parts: [{position: 1}]", "v.yaml: parts[0].position: found 1, expected a list"),
    ("parts: [7]", "v.yaml: parts[0]: found 7, expected a mapping of keys to values"),
    ("parts: 3", "v.yaml: parts: found 3, expected a list"),
    ("count: 1", "v.yaml: parts: missing"),
    ("{parts: [], count: 1.5}", "v.yaml: count: found 1.5, expected a whole number"),
    ("{parts: [], size: [1]}", "v.yaml: size: found 1 value, expected more"),
    ("{parts: [], size: [1, 2, 3, 4]}", "v.yaml: size: found 4 values, expected 3"),
    ("{parts: [], on: perhaps}", "v.yaml: on: found 'perhaps', expected true or false"),
    # Of a union only the branch that was meant speaks.
    ("parts: [{either: {kind: named, nam: x}}]", "v.yaml: parts[0].either.name: missing"),
    ("parts: [{either: x}]", "v.yaml: parts[0].either: found 'x', expected a mapping of keys to values or a number"),
    # YAML itself
    (
        "parts: []\ncount: 1\nparts: []",
        "v.yaml: line 3, column 1: key 'parts' is given twice, first in line 1; keep one",
    ),
    ("parts: [1,\ncount: 2", "v.yaml: line 2"),
    ("\tparts: []", "indent with spaces, not tabs"),
    ("- 1", "v.yaml: found a list of 1 value, expected keys and values such as 'name: my_vehicle'"),
    ("", "v.yaml: is empty, expected keys and values"),
    ("5", "v.yaml: found 5, expected keys and values"),
    ("? [1, 2]\n: 3", "a key must be a word"),
]


@pytest.mark.parametrize(("text", "expected_text"), PARTS)
def test_a_mistake_is_named_with_place_and_fix(text, expected_text):
    assert expected_text in message(text)


def test_all_mistakes_come_at_once_one_per_line():
    lines = message("parts: [{thrusters: [{gain: -1}, {gian: 2}]}, {position: [1]}]\ncounts: 2").splitlines()
    assert len(lines) == 5
    assert all(line.startswith("v.yaml: ") for line in lines)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3),
        ("1E5", 1e5),
        ("-2.5", -2.5),
        (".5", 0.5),
        ("6", 6),
        ("no", "no"),
        ("true", True),
        ("2021-06-01", "2021-06-01"),
        ("1.2.3", "1.2.3"),
        ("~", None),
    ],
)
def test_scalars_are_read_as_people_mean_them(text, value):
    read = parse_yaml(f"x: {text}", "f")["x"]
    assert read == value
    assert type(read) is type(value)


def test_a_block_can_be_used_again_with_changes():
    data = parse_yaml("a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}", "f")
    assert data["b"] == {"x": 1, "y": 3}


def test_files_that_cannot_be_read(tmp_path):
    (tmp_path / "boat.yaml").write_text("a: 1")
    (tmp_path / "picture.yaml").write_bytes(b"\x89PNG\xff\xfe")
    for name, message in [
        ("baot.yaml", "no such file. Did you mean 'boat.yaml'?"),
        ("picture.yaml", "is not text"),
        (".", "is a folder"),
        ("nowhere/x.yaml", "there is no folder"),
    ]:
        with pytest.raises(ConfigError, match=message.replace("?", r"\?")):
            read_yaml(tmp_path / name)
    assert read_yaml(tmp_path / "boat.yaml") == {"a": 1}
