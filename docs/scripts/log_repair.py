"""The table of docs/logs.md: what `rovtwin log repair` keeps of a log with one damage.

python -m docs.scripts.log_repair [--flips 100] [--erasures 30] [--seconds 20]
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from tests.core.damage import Original, Outcome, erased, flipped, original, outcome, write_log

BLOCKS = (512, 4096, 65536)
Case = tuple[bytes, int, int]


def cases(made: Original, content: bytes, flips: int, erasures: int) -> dict[str, Iterator[Case]]:
    """Damaged copies, each with the bytes that were changed, by the kind of the damage."""
    random = np.random.default_rng(25)
    first = min(a for a, _ in made.chunks)
    places = [a + k for a, _ in sorted(made.chunks) for k in range(9) if a < len(content) - 9]
    some = random.choice(places, flips).tolist()

    def bits(bytes_: list[int]) -> Iterator[Case]:
        return ((flipped(content, k, int(random.integers(8))), k, k + 1) for k in bytes_)

    def blocks() -> Iterator[Case]:
        for k in range(erasures):
            size = BLOCKS[k % len(BLOCKS)]
            start = int(random.integers(8, len(content) - size))
            yield erased(content, start, size), start, start + size

    return {
        "one bit, anywhere": bits(random.integers(0, len(content), flips).tolist()),
        "one bit, before the first chunk": bits(random.integers(0, first, flips).tolist()),
        "one bit, of the kind or the length of a chunk": bits(some),
        "a block of 512 B, 4 kB or 64 kB zeroed": blocks(),
    }


def row(kind: str, found: list[Outcome]) -> str:
    """A line of the table."""
    shares = [100 * one.kept / max(one.whole, 1) for one in found]
    held = sum(one.kept == one.whole for one in found)
    return (
        f"| {kind} | {len(found)} | {held} | {np.mean(shares):.1f} % | {min(shares):.1f} % | "
        f"{sum(one.invented for one in found)} |"
    )


def main() -> None:
    """Damage, repair, count."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--flips", type=int, default=100)
    parser.add_argument("--erasures", type=int, default=30)
    parser.add_argument("--seconds", type=int, default=20)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = original(write_log(folder / "run.mcap", asked.seconds))
        count = sum(found.total() for found in made.chunks.values())
        print(f"{count} messages in {len(made.chunks)} chunks, {len(made.content)} bytes\n")
        print("| file | damage | copies | all whole messages kept | on average | at worst | made up |")
        print("|---|---|---|---|---|---|---|")
        for what, content in (("finished", made.content), ("killed: no index", made.content[: made.data_end])):
            for kind, damaged in cases(made, content, asked.flips, asked.erasures).items():
                found = [outcome(made, *case, folder) for case in damaged]
                print(f"| {what} {row(kind, found)}", flush=True)


if __name__ == "__main__":
    main()
