"""rovtwin plan-tests: which test tells most about a vehicle in the time and the tank that there are."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, table

if TYPE_CHECKING:
    from rovtwin.planning.plan import Plan


FORM = (
    "these standard deviations hold where the model has the right form: they are no accuracy, which is limited by "
    "what the model leaves out"
)


def plan_tests(
    vehicle: Annotated[str, typer.Argument(help="A library name or a file; identified.yaml after an earlier test.")],
    minutes: Annotated[
        float, typer.Option(min=0.5, max=240, help="Length of the test [min], ways home included.")
    ] = 15.0,
    tank: Annotated[
        str | None, typer.Option(help="Length x width x depth of the water [m]; default: what the vehicle needs.")
    ] = None,
    bollard: Annotated[
        float | None,
        typer.Option(
            min=0,
            max=1,
            help="Full thrust is known to this share from a pull on a scale; 0: nobody pulled. Default 0.02; for an "
            "identified vehicle 0: its file says how well thrust is known.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the multi-sines to choose from.")] = 1,
    caution: Annotated[
        float,
        typer.Option(
            min=1, max=10, help="Times as much room to walls and to the attitude limit, where a test ended early."
        ),
    ] = 1.0,
    out: Annotated[Path, typer.Option("-o", "--out", help="Scenario to write.")] = Path("planned_test.yaml"),
    picture: Annotated[Path | None, typer.Option("--figure", help="Write a figure, .png, .svg or .pdf.")] = None,
    as_json: AsJson = False,
) -> None:
    """Lay out the test that should give the most information about a vehicle, and write it as a scenario.

    Multi-sines, doublets and releases are flown by the twin; those that stay within thrusters, tank and depth are
    judged by the information that they give about the parameters, and the best are put together. The thesis's steady
    steps in the same time are shown for comparison.

    Example: [bold]rovtwin plan-tests double_blueye --minutes 15 --tank 6x3x1.5 --figure plan.png[/bold]

    Then [bold]rovtwin fly planned_test.yaml[/bold] rehearses it on the twin.
    """
    # Matrices of a hundred rows: threads of OpenBLAS cost more than they bring, by far where others compute, too. It
    # reads this when NumPy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from rovtwin.identification.joint.model.groups import thruster_groups
    from rovtwin.planning.experiments import plan_tests, write_plan
    from rovtwin.planning.known import BOLLARD
    from rovtwin.planning.tank import Tank
    from rovtwin.report.identification.parameter_words import groups_in_words
    from rovtwin.vehicle import load_vehicle

    own = load_vehicle(vehicle)
    if bollard is None:
        bollard = 0.0 if own.file.identified is not None else BOLLARD
    size = Tank.parse(tank) if tank else Tank.of(own.model())
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=console(True),
        transient=True,
    ) as bar:
        task = bar.add_task("compiling", total=1.0)
        plan = plan_tests(
            own,
            vehicle,
            minutes,
            size,
            bollard=bollard or None,
            seed=seed,
            caution=caution,
            progress=lambda what, share: bar.update(task, description=what, completed=share),
        )
    write_plan(plan, out)
    if picture:
        from rovtwin.planning.experiments import plan_picture

        plan_picture(plan, size).savefig(picture, dpi=150)
    if as_json:
        emit(_as_data(plan) | {"tank_m": list(size.sizes), "scenario": str(out)})
        raise typer.Exit(DONE)
    if tank is None:
        console(False).print(f"no --tank given: taken is one of {size} m", markup=False)
    _print(plan, console(False))
    for line in groups_in_words(thruster_groups(own), own.thruster_names):
        console(False).print(line, markup=False, soft_wrap=True)
    _print_what_it_counts_on(plan, minutes, bollard, own.file.identified is not None)
    console(False).print(f"wrote {out}: rovtwin fly {out}", markup=False, soft_wrap=True)


def _print(plan: "Plan", screen: Any) -> None:
    from rovtwin.report.identification.parameter_words import what_teaches
    from rovtwin.report.identification.words import is_coupling

    expected = plan.expected
    rows = table(
        "expected standard deviations, shares of the value where it is positive",
        "parameter", "value", "before", "after", "steady steps", "variance ratio",
    )  # fmt: skip
    for i, name in enumerate(expected.names):
        if is_coupling(name):
            continue
        scale = 1.0 if expected.relative[i] else 0.0
        cells = [_sd(s[i], bool(scale)) for s in (expected.prior, expected.plan, plan.thesis)]
        ratio = f"{(expected.plan[i] / plan.thesis[i]) ** 2:.2f}" if plan.known[i] else "not learnt"
        rows.add_row(name, figure(float(expected.values[i])), *cells, ratio)
    screen.print(rows)
    minutes = expected.each_minute()
    shown = [m for m in minutes if m[0] in (1, 2, 3, 5, 7, 10, 15, 20, 30, 45, 60)]
    line = ", ".join(f"{m:.0f} min: {100 * left:.1f} %" for m, left in shown)
    learnt: dict[bool, list[bool]] = {False: [], True: []}
    for name, known in zip(expected.names, expected.learnt, strict=True):
        learnt[is_coupling(name)].append(bool(known))
    screen.print(
        f"\nlearnt: {sum(learnt[False])} of {len(learnt[False])} parameters and "
        f"{sum(learnt[True])} of {len(learnt[True])} couplings between directions (--json)"
    )
    for i, name in enumerate(expected.names):
        if not is_coupling(name) and not expected.learnt[i]:
            after = _sd(expected.plan[i], bool(expected.relative[i]))
            before = _sd(expected.prior[i], bool(expected.relative[i]))
            screen.print(f"not learnt: {name}, {before} before and {after} after. It takes {what_teaches(name)}")
    if shown:
        screen.print(f"standard deviation over the one before, geometric mean: {line}")
    if len(minutes) > 1:
        screen.print(f"the last minute took another {100 * (1 - minutes[-1][1] / minutes[-2][1]):.1f} % off")
    screen.print(
        f"variances over those of the thesis's steady steps in the same time, geometric mean: {plan.ratio:.2f}"
    )
    screen.print(FORM, soft_wrap=True)
    screen.print(f"the hull stays {plan.room:.2f} m clear of walls, floor and surface, by the twin")


def _print_what_it_counts_on(plan: "Plan", minutes: float, bollard: float, identified: bool) -> None:
    screen = console(False)
    if bollard:
        screen.print(
            f"counted on: a pull on a scale in surge, sway and heave that gives full thrust to {100 * bollard:.2g} % "
            "(--bollard 0 where nobody pulled: then no test tells the scale of forces and masses)"
        )
    elif identified:
        screen.print(
            "counted on: thrust as well as the file knows it (--bollard 0.02 if you will pull on a scale again)"
        )
    else:
        screen.print("nobody pulled on a scale (--bollard 0): no test can tell the scale of forces and masses")
    for note in plan.notes:
        screen.print(note, markup=False, soft_wrap=True)
    left = minutes - float(plan.expected.minutes[-1])
    if left > 0.05:
        screen.print(f"{60 * left:.0f} s of {minutes:g} min are left over: no other manoeuvre fits into them")


def _sd(value: float, relative: bool) -> str:
    if not relative:
        return figure(float(value))
    return f"{100 * value:.0f} %" if value >= 0.995 else f"{100 * value:.2g} %"


def _as_data(plan: "Plan") -> dict[str, Any]:
    expected = plan.expected
    rows = zip(
        expected.names, expected.values, expected.relative, expected.prior, expected.plan, plan.thesis, strict=True
    )
    keys = ("name", "value", "relative", "sd_before", "sd_after", "sd_after_steady_steps")
    return {
        "minutes": float(expected.minutes[-1]),
        "parameters": [dict(zip(keys, _plain(row), strict=True)) for row in rows],
        "variance_ratio": plan.ratio,
        "each_minute": expected.each_minute(),
        "room_m": plan.room,
        "manoeuvres": plan.manoeuvres,
        "notes": plan.notes,
    }


def _plain(row: tuple[Any, ...]) -> list[Any]:
    return [value if isinstance(value, str) else bool(value) if i == 2 else float(value) for i, value in enumerate(row)]
