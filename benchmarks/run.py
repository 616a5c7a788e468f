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

from benchmarks import closed_loop, compile, dynamics, latency  # noqa: E402  (the path above comes first)
from benchmarks.timing import machine  # noqa: E402

PARTS: dict[str, Callable[[bool], dict[str, Any]]] = {
    "single_vehicle": dynamics.single,
    "closed_loop": closed_loop.single,
    "batch_dynamics": dynamics.batch,
    "batch_closed_loop": closed_loop.batch,
    "gradient": dynamics.gradient,
    "latency": latency.tick,
    "compile": compile.cold_and_cached,
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
    table: list[tuple[str, str]] = []
    if one := results.get("single_vehicle"):
        table += [
            ("plant, one vehicle: RK4 steps/s", spread(one["compiled_steps_per_s"])),
            ("  the same in NumPy", spread(one["numpy_steps_per_s"])),
            ("  ratio", times(one["ratio"])),
        ]
        if "share_of_c" in one:
            table += [("  the same in C", spread(one["c_steps_per_s"])), ("  share of C", share(one["share_of_c"]))]
        else:
            table.append(("  the same in C", one["c"]))
    if loop := results.get("closed_loop"):
        table += [
            ("closed loop, one vehicle: control ticks/s", spread(loop["compiled_ticks_per_s"])),
            ("  the same in NumPy", spread(loop["numpy_ticks_per_s"])),
            ("  ratio", times(loop["ratio"])),
            ("  simulated seconds per second", f"{loop['times_real_time']:,.0f}"),
        ]
    for part, text in (("batch_dynamics", "plant: vehicle-steps/s"), ("batch_closed_loop", "closed loop: ticks/s")):
        for name, figure in results.get(part, {}).items():
            table.append((f"{text}, {name.removeprefix('vehicles_')} under vmap", spread(figure)))
    if slope := results.get("gradient"):
        what = f"gradient of {slope['steps']:,} steps by {slope['parameters']} parameters"
        figure = f"{1e3 * slope['gradient_s']:.1f} ms = {slope['gradient_in_costs']:.1f} roll-outs"
        table.append((what, figure))
    if tick := results.get("latency"):
        table += [
            ("autopilot tick from Python: median", f"{1e6 * tick['median_s']:.0f} us"),
            ("  99 %; longest", f"{1e6 * tick['p99_s']:.0f} us; {1e6 * tick['most_s']:.0f} us"),
        ]
    for kind in ("cold", "cached"):
        if stages := results.get("compile", {}).get(kind):
            detail = ", ".join(f"{k.removesuffix('_s').replace('_', ' ')} {v:.1f}" for k, v in stages.items())
            table.append((f"first simulated second, {kind}", f"{stages['whole_s']:.1f} s ({detail})"))
    return table


def show(results: dict[str, Any]) -> None:
    table, about = rows(results), results["machine"]
    width = max(len(what) for what, _ in table)
    print(f"{about['cpu']}, {about['cores']} cores, load {about['load_before']:.1f}; {about['system']}")
    print(f"Python {about['python']}, jax {about['jax']}, jaxlib {about['jaxlib']}, NumPy {about['numpy']}")
    if results["quick"]:
        print("QUICK: too short to mean anything")
    for what, figure in table:
        print(f"{what:<{width}}  {figure}")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS), help="these parts (default: all)")
    parser.add_argument("--quick", action="store_true", help="a smoke test")
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "bench.json", help="where the JSON goes")
    options = parser.parse_args(arguments)
    results = measure(options.only, options.quick)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    show(results)
    print(f"wrote {options.out}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
