"""The table of docs/logs.md: commands killed with -9 at random times, and what each left.

python -m docs.scripts.kills [--each 25] [--beside 3] [--only fly record campaign identify]
"""

import argparse
import multiprocessing
import os
import random
import re
import signal
import struct
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

# Other people's packages, imported once; each command is a process of its own that begins with ours.
PRELOADED = ["jax", "equinox", "scipy.optimize", "pydantic", "typer", "rich.progress", "mcap.reader", "netCDF4"]
PRELOADED += ["pyarrow.parquet", "jinja2", "yaml", "trimesh", "pymap3d", "gsw", "PIL.Image", "zstandard", "lz4.frame"]
NOTE = struct.Struct("<dd")  # when a sample was logged, by the clock of the machine, and its time [s]
PATIENCE = 600.0  # for the first sign of a command [s]
MOST_LOST = 2.0  # a second until it is handed to the log, and one until that hands it on [s]
DURATION = 8.0  # of a flight or a recording that is killed [s]
SERVED = "ardusub_depth_hold"
SAMPLES = 30
CAMPAIGN = f"""scenario: lawnmower_waves
samples: {SAMPLES}
set: {{autopilot: thesis, duration: 2}}
vary: {{"world.net_buoyancy": {{distribution: uniform, low: 0, high: 1}}}}
"""


@dataclass
class Result:
    """Kills of one command: where they struck, how many left what is promised, what was lost at most [s]."""

    kills: int = 0
    held: int = 0
    lost: list[float] = field(default_factory=list)
    states: dict[str, int] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    def take(self, state: str, wrong: str = "", lost: float | None = None) -> None:
        """One more kill."""
        self.kills += 1
        self.held += not wrong
        self.states[state] = self.states.get(state, 0) + 1
        self.lost += [] if lost is None else [lost]
        self.broken += [wrong] if wrong else []


def command(words: list[str], notes: str, output: str) -> None:
    """The command line in this process; when what was logged is noted beside."""
    os.setsid()
    with open(output, "ab") as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    from rovtwin.core.log import LogWriter

    write, write_many, note = LogWriter.write, LogWriter.write_many, os.open(notes, os.O_WRONLY | os.O_CREAT, 0o600)

    def one(self: LogWriter, channel: str, t: float, values: Any) -> None:
        write(self, channel, t, values)
        os.write(note, NOTE.pack(time.monotonic(), t))

    def many(self: LogWriter, channel: str, t: Any, values: Any) -> None:
        write_many(self, channel, t, values)
        os.write(note, NOTE.pack(time.monotonic(), t[-1]) if len(t) else b"")

    LogWriter.write, LogWriter.write_many = one, many
    sys.argv = ["rovtwin", *words]
    import rovtwin.cli

    rovtwin.cli.main()


class Bench:
    """Starts commands and kills them."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.folder, self.random, self.link = folder, random.Random(seed), ""
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOADED)

    def start(self, words: list[str], name: str) -> Any:
        """A command as a process; what it says goes into a file."""
        place = [str(self.folder / f"{name}.{end}") for end in ("notes", "output")]
        process = self._context.Process(target=command, args=(words, *place))
        process.start()
        return process

    def killed(self, words: list[str], name: str, sign: Callable[[], bool], within: float) -> float | None:
        """Kill a command at a random time after a first sign of it; when, or None if it had ended by then."""
        process, deadline = self.start(words, name), time.monotonic() + PATIENCE
        while not sign() and process.is_alive() and time.monotonic() < deadline:
            time.sleep(0.01)
        process.join(self.random.uniform(0, within))
        when, alive = time.monotonic(), process.is_alive()
        if alive:
            os.killpg(process.pid, signal.SIGKILL)
        process.join()
        return when if alive else None

    def run(self, words: list[str], name: str) -> str:
        """A command to its end; what it said."""
        process = self.start(words, name)
        process.join()
        return (self.folder / f"{name}.output").read_text(errors="replace")


def lost_of(notes: Path, last: float, when: float) -> float:
    """How long before the kill the last sample that is in the log was handed to it [s]."""
    noted = notes.read_bytes()
    rows = NOTE.iter_unpack(noted[: len(noted) // NOTE.size * NOTE.size])
    return when - max(at for at, t in rows if t <= last + 1e-6)


def logged(bench: Bench, name: str, words: list[str], log: Path, result: Result) -> None:
    """Kill a command that writes a log, and read the log."""
    from rovtwin.core.errors import RovtwinError
    from rovtwin.core.log import Log, repair

    notes = bench.folder / f"{name}.notes"
    late = bench.random.random() < 0.8  # else while it prepares

    def logging() -> bool:
        return notes.exists() and notes.stat().st_size > 0

    when = bench.killed(words, name, logging if late else log.exists, DURATION)
    if when is None:
        output = (bench.folder / f"{name}.output").read_text(errors="replace")
        return result.take("ended before", "" if log.exists() and Log.read(log) else f"{name}: {output[-300:]}")
    if not log.exists():
        return result.take("before the log")
    try:
        saved = repair(log)
        Log.read(saved.path)
    except RovtwinError as error:
        return result.take("while logging", f"{name}: {error}")
    if saved.last_time is None:
        return result.take("before the first second")
    lost = lost_of(notes, saved.last_time, when)
    result.take("while logging", "" if lost < MOST_LOST else f"{name}: {lost:.2f} s", lost)


def flights(bench: Bench, number: int, result: Result) -> None:
    """`fly` by the wall clock."""
    out = bench.folder / f"fly{number}"
    set_ = ["--set", "autopilot=thesis", "--set", f"duration={DURATION}"]
    words = ["fly", "lawnmower_waves", *set_, "--realtime", "--no-report", "--out", str(out)]
    logged(bench, f"fly{number}", words, out / "log.mcap", result)


def recordings(bench: Bench, number: int, result: Result) -> None:
    """`record` over a served twin."""
    out = bench.folder / f"record{number}.mcap"
    words = ["record", SERVED, "--link", bench.link, "--duration", str(DURATION), "--out", str(out)]
    logged(bench, f"record{number}", words, out, result)


def campaigns(bench: Bench, number: int, result: Result) -> None:
    """`campaign`, gone on with after each kill: what had been flown is there, and stays."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file, out = bench.folder / "campaign.yaml", bench.folder / "campaign"
    file.write_text(CAMPAIGN)

    def rows() -> dict[int, Any]:
        paths = [*out.glob("samples.parquet"), *sorted((out / "parts").glob("*.parquet"))]
        table = pa.concat_tables([pq.read_table(path, columns=["index", "began"]) for path in paths]) if paths else None
        return {} if table is None else dict(zip(*(table[k].to_pylist() for k in ("index", "began")), strict=True))

    before = rows()
    first = len(list((out / "parts").glob("*.parquet")))
    words = ["campaign", str(file), "--out", str(out), "--workers", "1", "--no-report"]

    def flying() -> bool:
        return len(list((out / "parts").glob("*.parquet"))) > first

    late = bench.random.random() < 0.7  # else while it starts
    when = bench.killed(words, f"campaign{number}", flying if late else lambda: True, 4.0 if late else 15.0)
    try:
        after = rows()
    except (OSError, pa.ArrowException) as error:
        return result.take("flying", f"campaign{number}: {error}")
    wrong = "" if after.items() >= before.items() else f"campaign{number}: lost {before.keys() - after.keys()}"
    state = "ended before" if when is None else "flying" if len(after) > len(before) else "starting"
    result.take(state, wrong)


def campaign_ends(bench: Bench, result: Result) -> None:
    """The killed campaign, to its end."""
    import pyarrow.parquet as pq

    out = bench.folder / "campaign"
    words = ["campaign", str(bench.folder / "campaign.yaml"), "--out", str(out), "--workers", "1", "--no-report"]
    text = bench.run(words, "campaign-end")
    found = pq.read_table(out / "samples.parquet")["index"].to_pylist() if (out / "samples.parquet").exists() else []
    if found != list(range(SAMPLES)) or list(out.rglob("*.part")):
        result.broken.append(f"campaign: at the end {len(found)} of {SAMPLES}: {text[-300:]}")


def identifications(bench: Bench, number: int, result: Result) -> None:
    """`identify` over a result of before: the file and its result are each the old one or a new one."""
    from rovtwin.core.errors import RovtwinError
    from rovtwin.identification.result.identification import Identification
    from rovtwin.vehicle import load_vehicle

    folder = bench.folder / f"identify{number}"
    folder.mkdir()
    old = {end: (bench.folder / f"prior{end}").read_bytes() for end in (".yaml", ".nc")}
    for end, content in old.items():
        (folder / f"out{end}").write_bytes(content)
    out = folder / "out.yaml"
    words = ["identify", "bluerov2", "--prior", str(bench.folder / "prior.yaml"), "-o", str(out), "--keep"]
    writing = bench.random.random() < 0.7  # else at any time
    sign = (lambda: bool(list(folder.glob(".*.part")))) if writing else (lambda: True)
    when = bench.killed(words, f"identify{number}", sign, 0.3 if writing else 15.0)
    try:
        load_vehicle(str(out), identified=True)
        Identification.load(out.with_suffix(".nc"))
        wrong = ""
    except RovtwinError as error:
        wrong = f"identify{number}: {error}"
    new = sum((folder / f"out{end}").read_bytes() != content for end, content in old.items())
    state = "ended before" if when is None else ("nothing written", "one of two written", "both written")[new]
    result.take(state, wrong)


KINDS = {"fly": flights, "record": recordings, "campaign": campaigns, "identify": identifications}


def prepare(bench: Bench, kinds: list[str]) -> Iterator[Any]:
    """What the commands need: a served twin and an identification; compiled programs."""
    if "identify" in kinds:
        from rovtwin.identification.identify import identify
        from rovtwin.identification.joint.result.overlay import to_yaml
        from rovtwin.vehicle import load_vehicle

        made = identify(load_vehicle("bluerov2"), [], free=["added_mass.yaw"])
        (bench.folder / "prior.yaml").write_text(to_yaml(made.file(), "kills"))
        made.save(bench.folder / "prior.nc", overwrite=True)
    if "fly" in kinds:
        flights(bench, -1, Result())
    if "record" in kinds and not bench.link:
        served, output = bench.start(["serve", SERVED, "--port", "14710"], "serve"), bench.folder / "serve.output"
        while not (found := re.search(r"--link (\S+)", output.read_text() if output.exists() else "")):
            time.sleep(0.1)
        bench.link = found[1]
        time.sleep(5)
        yield
        os.killpg(served.pid, signal.SIGKILL)
        served.join()
    else:
        yield


def main() -> None:
    """Kill, look, count."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--each", type=int, default=25)
    parser.add_argument("--beside", type=int, default=1, help="Kinds that run side by side.")
    parser.add_argument("--link", default="", help="Of a served vehicle, in place of one served here.")
    parser.add_argument("--only", nargs="*", default=list(KINDS), choices=list(KINDS))
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        bench = Bench(Path(name), 25)
        bench.link = asked.link
        for _ in prepare(bench, asked.only):

            def series(kind: str) -> Result:
                result = Result()
                for number in range(asked.each):
                    KINDS[kind](bench, number, result)
                    print(kind, number, result, file=sys.stderr, flush=True)
                if kind == "campaign":
                    campaign_ends(bench, result)
                return result

            with ThreadPoolExecutor(asked.beside) as pool:
                results = dict(zip(asked.only, pool.map(series, asked.only), strict=True))
    print("| command | kills | when they struck | kept what is promised | lost at most |\n|---|---|---|---|---|")
    for kind, result in results.items():
        states = ", ".join(f"{count} {state}" for state, count in sorted(result.states.items()))
        lost = f"{max(result.lost):.2f} s" if result.lost else "–"
        print(f"| `{kind}` | {result.kills} | {states} | {result.held} of {result.kills} | {lost} |")
        for wrong in result.broken:
            print(f"  broken: {wrong}")


if __name__ == "__main__":
    main()
