"""The identification once more, from the logs of a bundle: with the same parameters, prior, anchors and options.

How near two machines come to each other. The estimator ends once a step changes nothing by a hundredth of a standard
deviation. Another processor or another XLA adds in another order, which by itself moves the estimate far less, but it
may end a step earlier or later. TOLERANCE leaves room for five such last steps; it is a twentieth of the width that
the certificate states, far below anything that a person would read off it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.commission.certified.manifest import Derived, ParameterEntry, TestEntry
from rovtwin.core.errors import IdentificationError, RovtwinError
from rovtwin.identification.joint.build import problem_of
from rovtwin.identification.joint.estimate import Solution, estimate
from rovtwin.identification.joint.result.scale import scale_response, with_scale
from rovtwin.identification.logs.readers import read_records
from rovtwin.identification.logs.record import Record
from rovtwin.identification.result import Identification
from rovtwin.vehicle import Vehicle, load_vehicle
from rovtwin.vehicle.description.files import with_meshes

TOLERANCE = 0.05  # of a parameter's standard deviation, by which it may differ
WIDTHS = 0.05  # share by which a standard deviation may differ
DIGITS = 1e-6  # relative difference of a value from that in the vehicle file, which has eight digits
PARTS = {" (fitted part)": True, " (held out)": False}  # how the parts of a log are called that was cut in two
_NEAR = 1e-6  # [s], between durations of one test

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Row:
    """A parameter: as given in the bundle, as found on this machine, and what lies between.

    Attributes:
        name, unit: Of the parameter.
        given, found: In its unit.
        apart: Difference in standard deviations.
        wider: Standard deviation found over the one given, less 1.
    """

    name: str
    unit: str
    given: float
    found: float
    apart: float
    wider: float

    @property
    def same(self) -> bool:
        return abs(self.apart) <= TOLERANCE and abs(self.wider) <= WIDTHS


def derived_of(
    result: Identification,
    vehicle_file: str,
    result_file: str,
    logs: Mapping[str, Path],
    anchors: Sequence[Mapping[str, Any]],
) -> Derived:
    """What a manifest says of an identification.

    Args:
        result: It.
        vehicle_file: Its vehicle file in the bundle.
        result_file: The saved result there.
        logs: All logs by their path in the bundle, those it is likely to rest on first.
        anchors: As of `identify`.

    Raises:
        IdentificationError: It rests on a test that no log holds, or on nothing that can be derived.
    """
    if result.solution is None:
        raise IdentificationError("it rests on no test")
    if result.acceptance is not None or (result.discrepancy is not None and result.options.discrepancy != "off"):
        raise IdentificationError("it learned a wrench beside its equations, which takes too long to learn again")
    fitted = [one for one in result.records if one["use"] == "fit"]
    places = logs_of(fitted, logs, result.vehicle)
    tests = [
        TestEntry(log=log, name=one["name"], use=one["use"], duration_s=one["duration"])
        for one, log in zip(fitted, places, strict=True)
    ]
    p = result.parameters
    rows = zip(p.free, p.values(result.theta).tolist(), result.theta.tolist(), result.std.tolist(), strict=True)
    parameters = [
        ParameterEntry(name=one.name, unit=one.unit, value=value, theta=theta, sd=sd) for one, value, theta, sd in rows
    ]
    return Derived(
        result=result_file, vehicle=vehicle_file, tests=tests, anchors=[dict(a) for a in anchors], parameters=parameters
    )


def logs_of(listed: Sequence[Mapping[str, Any]], logs: Mapping[str, Path], vehicle: Vehicle) -> list[str]:
    """Paths in the bundle of the logs that hold tests, known by name, length and number of readings; each of its own.

    Raises:
        IdentificationError: No log holds one.
    """
    read: dict[str, list[Record]] = {}
    found: list[str] = []
    for one in listed:
        for name, path in logs.items():
            if name not in read:
                read[name] = _read(path, vehicle)
            record = _found(one["name"], one["duration"], read[name])
            counts = None if record is None else {key: len(signal.t) for key, signal in record.signals.items()}
            taken = any(
                place == name and other["name"] == one["name"] for place, other in zip(found, listed, strict=False)
            )
            if counts == one["signals"] and not taken:
                found.append(name)
                break
        else:
            raise IdentificationError(
                f"it rests on the test {one['name']} of {one['duration']:.0f} s, which no log of the bundle holds"
            )
    return found


def _read(path: Path, vehicle: Vehicle) -> list[Record]:
    """The tests of a log; none of one that was cut off, or is of something else."""
    try:
        return read_records(path, vehicle)
    except RovtwinError:
        return []


def _found(name: str, duration: float, records: Sequence[Record]) -> Record | None:
    """The record of a name and length, cut out where it is a part of one."""
    for record in records:
        if record.name == name and abs(record.duration - duration) < _NEAR:
            return record
        for ending, first in PARTS.items():
            if name == record.name + ending and duration < record.duration:
                at = record.start + duration if first else record.end - duration
                part = record.cut(record.start, at) if first else record.cut(at, record.end)
                return replace(part, name=name)
    return None


def require_consistent(result: Identification, derived: Derived, vehicle: Vehicle) -> None:
    """That manifest, result and vehicle file say the same.

    Raises:
        IdentificationError: They do not: which parameter, both figures.
    """
    named = [one.name for one in derived.parameters]
    if named != list(result.parameters.names):
        raise IdentificationError(f"{derived.result} has other parameters than the manifest")
    identified = vehicle.file.identified
    written = {} if identified is None else {one.name: one.value for one in identified.estimate.parameters}
    for one in derived.parameters:
        value = result.values[one.name]
        for where, other in ((derived.result, value), (derived.vehicle, written.get(one.name, np.nan))):
            if not abs(one.value - other) <= DIGITS * max(abs(one.value), 1e-9):
                raise IdentificationError(
                    f"{one.name}: found {one.value:.6g} {one.unit} in the manifest and {other:.6g} in {where}"
                )


def require_self_contained(vehicle: Vehicle, folder: Path) -> None:
    """IdentificationError where a vehicle names a mesh file outside of a folder."""
    meshes: list[str] = []
    with_meshes(vehicle.to_dict(), lambda mesh: meshes.append(mesh) or mesh)
    for mesh in meshes:
        if not Path(mesh).resolve().is_relative_to(folder.resolve()):
            raise IdentificationError(f"{vehicle.where}: found the mesh {mesh}, expected one within the bundle")


def estimated_again(
    result: Identification, records: Sequence[Record], anchors: Sequence[Mapping[str, Any]], progress: Progress
) -> Solution:
    """The estimate of the same parameters, with the same prior, anchors and options, from records."""
    settings = result.options
    if not settings.accelerometer:
        records = [record.without("accelerometer") for record in records]
    problem = problem_of(result.parameters, result.prior, records, anchors, settings)
    solution = estimate(
        problem,
        max_steps=settings.max_steps,
        progress=lambda k, change: progress(f"step {k} of at most {settings.max_steps}", k / settings.max_steps),
    )
    return with_scale(solution, scale_response(problem, solution))


def derive_again(folder: Path, derived: Derived, progress: Progress) -> list[Row]:
    """Each parameter of a bundle that lies in a folder, as it was given and as it is found now.

    Raises:
        RovtwinError: The bundle contradicts itself, or its evidence cannot be used.
    """
    progress("reading", 0.0)
    result = Identification.load(folder / derived.result)
    vehicle = load_vehicle(str(folder / derived.vehicle))
    require_self_contained(vehicle, folder)
    require_consistent(result, derived, vehicle)
    records = []
    for test in derived.tests:
        found = _found(test.name, test.duration_s, read_records(folder / test.log, result.vehicle))
        if found is None:
            raise IdentificationError(f"{test.log}: found no test {test.name} of {test.duration_s:.1f} s")
        records.append(found)
    solution = estimated_again(result, records, derived.anchors, progress)
    theta, std = solution.unknowns.theta, np.sqrt(np.diag(solution.covariance))
    values = result.parameters.values(theta)
    return [
        Row(
            one.name,
            one.unit,
            one.value,
            float(values[i]),
            float((theta[i] - one.theta) / one.sd),
            float(std[i] / one.sd - 1.0),
        )
        for i, one in enumerate(derived.parameters)
    ]
