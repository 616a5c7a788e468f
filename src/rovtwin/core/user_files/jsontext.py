"""JSON that every reader takes: what it cannot say, NaN and infinity, is null. And JSON that people bring."""

import json
import math
from typing import Any

from rovtwin.core.errors import ConfigError


def to_json(data: Any) -> str:
    """Text of numbers, texts, lists and mappings; tuples become lists, keys text."""
    return json.dumps(_plain(data), indent=2, allow_nan=False)


def parse_json(text: str, where: str) -> Any:
    """What a text is.

    Raises:
        ConfigError: It is no JSON, or nested too deeply; the message begins with `where`.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise ConfigError(f"{where}: line {error.lineno}, column {error.colno}: not JSON ({error.msg})") from None
    except (RecursionError, ValueError):  # a number of more digits than Python converts, too
        raise ConfigError(f"{where}: not JSON that can be read: nested too deeply, or with too long a number") from None


def _plain(data: Any) -> Any:
    if isinstance(data, dict):
        return {str(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_plain(value) for value in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
