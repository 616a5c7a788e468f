"""YAML that is no mistake of a user's but would fill the memory, and aliases that are fine."""

import math
import os
from pathlib import Path

import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.yamlfile import MOST_YAML, dump_yaml, parse_yaml, read_yaml

LAUGHS = "\n".join(["a0: &a0 [x, x, x]", *(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 10))])
MERGED = "\n".join(
    ["m0: &m0 {a: 1}", *(f"m{i}: &m{i} {{<<: [{', '.join([f'*m{i - 1}'] * 9)}]}}" for i in range(1, 10))]
)


@pytest.mark.parametrize(
    "text", [LAUGHS, MERGED, "a: &a [*a]", "a: &a {b: *a}"], ids=["laughs", "merged", "own", "mine"]
)
def test_aliases_that_would_fill_the_memory_are_refused(text):
    with pytest.raises(ConfigError, match=r"line 1, column 1: found more than 1,000,000 values, .* aliases"):
        parse_yaml(text, "plan.yaml")


def test_aliases_are_what_they_repeat():
    assert parse_yaml("a: &a {x: 1}\nb: *a\nc: {<<: *a, y: 2}", "f") == {
        "a": {"x": 1},
        "b": {"x": 1},
        "c": {"x": 1, "y": 2},
    }


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("012", 12),
        ("-7", -7),
        ("0o17", 15),
        ("0x1F", 31),
        ("1e-3", 1e-3),
        (".5", 0.5),
        ("1.", 1.0),
        ("1:30:00", "1:30:00"),
        ("1:30.5", "1:30.5"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("no", "no"),
        ("2021-06-01", "2021-06-01"),
    ],
)
def test_numbers_are_those_of_yaml_1_2(text, value):
    found = parse_yaml(f"a: {text}", "f")["a"]
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    "text",
    ["08", "089", "-08", "0o17", "1e16", "1e3", "012", "1:30", "no", "true", "2021-06-01", "0x1F", "", "a: b", "~"],
)
def test_text_comes_back_as_text(text):
    assert parse_yaml(dump_yaml({"name": text, "list": [text]}), "f") == {"name": text, "list": [text]}


def test_numbers_come_back_as_numbers():
    data = {"a": 12, "b": -0.5, "c": 1e-9, "d": 1e14, "e": True, "f": None, "g": 10**18, "h": [1, 2.5]}
    assert parse_yaml(dump_yaml(data), "f") == data


@pytest.mark.parametrize("text", ["!!int abc", "!!float ''", "!!timestamp x", "!!bool maybe", "!!int [1]"])
def test_a_tag_that_is_not_true_is_named(text):
    with pytest.raises(ConfigError, match="not what its tag|expected a scalar|could not determine"):
        parse_yaml(f"a: {text}", "f")


@pytest.mark.parametrize("text", ["10000000000000000000", "0xFFFFFFFFFFFFFFFFFF", "-10000000000000000000"])
def test_a_whole_number_beyond_any_clock_is_refused(text):
    with pytest.raises(ConfigError, match="digits, expected at most 19"):
        parse_yaml(f"a: {text}", "f")
    assert parse_yaml("a: -1788000000000000000", "f")["a"] == -1788000000000000000


def test_a_number_of_thousands_of_digits_is_refused():
    with pytest.raises(ConfigError, match="line 1, column 4: found a number of 5000 digits, expected at most 19"):
        parse_yaml("a: " + "9" * 5000, "f")


@pytest.mark.parametrize("text", ["1e308", "-1.0e16", "1e999"])
def test_a_number_that_no_quantity_has_is_refused(text):
    with pytest.raises(ConfigError, match=rf"line 1, column 4: found {text}, expected a number below 1e\+15"):
        parse_yaml(f"a: {text}", "f")
    assert parse_yaml("a: .inf", "f")["a"] == math.inf


def test_a_file_of_something_else_is_not_repeated_in_a_message(tmp_path):
    secret = tmp_path / "passwd"
    secret.write_text("root:x:0:0:root\n" * 50)
    with pytest.raises(ConfigError) as refused:
        read_yaml(secret)
    assert "root" not in str(refused.value) and "expected keys and values" in str(refused.value)


@pytest.mark.parametrize("kind", ["pipe", "device", "large", "folder"])
def test_what_is_no_file_of_a_vehicle_is_not_read(tmp_path, kind):
    path = tmp_path / "vehicle.yaml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path = Path("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    else:
        with open(path, "wb") as stream:
            stream.truncate(MOST_YAML + 1)  # sparse: takes no room
    expected = {"pipe": "a pipe or a device", "device": "a pipe or a device", "folder": "folder", "large": "10 MB"}
    with pytest.raises(ConfigError, match=expected[kind]):
        read_yaml(path)
