"""Messages on the wire: JSON that every browser reads, whatever the numbers are."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rovtwin.console.wire import DEEPEST, decode, encode

VALUES = st.recursive(
    st.one_of(st.floats(), st.integers(), st.booleans(), st.none(), st.text(max_size=4)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=4), inner, max_size=3)),
    max_leaves=8,
)


def strict(text):
    """JSON as browsers read it: they know neither NaN nor Infinity."""

    def refuse(name):
        raise AssertionError(name)

    return json.loads(text, parse_constant=refuse)


@pytest.mark.system
@given(VALUES)
@settings(max_examples=100, deadline=None, database=None)
def test_any_message_is_json(value):
    assert set(strict(encode({"kind": "any", "value": value}))) == {"kind", "value"}


def test_numbers_of_numpy_and_what_is_not_finite():
    found = strict(
        encode(
            {
                "array": np.array([[1.0, np.nan], [np.inf, 1.0 / 3.0]]),
                "flag": np.bool_(True),
                "count": np.int64(3),
                "tuple": (np.float32(0.5), None, False),
                "empty": np.zeros(0),
            }
        )
    )
    assert found == {
        "array": [[1.0, None], [None, 0.333333333]],
        "flag": True,
        "count": 3,
        "tuple": [0.5, None, False],
        "empty": [],
    }


def nested(levels):
    return '{"do": ' + "[" * (levels - 1) + "]" * (levels - 1) + "}"


@pytest.mark.parametrize("levels", [DEEPEST + 1, 600, 1500, 5000, 100_000])
def test_what_is_nested_too_deep_is_refused_whatever_the_parser_allows(levels):
    with pytest.raises(ValueError, match="nested deeper than 16"):
        decode(nested(levels))


def test_messages_come_back_and_what_is_none_is_named():
    assert decode(encode({"do": "goto", "x": 1.5, "way": [[{"y": 2}]]})) == {
        "do": "goto",
        "x": 1.5,
        "way": [[{"y": 2}]],
    }
    assert decode(nested(DEEPEST))["do"]
    for text in ("[]", "7", "null"):
        with pytest.raises(ValueError, match="expected an object"):
            decode(text)
    for text in ("", "{", b"\xff"):
        with pytest.raises(ValueError):
            decode(text)
