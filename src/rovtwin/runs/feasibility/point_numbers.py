"""Numbers of way-points as people count them, from 1, and back."""

import re
from collections.abc import Iterable

_NAMED = re.compile(r"way-points? (\d+(?: to \d+)?(?:, \d+(?: to \d+)?)*)")


def counted(points: Iterable[int]) -> str:
    """Numbers from 0 as "way-point 3" or "way-points 2 to 4, 9"."""
    spans: list[list[int]] = []
    many = 0
    for i in sorted(points):
        many += 1
        if spans and i == spans[-1][1] + 1:
            spans[-1][1] = i
        else:
            spans.append([i, i])
    words = [f"{a + 1}" if a == b else f"{a + 1} to {b + 1}" for a, b in spans]
    return f"way-point{'' if many == 1 else 's'} {', '.join(words)}"


def named(text: str) -> list[int]:
    """Numbers from 0 of the way-points that a text names, in order."""
    found: set[int] = set()
    for numbers in _NAMED.findall(text):
        for span in numbers.split(", "):
            first, _, last = span.partition(" to ")
            found.update(range(int(first) - 1, int(last or first)))
    return sorted(found)
