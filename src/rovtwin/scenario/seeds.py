"""Seeds as people write them."""

from rovtwin.core.errors import ConfigError

MOST, LARGEST = 10_000, 2**31


def parse_seeds(text: str) -> list[int]:
    """`1-10`, `3,5,8` or a mixture as a list, each once.

    Raises:
        ConfigError: Something else.
    """
    seeds: list[int] = []
    for piece in text.split(","):
        first, dash, last = piece.strip().partition("-")
        try:
            low, high = int(first), int(last if dash else first)
        except ValueError:
            raise ConfigError(f"seeds: found {text!r}, expected numbers and ranges such as 1-10 or 3,5,8") from None
        if not 0 <= low <= high < LARGEST or high - low >= MOST:
            raise ConfigError(
                f"seeds: found {piece!r}, expected at most {MOST} numbers, rising, from 0 to {LARGEST - 1}"
            )
        seeds += [seed for seed in range(low, high + 1) if seed not in seeds]
    return seeds
