"""JSON that every reader takes: what it cannot say, NaN and infinity, is null."""

import json
import math
from typing import Any


def to_json(data: Any) -> str:
    """Text of numbers, texts, lists and mappings; tuples become lists, keys text."""
    return json.dumps(_plain(data), indent=2, allow_nan=False)


def _plain(data: Any) -> Any:
    if isinstance(data, dict):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
