"""What a lawn-mower mission costs in a campaign, against missions flown one by one; all in one run.

python benchmarks/campaign.py                                # 64 missions, about ten minutes on two quiet cores
python benchmarks/campaign.py --missions 1000 --batch 0      # issue 6.6; --batch 0 leaves vmap out

Three ways, by turns in portions so that whatever disturbs the machine hits all alike:
- one by one: `fly` for each, with log, without report, in one process that has compiled before;
- campaign: the same missions as the campaign's engine flies them in one process, kept as Parquet;
- side by side: the same under vmap, `--batch` lanes (its minutes of compiling are given apart).
Besides: a whole `rovtwin fly` as a process of its own, and the campaign on `--workers` processes, by the wall clock.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from benchmarks.timing import machine  # noqa: E402  (the path above comes first)
from rovtwin import __version__  # noqa: E402
from rovtwin.campaign.flying import fly_samples  # noqa: E402
from rovtwin.campaign.run import run_campaign  # noqa: E402
from rovtwin.campaign.samples import scenario_at  # noqa: E402
from rovtwin.campaign.schema import Campaign, complete  # noqa: E402
from rovtwin.campaign.store import Store  # noqa: E402
from rovtwin.campaign.summary import column  # noqa: E402
from rovtwin.campaign.workers import on_this_machine  # noqa: E402
from rovtwin.runs.fly import fly  # noqa: E402

SCENARIO = "lawnmower_hard"
PORTION = 8


def campaign_of(missions: int, settings: dict[str, Any]) -> Campaign:
    """Lawn-mowers in hard conditions whose current, payload and sensors vary."""
    vary = {
        "world.current.velocity[1]": {"distribution": "uniform", "low": -0.1, "high": 0.1},
        "world.mismatch.mass": {"distribution": "normal", "mean": 1.1, "sd": 0.03},
        "sensors.position.noise": {"distribution": "lognormal", "median": 0.5, "factor": 1.3},
    }
    data = {"name": "bench", "scenario": SCENARIO, "samples": missions, "set": settings, "vary": vary}
    return complete(Campaign.model_validate(data))


def timed(action: Callable[[], Any]) -> tuple[float, float]:
    """Processor and wall-clock time of a call [s]."""
    cpu, wall = time.process_time(), time.perf_counter()
    action()
    return time.process_time() - cpu, time.perf_counter() - wall


def in_turns(campaign: Campaign, folder: Path, lanes: int) -> dict[str, Any]:
    """Processor seconds a mission of each way, portion by portion, and the largest difference of a score."""
    text, found = campaign.model_dump_json(), {"one_by_one": [], "campaign": [], "side_by_side": []}
    rows: dict[str, list[dict[str, Any]]] = {"campaign": [], "side_by_side": []}

    def one_by_one(portion: list[int]) -> None:
        for index in portion:
            fly(scenario_at(campaign, index), folder / f"fly-{time.time_ns()}")

    def kept(name: str, portion: list[int], side_by_side: int) -> None:
        new = fly_samples(text, portion, side_by_side, __version__)
        store.add(new)
        rows[name] += new

    compile_s = {"one_by_one": timed(lambda: one_by_one([0]))[1]}
    with Store(folder / "engine", campaign) as store:
        compile_s["campaign"] = timed(lambda: fly_samples(text, [0], 1, __version__))[1]
        if lanes:
            compile_s["side_by_side"] = timed(lambda: fly_samples(text, list(range(lanes)), lanes, __version__))[1]
        size = max(PORTION, lanes)
        for start in range(0, campaign.samples, size):
            portion = list(range(start, min(start + size, campaign.samples)))
            n = len(portion)
            found["one_by_one"].append(timed(lambda p=portion: one_by_one(p))[0] / n)
            found["campaign"].append(timed(lambda p=portion: kept("campaign", p, 1))[0] / n)
            if lanes:
                found["side_by_side"].append(timed(lambda p=portion: kept("side_by_side", p, lanes))[0] / n)
            last = ", ".join(f"{name} {times[-1]:.2f} s" for name, times in found.items() if times)
            print(
                f"{portion[-1] + 1} of {campaign.samples}; processor time a mission: {last}",
                file=sys.stderr,
                flush=True,
            )
    return {
        "cpu_s_a_mission": {name: _middle(times) for name, times in found.items() if times},
        "times_cheaper_than_one_by_one": {
            name: _middle([a / b for a, b in zip(found["one_by_one"], times, strict=True)])
            for name, times in found.items()
            if times
        },
        "first_call_wall_s": compile_s,
        "largest_relative_difference_of_vmap": _difference(rows["campaign"], rows["side_by_side"]) if lanes else None,
    }


def _middle(values: list[float]) -> dict[str, float]:
    ordered = sorted(values)
    return {"median": ordered[len(ordered) // 2], "least": ordered[0], "most": ordered[-1]}


def _difference(one: list[dict[str, Any]], other: list[dict[str, Any]]) -> dict[str, float]:
    """Of each score, over the missions that both have."""
    names = [n for n, value in one[0].items() if isinstance(value, float) and n not in ("began", "wall_s", "cpu_s")]
    return {
        name: max(abs(a[name] - b[name]) / max(abs(a[name]), 1e-12) for a, b in zip(one, other, strict=True)
                  if a[name] is not None)
        for name in names
        if any(a[name] is not None for a in one)
    }  # fmt: skip


def spread(campaign: Campaign, folder: Path, workers: int) -> dict[str, Any]:
    """The whole campaign on processes of this machine, by the wall clock."""
    session = run_campaign(campaign, folder / "spread", on_this_machine(workers), lanes=1)
    completed = int(column(session.table, "completed").sum())
    return {"workers": workers, "wall_s": session.wall_s, "wall_s_a_mission": session.wall_s / session.flown,
            "completed": completed, "flown": session.flown}  # fmt: skip


def own_process(folder: Path, settings: dict[str, Any], times: int = 2) -> float:
    """Wall time of a whole `rovtwin fly`, log and report as it comes, the second time [s]."""
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={json.dumps(value)}")]
    begin = 0.0
    for k in range(times):
        begin = time.perf_counter()
        out = str(folder / f"own-{k}")
        subprocess.run([sys.executable, "-m", "rovtwin.cli", "fly", SCENARIO, *words, "--out", out, "--json"],
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False)  # fmt: skip
    return time.perf_counter() - begin


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", type=int, default=64)
    parser.add_argument("--batch", type=int, default=8, help="lanes under vmap; 0: leave it out")
    parser.add_argument("--workers", type=int, default=2, help="processes of the whole campaign; 0: leave it out")
    parser.add_argument("--turns", type=int, default=64, help="missions flown in turns (default: 64 at most)")
    parser.add_argument("--duration", type=float, default=600.0, help="longest mission [s]")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "bench_campaign.json")
    options = parser.parse_args(arguments)
    settings = {"autopilot": "thesis_placed", "duration": options.duration}
    campaign = campaign_of(options.missions, settings)
    results: dict[str, Any] = {"machine": machine(), "scenario": SCENARIO, "missions": options.missions}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        turns = campaign.model_copy(update={"samples": min(options.turns, options.missions)})
        results["in_turns"] = in_turns(turns, folder, options.batch)
        results["own_process_wall_s"] = own_process(folder, settings)
        if options.workers:
            results["spread"] = spread(campaign, folder, options.workers)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    print(json.dumps(results, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
