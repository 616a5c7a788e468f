"""YAML that is no mistake of a user's but would fill the memory, and aliases that are fine."""

import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.yamlfile import parse_yaml

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
