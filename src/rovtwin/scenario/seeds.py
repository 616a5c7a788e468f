"""Seeds as people write them."""

from rovtwin.core.errors import ConfigError


def parse_seeds(text: str) -> list[int]:
    """`1-10`, `3,5,8` or a mixture as a list.

    Raises:
        ConfigError: Something else.
    """
    seeds: list[int] = []
    for piece in text.split(","):
        first, dash, last = piece.strip().partition("-")
        try:
            seeds += range(int(first), int(last) + 1) if dash else [int(first)]
        except ValueError:
            raise ConfigError(f"seeds: found {text!r}, expected numbers and ranges such as 1-10 or 3,5,8") from None
    if not seeds or min(seeds) < 0 or len(seeds) > 10_000:
        raise ConfigError(f"seeds: found {text!r}, expected 1 to 10,000 numbers from 0 on, such as 1-10")
    return seeds
