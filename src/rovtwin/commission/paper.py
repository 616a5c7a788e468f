"""Paper: what parts, geometry and formulas say of the vehicle and the tank, before anything gets wet."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.quantity import plain
from rovtwin.identification.identify import identify
from rovtwin.planning.room import require_possible
from rovtwin.planning.tank import Tank
from rovtwin.runs.compose.experiment_scales import ExperimentScales
from rovtwin.runs.vehicle_figures import Figure, compared, key_figures
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.analysis.hydrostatics import floating_of
from rovtwin.vehicle.analysis.lint import findings, reservations
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.actuation import wrench_limits

HEAVY = 0.5  # net buoyancy over the thrusters' vertical force, from which on ballast is proposed
TILTED = 5.0  # trim or list at rest, from which on ballast is proposed [deg]


def run(work: Work) -> Outcome:
    """The page of the vehicle as it is described."""
    work.person.progress("reading the description")
    vehicle, prior = work.vehicle, work.request.load_prior()
    model = vehicle.model()
    figures = key_figures(vehicle)
    before = prior.without_identification() if prior is not None else None
    checks = [*_description(vehicle, model), *_ballast(vehicle, model), *_directions(model)]
    checks += _room(vehicle, model, work.request.room)
    work.person.progress("predicting parameters")
    predicted = identify(vehicle, (), old=prior)
    checks += [Check("note", "parameters", line) for line in predicted.findings]
    rows = [] if before is None else compared(before, vehicle)
    checks += _differences(rows)
    return Outcome(
        tuple(checks),
        {
            "vehicle": vehicle.name,
            "figures": [_figure(figure) for figure in figures],
            "differences": [row for row in rows if row["change"]],
            "parameters": [
                {
                    "name": p.name,
                    "unit": p.unit,
                    "value": predicted.values[p.name],
                    "interval_95": list(predicted.interval(p.name)),
                }
                for p in predicted.parameters.free
            ],
        },
    )


def _description(vehicle: Vehicle, model: Model) -> Iterator[Check]:
    """What spoils the vehicle in still water stops; all else that surprises is noted."""
    for line in reservations(model):
        yield Check("stop", "description", f"{line}.", "Mend the file or the ballast: `rovtwin vehicle check`.")
    for line in findings(vehicle, model):
        yield Check("note", "description", line)


def _ballast(vehicle: Vehicle, model: Model) -> Iterator[Check]:
    """Whether it floats level enough and light enough to be flown; the command that finds ballast."""
    rest = floating_of(vehicle.assembly)
    roll, pitch = (float(angle) for angle in np.degrees(rest.trim))
    command = f"rovtwin vehicle ballast {vehicle.name} --buoyancy 2N --level -o ballasted.yaml"
    if max(abs(roll), abs(pitch)) > TILTED:
        text = f"it rests at roll {roll:z.1f}, pitch {pitch:z.1f} deg, expected less than {TILTED:g}."
        yield Check("warning", "trim", text, f"Trim it: {command}")
    net, push = float(rest.net_buoyancy), _heave(model)
    if abs(net) > HEAVY * push > 0.0:
        text = f"net buoyancy is {plain(net, 3)} N, more than half of the {plain(push, 3)} N that it pushes in heave."
        yield Check("warning", "buoyancy", text, f"Trim it: {command}")
    yield Check("ok", "balance", f"net buoyancy {plain(net, 3)} N, roll {roll:z.1f}, pitch {pitch:z.1f} deg at rest")


def _heave(model: Model) -> float:
    """The lesser of the forces that all thrusters together give up and down [N]."""
    low, high = (np.asarray(limit) for limit in wrench_limits(model.thrusters))
    return float(min(-low[2], high[2]))


def _directions(model: Model) -> Iterator[Check]:
    """Which axes no thruster pushes: nothing of them is identified by pushing."""
    able = ExperimentScales.of(model).able
    if lacking := [axis for axis, can in zip(AXES, able, strict=True) if not can]:
        text = f"no thruster pushes in {', '.join(lacking)}: damping there is known from turns only, if at all"
        yield Check("note", "directions", text)


def _room(vehicle: Vehicle, model: Model, tank: Tank) -> Iterator[Check]:
    """Whether the test water is large enough to turn round in; whether for more, the planned test says."""
    scales = ExperimentScales.of(model)
    try:
        require_possible(vehicle, scales, tank, bool(scales.able.any()))
    except ConfigError as error:
        yield Check("stop", "tank", str(error), "Use a larger tank.")
        return
    usual = Tank.of(model)
    smaller = [f"{size:g} of {own:g}" for size, own in zip(tank.sizes, usual.sizes, strict=True) if size < own]
    if smaller:
        text = f"{tank} m is smaller than the {usual} m in which every axis reaches half of its top speed."
        yield Check("warning", "tank", text, "Damping at higher speeds will rest on the shape of the model.")
    else:
        yield Check("ok", "tank", f"{tank} m leaves room for every axis")


def _differences(rows: list[dict[str, Any]]) -> Iterator[Check]:
    for row in rows:
        if row["change"]:
            change = row["change"]
            text = ", ".join(change) if isinstance(change, list) else f"{row['before']:.4g} -> {row['after']:.4g}"
            yield Check("note", f"since the earlier file: {row['label']}", f"{text} {row['unit']}".rstrip())


def _figure(figure: Figure) -> dict[str, Any]:
    return {"key": figure.key, "label": figure.label, "unit": figure.unit, "value": figure.value}
