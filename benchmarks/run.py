"""Run the benchmarks, print a table, write the figures as JSON.

make bench                                    # all, about three minutes on two cores
python benchmarks/run.py --only single_vehicle latency
python benchmarks/run.py --quick              # a smoke test: the figures mean little
"""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))  # `benchmarks` and `tests.oracle` are not part of the installed package

from benchmarks import (  # noqa: E402  (the path above comes first)
    allocation,
    closed_loop,
    compile,
    dynamics,
    gpu,
    latency,
    rendering,
)
from benchmarks.timing import machine  # noqa: E402

PARTS: dict[str, Callable[[bool], dict[str, Any]]] = {
    "single_vehicle": dynamics.single,
    "closed_loop": closed_loop.single,
    "batch_dynamics": dynamics.batch,
    "lanes": dynamics.lanes,
    "batch_closed_loop": closed_loop.batch,
    "gradient": dynamics.gradient,
    "latency": latency.tick,
    "allocation": allocation.priorities,
    "compile": compile.cold_and_cached,
    "gpu": gpu.batch,
    "rendering": rendering.rendering,
    "corners": rendering.corners,
}


def measure(names: list[str], quick: bool) -> dict[str, Any]:
    """Figures of the named parts, one after the other, and what they were measured on."""
    results: dict[str, Any] = {"machine": machine(), "quick": quick}
    for name in names:
        print(f"measuring {name} ...", file=sys.stderr, flush=True)
        results[name] = PARTS[name](quick)
    return results


def spread(figure: dict[str, float]) -> str:
    return f"{figure['median']:,.0f} ({figure['quarter']:,.0f} to {figure['three_quarters']:,.0f})"


def times(figure: dict[str, float]) -> str:
    return f"{figure['median']:,.0f} ({figure['least']:,.0f} to {figure['most']:,.0f})"


def share(figure: dict[str, float]) -> str:
    return f"{figure['median']:.2f} ({figure['least']:.2f} to {figure['most']:.2f})"


def rows(results: dict[str, Any]) -> list[tuple[str, str]]:
    """What was measured, and its figure with unit."""
    return [row for part, rows_of in ROWS.items() if part in results for row in rows_of(results[part])]


def _single(one: dict[str, Any]) -> list[tuple[str, str]]:
    table = [("plant, one vehicle: RK4 steps/s", spread(one["compiled_steps_per_s"]))]
    if "share_of_c" in one:
        c = f"the same in C ({one['c']})"
        table += [(c, spread(one["c_steps_per_s"])), ("share of C", share(one["share_of_c"]))]
    else:
        table.append(("the same in C", one["c"]))
    return [*table, ("the same in NumPy", spread(one["numpy_steps_per_s"])), ("times NumPy", times(one["ratio"]))]


def _loop(loop: dict[str, Any]) -> list[tuple[str, str]]:
    return [
        ("closed loop, one vehicle: physics steps/s at 500 Hz", spread(loop["physics_steps_per_s"])),
        ("control ticks/s at 50 Hz", spread(loop["compiled_ticks_per_s"])),
        ("the same in NumPy", spread(loop["numpy_ticks_per_s"])),
        ("times NumPy", times(loop["ratio"])),
        ("simulated seconds per second", f"{loop['times_real_time']:,.0f}"),
    ]


def _crowd(what: str) -> Callable[[dict[str, Any]], list[tuple[str, str]]]:
    def table(found: dict[str, Any]) -> list[tuple[str, str]]:
        return [(f"{what}: {_vehicles(name)}", spread(figure)) for name, figure in found.items()]

    return table


def _vehicles(name: str) -> str:
    _, number, *rest = name.split("_")
    return f"{int(number):,} vehicle{'' if number == '1' else 's'}{' all at once' if rest else ''}"


def _lanes(found: dict[str, Any]) -> list[tuple[str, str]]:
    if "ratio" not in found:
        return [("plant in C, vehicles in vector lanes", found["c"])]
    return [
        ("plant in C, eight vehicles in vector lanes: vehicle-steps/s", spread(found["c_steps_per_s"])),
        ("times ours in chunks", share(found["ratio"])),
    ]


def _gradient(slope: dict[str, Any]) -> list[tuple[str, str]]:
    what = f"gradient of {slope['steps']:,} steps by {slope['parameters']} parameters"
    return [(what, f"{1e3 * slope['gradient_s']:.1f} ms = {slope['gradient_in_costs']:.1f} roll-outs")]


def _latency(tick: dict[str, Any]) -> list[tuple[str, str]]:
    return [
        ("autopilot tick from Python, readings in, command out: median", f"{1e6 * tick['median_s']:.0f} us"),
        ("99 %; longest", f"{1e6 * tick['p99_s']:.0f} us; {1e6 * tick['most_s']:.0f} us"),
    ]


def _allocation(found: dict[str, Any]) -> list[tuple[str, str]]:
    steps = found["steps"]
    table = [
        (f"allocation with priorities, {name} of full", f"{us:.1f} us") for name, us in found["us_per_tick"].items()
    ]
    what = f"Newton steps of {steps['of']:,} random allocations, 12 thrusters"
    return [*table, (what, f"median {steps['median']}, most {steps['most']} (bound {steps['bound']})")]


def _compile(found: dict[str, Any]) -> list[tuple[str, str]]:
    table = []
    for kind, what in (("cold", "nothing compiled yet"), ("cached", "the same in the next process")):
        stages = found[kind]
        detail = ", ".join(f"{k.removesuffix('_s').replace('_', ' ')} {v:.1f}" for k, v in stages.items())
        table.append((f"first simulated second, {what}", f"{stages['whole_s']:.1f} s ({detail})"))
    for name, seconds in found["fly_processor_s"].items():
        figures = f"{seconds['cold']:.1f} s; {seconds['cached']:.1f} s"
        table.append((f"processor time of a flight of 1 s ({name}), nothing compiled yet; the next process", figures))
    return table


def _gpu(found: dict[str, Any]) -> list[tuple[str, str]]:
    return [
        (f"GPU: {name.replace('_vehicles_', ', ')} vehicles: vehicle-steps/s", f"{value:,.0f}")
        for name, value in found.items()
        if name != "device"
    ] + [("GPU", found["device"])]


def _rendering(found: dict[str, Any]) -> list[tuple[str, str]]:
    return [
        (f"pictures/s a core, {what}", f"{one['pictures_per_s']['median']:.1f} (one in {one['wall_s']:.2f} s)")
        for what, one in found.items()
    ]


def _corners(found: dict[str, Any]) -> list[tuple[str, str]]:
    table = []
    for what, one in found.items():
        figures = [f"{one[key]:.2f} px {key}" for key in ("rms", "middle") if key in one]
        table.append((f"markers at {what}", ", ".join([f"{one['found']} found", *figures])))
    return table


ROWS: dict[str, Callable[[dict[str, Any]], list[tuple[str, str]]]] = {
    "single_vehicle": _single,
    "closed_loop": _loop,
    "batch_dynamics": _crowd("plant, vehicle-steps/s"),
    "lanes": _lanes,
    "batch_closed_loop": _crowd("closed loop, control ticks/s"),
    "gradient": _gradient,
    "latency": _latency,
    "allocation": _allocation,
    "compile": _compile,
    "gpu": _gpu,
    "rendering": _rendering,
    "corners": _corners,
}


def show(results: dict[str, Any], markdown: bool) -> None:
    table, about = rows(results), results["machine"]
    width = max(len(what) for what, _ in table)
    print(f"{about['cpu']}, {about['cores']} cores, load {about['load_before']:.1f}; {about['system']}")
    print(f"Python {about['python']}, jax {about['jax']}, jaxlib {about['jaxlib']}, NumPy {about['numpy']}")
    if results["quick"]:
        print("QUICK: too short to mean anything")
    if markdown:
        print("\n| what | figure |\n|---|---|")
    for what, figure in table:
        print(f"| {what} | {figure} |" if markdown else f"{what:<{width}}  {figure}")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="these parts (default: all)")
    parser.add_argument("--quick", action="store_true", help="a smoke test")
    parser.add_argument("--markdown", action="store_true", help="print the table as Markdown")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "bench.json", help="where the JSON goes")
    options = parser.parse_args(arguments)
    results = measure(options.only, options.quick)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    show(results, options.markdown)
    print(f"wrote {options.out}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
