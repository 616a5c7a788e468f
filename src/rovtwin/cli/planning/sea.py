"""rovtwin sea: before a mission, whether the vehicle can hold its place."""

from typing import Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, table
from rovtwin.cli.scenarios import Overrides, ScenarioName, Seed


def sea(scenario: ScenarioName, overrides: Overrides = None, seed: Seed = None, as_json: AsJson = False) -> None:
    """Check whether the vehicle can hold its place at the mission's way-points: required against available force.

    In a scenario with the thesis's wave forces, also in the real sea of the same height and period.
    """
    from rovtwin.runs.compose.composition import compose
    from rovtwin.runs.feasibility.sea import sea_report
    from rovtwin.scenario.files import load_scenario

    report = sea_report(compose(load_scenario(scenario, overrides or (), seed)))
    if as_json:
        emit(report)
        raise typer.Exit(DONE)
    screen = console(False)
    screen.print(f"{report['vehicle']} in {report['scenario']}", style="bold", markup=False)
    _print(screen, "required to keep still, and available", report)
    screen.print(f"{_stems(report)}\n", markup=False)
    thesis = report["thesis_force_rms_n"]
    if report["real_sea"]:
        _print(screen, "the same in a real sea of that height and period", report["real_sea"])
    if thesis is not None:
        screen.print(f"the thesis's wave force for this height and period, as printed: {figure(thesis)} N rms")


def _stems(report: dict[str, Any]) -> str:
    """The largest currents that it stems, and what thrust would give where it does not stay level that long."""
    text = "a steady current that it stems, heading and depth held: at most " + _from_sides(report["stems_m_s"])
    thrust, stems = report["thrust_stems_m_s"], report["stems_m_s"]
    level = {side: speed for side, speed in thrust.items() if stems[side] < speed}
    if not level:
        return text
    where = "from each side" if len(level) == len(stems) else f"from {' and '.join(level)}"
    return f"{text}; staying level, not thrust, is the limit {where}: thrust would stem {_from_sides(level)}"


def _from_sides(speeds: dict[str, float]) -> str:
    return ", ".join(f"{speed:.2g} m/s from {side}" for side, speed in speeds.items())


def _print(screen: Any, title: str, report: dict[str, Any]) -> None:
    columns = ("depth", "heading", "X rms", "Y rms", "Z rms", "N rms", "horizontal", "available",
               "within reach", "on average", "verdict")  # fmt: skip
    rows = table(f"{title} [N, N m]; horizontal: rms / 99.9 % of the time below", *columns)
    for place in report["places"]:
        X, Y, Z, _, _, N = place["required_rms"]
        mean = sum(force**2 for force in place["mean_required"][:3]) ** 0.5
        rows.add_row(
            f"{place['position'][2]:.3g} m",
            f"{place['heading_deg'] % 360:.0f} deg{'' if place['heading_asked'] else ', of the start'}",
            *(figure(round(value, 3)) for value in (X, Y, Z, N)),
            figure([place["horizontal_rms_n"], place["horizontal_p999_n"]]),
            figure(place["available_n"]),
            f"{100 * place['time_within_reach']:.3g} %",
            figure(round(mean, 3)),
            place["verdict"],
        )
    if report["places"]:
        screen.print(rows)
    screen.print(report["line"] + "\n", markup=False)
