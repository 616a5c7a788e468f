"""A value from outside of a test, with its width."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Known:
    """A value and its standard deviation, both in SI; a width of 0 holds the value fixed."""

    value: float
    sd: float = 0.0
