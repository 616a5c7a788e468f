"""The tables of docs/link_faults.md: every fault on the wire, and the time until the thrusters rest.

python -m docs.scripts.link_faults [--repeat 2] [--only WORDS] [--out docs/link_faults.md]
"""

import argparse
import importlib.metadata
import sys
import tempfile
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.links.faults.bench import bench
from tests.links.faults.cases import Case, Outcome, perform
from tests.links.faults.list import CASES

ROOT = Path(__file__).parents[2]
BEGIN, END = "<!-- tables: docs/scripts/link_faults.py -->", "<!-- end of tables -->"
TITLES = {"blueye": "Blueye (watchdog 2 s)", "mavlink": "MAVLink, ArduSub (pilot's time-out 3 s)"}
PACKAGES = ("blueye.sdk", "blueye.protocol", "pyzmq", "pymavlink")


Row = tuple[Case, list[Outcome], str]


def measure(cases: list[Case], kind: str, repeat: int, take: Callable[[Row], None]) -> None:
    """Outcomes of each case, and what went wrong."""
    with tempfile.TemporaryDirectory() as folder, bench(kind, Path(folder)) as made:
        for case in cases:
            outcomes: list[Outcome] = []
            wrong = ""
            for k in range(repeat):
                try:
                    outcomes.append(perform(made, case, patient=True, again=k == 0))
                except AssertionError as error:
                    wrong = str(error).strip().splitlines()[-1][:200]
                    for process in made.processes:  # said once
                        process.errors.write_text("")
            print(kind, case.id, [round(o.seconds, 2) for o in outcomes], wrong, flush=True)
            take((case, outcomes, wrong))


def table(rows: list[Row]) -> str:
    """Rows of one protocol as Markdown."""
    lines = ["| fault | client | what happened | rest [s] | bound [s] | passed |", "|---|---|---|---|---|---|"]
    for case, outcomes, wrong in rows:
        last = max(outcomes, key=lambda o: o.seconds, default=None)
        seconds, words = (f"{last.seconds:.2f}", last.happened) if last else ("", "")
        words = "; ".join(text for text in (words, wrong) if text)
        verdict = "no" if wrong else "yes"
        lines.append(f"| {case.fault} | {case.who} | {words} | {seconds} | {case.bound:.2f} | {verdict} |")
    return "\n".join(lines)


def write(page: Path, done: dict[str, list[Row]], repeat: int) -> None:
    """Put the tables into the page."""
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in PACKAGES)
    often = "Once each" if repeat == 1 else f"Worst of {repeat}"
    parts = [f"{often}, on two cores that other programs used, too; {versions}."]
    parts += [f"## {TITLES[kind]}\n\n{table(rows)}" for kind, rows in done.items() if rows]
    text = page.read_text()
    page.write_text("".join([text.split(BEGIN)[0], BEGIN, "\n", "\n\n".join(parts), "\n\n", END, text.split(END)[1]]))


def main() -> int:
    """Run the cases, both protocols at once, and write the page as they are done; 1 where one failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=2)
    parser.add_argument("--only", default="")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "link_faults.md")
    options = parser.parse_args()
    done: dict[str, list[Row]] = {kind: [] for kind in TITLES}
    lock = threading.Lock()

    def run(kind: str) -> None:
        def take(row: Row) -> None:
            with lock:
                done[kind].append(row)
                write(options.out, done, options.repeat)

        measure([c for c in CASES if c.bench == kind and options.only in c.id], kind, options.repeat, take)

    with ThreadPoolExecutor(len(done)) as pool:
        list(pool.map(run, done))
    return 0 if all(not wrong for rows in done.values() for _, _, wrong in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
