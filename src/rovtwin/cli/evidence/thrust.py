"""rovtwin evidence thrust: thrust curves of bollard tests, and thrust with damping from free-running speeds."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovtwin.cli.output import DONE, AsJson, console, emit, figure, refuse_idle, table
from rovtwin.core.errors import IdentificationError
from rovtwin.core.user_files.files import write_text

if TYPE_CHECKING:
    from rovtwin.identification.steady.thrust import Bollard
    from rovtwin.identification.steady.thrust_damping import JointFit, ThrustPrior


def thrust(
    files: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[FILE...]", help="Bollard tests: Blue Robotics' CSV, or two columns."),
    ] = None,
    hold_full: Annotated[
        bool, typer.Option("--hold-full", help="Keep the force at full command as measured; fit the shape.")
    ] = False,
    speeds: Annotated[
        Path | None, typer.Option(help="CSV of free-running tests, columns command,velocity: damping together.")
    ] = None,
    full: Annotated[
        str | None,
        typer.Option(metavar="F[:SD]", help="With --speeds: force at full command [N]; SD 2 % unless given."),
    ] = None,
    exponent: Annotated[
        str | None,
        typer.Option(
            metavar="N[:SD]", help="With --speeds: exponent of the curve; else that of FILEs, else 1.75:0.125."
        ),
    ] = None,
    dof: Annotated[
        str, typer.Option(help="With --speeds: direction, surge, sway, heave, roll, pitch or yaw.")
    ] = "surge",
    picture: Annotated[Path | None, typer.Option("--figure", help="Write a figure, .png, .svg or .pdf.")] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Write keys of a vehicle file.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fit force = F x^n, x = (|u| - dead band) / (1 - dead band), ahead and astern, to bollard tests.

    With --speeds also damping, from commands and steady velocities of free running: speeds alone cannot tell a bent
    thrust curve from bent damping, so that the curve needs a prior, from bollard tests of such a thruster.

    Examples: [bold]rovtwin evidence thrust 12V.csv 16V.csv --figure t200.png[/bold],
    [bold]rovtwin evidence thrust --speeds surge.csv --full 20:0.4 --exponent 1.75:0.125[/bold]
    """
    from rovtwin.identification.steady.thrust import fit_bollard, read_thrust

    if speeds is None:
        given = {"--full": full is not None, "--exponent": exponent is not None, "--dof": dof != "surge"}
        refuse_idle(given, "without --speeds only thrust is fitted, and FILEs say all of it")
    tests = []
    for path in files or []:
        voltage, points = read_thrust(path)
        tests.append(fit_bollard(points, path.name, voltage, hold_full))
    if not tests and speeds is None:
        raise IdentificationError("thrust: found no file, expected bollard tests, or --speeds FILE")
    joint, drawn = None, None
    if speeds is not None:
        from rovtwin.identification.steady.thrust_damping import fit_thrust_and_damping, read_speeds

        command, velocity = read_speeds(speeds)
        joint = fit_thrust_and_damping(command, velocity, _prior(tests, full, exponent), source=str(speeds))
        drawn = command, velocity
    if picture:
        from rovtwin.cli.evidence.towing import save_figure
        from rovtwin.report.evidence.thrust import thrust_and_damping_figure, thrust_figure

        save_figure(thrust_and_damping_figure(joint, *drawn, dof) if drawn else thrust_figure(tests), picture)
    if out:
        write_text(out, _curve_block(tests) if joint is None else _damping_block(joint, dof, speeds))
    if as_json:
        emit({"method": "thrust", "tests": [_test_data(t) for t in tests], "speeds": _joint_data(joint, dof)})
        raise typer.Exit(DONE)
    screen = console(False)
    if tests:
        _print_tests(screen, tests)
    if joint is not None:
        _print_joint(screen, joint, dof)
    from rovtwin.cli.evidence.towing import print_notes

    notes = [f"{t.source}: {note}" for t in tests for note in t.both.notes] + list(joint.notes if joint else ())
    print_notes(screen, tuple(notes), picture, out)


def _prior(tests: "list[Bollard]", full: str | None, exponent: str | None) -> "ThrustPrior":
    from rovtwin.cli.evidence.decay import known
    from rovtwin.identification.known import Known
    from rovtwin.identification.steady.thrust_damping import ThrustPrior

    most = known(full, "--full")
    if most is None:
        raise IdentificationError("--speeds: needs --full, the force at full command: speeds alone have no scale")
    if most.sd == 0:
        most = Known(most.value, 0.02 * abs(most.value))
    given = known(exponent, "--exponent")
    if given is not None:
        return ThrustPrior(most, given)
    return ThrustPrior.of(tests, most) if tests else ThrustPrior(most)


def _curve_block(tests: "list[Bollard]") -> str:
    """Keys of one thruster in a vehicle file, a block for each test."""
    blocks = []
    for one in tests:
        curve, sd = one.both, one.both.sd
        force = f"{curve.values[0]:.4g}"
        if curve.astern is not None:
            force = f"{{ahead: {force}, astern: {curve.astern:.4g}}}"
        volts = "" if one.voltage is None else f" at {one.voltage:g} V"
        blocks.append(
            f"# {one.source}{volts}: exponent +- {sd[2]:.2g}, dead band +- {sd[1]:.2g}, rms {curve.rms:.2g} N\n"
            f"force: {force}\ncurve: {{power: {curve.values[2]:.4g}}}\ndead_band: {curve.values[1]:.4g}\n"
            f"source: bollard test {one.source}{volts}\n"
        )
    return "---\n".join(blocks)


def _damping_block(joint: "JointFit", dof: str, path: Path | None) -> str:
    """hydrodynamics: of a vehicle file."""
    from rovtwin.identification.steady.damping_yaml import DOFS

    if dof not in DOFS:
        raise IdentificationError(f"--dof: found {dof!r}, expected one of {', '.join(DOFS)}")
    rows = [
        f"  {key}: [{', '.join(f'{value:.6g}' if name == dof else '~' for name in DOFS)}]"
        for key, value in zip(("linear_damping", "quadratic_damping"), joint.damping, strict=True)
    ]
    sd, name = joint.sd, "" if path is None else path.name
    note = (
        f"  # {dof}: linear +- {sd[0]:.2g}, quadratic +- {sd[1]:.2g}; thrust {joint.thrust[0]:.4g} at full command, "
        f"exponent {joint.thrust[2]:.3g}, dead band {joint.thrust[1]:.3g}"
    )
    lines = [
        f"    {key}: free running with the thrust curve, {name}" for key in ("linear_damping", "quadratic_damping")
    ]
    return "\n".join(["hydrodynamics:", note, *rows, "  sources:", *lines]) + "\n"


def _test_data(one: "Bollard") -> dict[str, Any]:
    def curve(fit: Any) -> dict[str, Any] | None:
        if fit is None:
            return None
        keys = ("force", "dead_band", "exponent")
        values = dict(zip(keys, fit.values.tolist(), strict=True))
        rest = {"covariance": fit.covariance.tolist(), "rms": fit.rms, "notes": list(fit.notes)}
        return values | {"astern": fit.astern} | rest

    return {"source": one.source, "voltage": one.voltage} | {
        name: curve(getattr(one, name)) for name in ("ahead", "astern", "both")
    }


def _joint_data(joint: "JointFit | None", dof: str) -> dict[str, Any] | None:
    if joint is None:
        return None
    return {
        "dof": dof,
        "linear": joint.damping[0],
        "quadratic": joint.damping[1],
        "full": joint.thrust[0],
        "dead_band": joint.thrust[1],
        "exponent": joint.thrust[2],
        "covariance": joint.covariance.tolist(),
        "sigma_velocity": joint.sigma,
        "moved_from_prior_sd": joint.moved.tolist(),
        "as_linear_thrust": joint.as_linear.tolist(),
        "notes": list(joint.notes),
    }


def _print_tests(screen: Any, tests: "list[Bollard]") -> None:
    rows = table("force = F x^n, x = (|u| - dead band) / (1 - dead band)", "test", "voltage", "", "F", "dead band",
                 "n", "+- (95 %)", "left over (rms)")  # fmt: skip
    for one in tests:
        for name in ("ahead", "astern", "both"):
            fit = getattr(one, name)
            if fit is None:
                continue
            full = [float(fit.values[0])] if fit.astern is None else [float(fit.values[0]), -fit.astern]
            rows.add_row(
                one.source if name == "ahead" else "",
                figure(one.voltage, "V") if name == "ahead" else "",
                name,
                figure(full, "N"),
                f"{fit.values[1]:.3f}",
                f"{fit.values[2]:.2f}",
                f"{1.96 * fit.sd[2]:.2f}",
                figure(fit.rms, "N"),
            )
    screen.print(rows)


def _print_joint(screen: Any, joint: "JointFit", dof: str) -> None:
    rotational = dof in ("roll", "pitch", "yaw")
    force, units = ("N m", ("N m s/rad", "N m s2/rad2")) if rotational else ("N", ("N s/m", "N s2/m2"))
    rows = table(f"{dof}: damping and thrust together", "", "", "+- (95 %)", "unit", "if thrust were linear")
    sd = 1.96 * joint.sd
    for i, name in enumerate(("linear damping", "quadratic damping")):
        rows.add_row(name, figure(float(joint.damping[i])), figure(float(sd[i])), units[i],
                     figure(float(joint.as_linear[i])))  # fmt: skip
    for i, (name, unit) in enumerate((("full thrust", force), ("dead band", ""), ("exponent", ""))):
        rows.add_row(name, figure(float(joint.thrust[i])), figure(float(sd[2 + i])), unit, "")
    screen.print(rows)
    screen.print(f"speeds: +- {figure(joint.sigma)} {'rad/s' if rotational else 'm/s'} (one standard deviation)")
