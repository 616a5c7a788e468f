"""The identification once more: from real logs to the same figures; what does not fit is said in words."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.commission.conftest import certified
from tests.commission.dossiers import FULL, dated, small_log, written
from tests.identification.synthetic import record, steps_command

from rovtwin.commission.certified.again import (
    TOLERANCE,
    Row,
    derived_of,
    logs_of,
    require_consistent,
    require_self_contained,
)
from rovtwin.commission.certified.manifest import Derived, ParameterEntry, TestEntry
from rovtwin.commission.certified.verify import verify
from rovtwin.commission.stage import Outcome
from rovtwin.core.errors import IdentificationError
from rovtwin.core.log import Channel, Log
from rovtwin.core.sensors import SENSORS
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.identification.identify import identify
from rovtwin.identification.logs.readers import read_records
from rovtwin.runs.recording.channels import sensor_channel
from rovtwin.vehicle import load_vehicle

FREE = ["added_mass.surge", "quadratic_damping.surge", "restoring.net_buoyancy"]
OF_SIGNAL = {"horizontal": "position", "depth": "pressure", "attitude": "attitude", "gyro": "gyro"}


def flown(path: Path, vehicle, seed: int, duration: float = 8.0) -> None:
    """A log of the plant itself, driven at random."""
    made = record(vehicle.model(), *steps_command(vehicle, seed, duration), duration, seed)
    thrusters = tuple(name.replace(".", "_") for name in vehicle.thruster_names)
    channels = {"autopilot/command": Channel("autopilot/command", thrusters, "1", "b", "commands", 2.0)}
    data = {"autopilot/command": (made.t_command, made.command)}
    for signal, sensor in OF_SIGNAL.items():
        one = made.signals[signal]
        channel = sensor_channel(sensor, SENSORS[sensor])
        channels[channel.name] = channel
        data[channel.name] = (one.t, np.column_stack([one.value, one.t]))
    path.parent.mkdir(parents=True, exist_ok=True)
    Log.from_arrays(channels.values(), data, {"water_density": "1000.0"}).write(path)


@pytest.mark.system
def test_a_test_is_found_by_name_length_and_readings(tmp_path):
    vehicle = load_vehicle("blueye_x3")
    logs = {}
    for seed, place in ((1, "one/part-1"), (2, "two/part-1"), (3, "two/part-2")):
        path = tmp_path / place / "log.mcap"
        flown(path, vehicle, seed, 4.0 + 2.0 * seed)
        logs[f"{place}/log.mcap"] = path
    small_log(tmp_path / "rest" / "log.mcap")
    logs["rest/log.mcap"] = tmp_path / "rest" / "log.mcap"
    (found,) = read_records(tmp_path / "two/part-1/log.mcap", vehicle)
    counts = {name: len(one.t) for name, one in found.signals.items()}
    listed = {"name": "part-1", "duration": found.duration, "signals": counts}
    assert logs_of([listed], logs, vehicle) == ["two/part-1/log.mcap"]
    half = found.cut(found.start, found.start + 2.0)
    counts = {name: len(one.t) for name, one in half.signals.items()}
    part = {"name": "part-1 (fitted part)", "duration": 2.0, "signals": counts}
    # Both logs have as many readings in their first two seconds: each test has a log of its own.
    assert logs_of([part, part], logs, vehicle) == ["one/part-1/log.mcap", "two/part-1/log.mcap"]
    for gone in ([part] * 3, [listed | {"name": "part-9"}]):
        with pytest.raises(IdentificationError, match="which no log of the bundle holds"):
            logs_of(gone, logs, vehicle)


def test_what_cannot_be_derived_says_why():
    nothing: Any = SimpleNamespace(solution=None)
    with pytest.raises(IdentificationError, match="rests on no test"):
        derived_of(nothing, "v", "r", {}, [])
    learned: Any = SimpleNamespace(solution=1, acceptance=1, discrepancy=1)
    with pytest.raises(IdentificationError, match="learned a wrench"):
        derived_of(learned, "v", "r", {}, [])


def derived(value: float) -> Derived:
    test = TestEntry(log="log.mcap", name="x", use="fit", duration_s=1.0)
    one = ParameterEntry(name="a.b", unit="N", value=value, theta=0.0, sd=0.1)
    return Derived(result="identified.nc", vehicle="identified.yaml", tests=[test], anchors=[], parameters=[one])


def test_figures_that_are_given_twice_must_agree():
    result: Any = SimpleNamespace(parameters=SimpleNamespace(names=["a.b"]), values={"a.b": 2.0})

    def vehicle(value) -> Any:
        estimate = SimpleNamespace(parameters=[SimpleNamespace(name="a.b", value=value)])
        return SimpleNamespace(file=SimpleNamespace(identified=SimpleNamespace(estimate=estimate)))

    require_consistent(result, derived(2.0), vehicle(2.0))
    with pytest.raises(IdentificationError, match=r"a.b: found 2.1 N in the manifest and 2 in identified.nc"):
        require_consistent(result, derived(2.1), vehicle(2.1))
    with pytest.raises(IdentificationError, match=r"found 2 N in the manifest and 2.2 in identified.yaml"):
        require_consistent(result, derived(2.0), vehicle(2.2))
    with pytest.raises(IdentificationError, match="other parameters"):
        result.parameters.names = ["c"]
        require_consistent(result, derived(2.0), vehicle(2.0))


def test_a_mesh_outside_of_the_bundle_is_refused(tmp_path):
    vehicle: Any = SimpleNamespace(
        where="v.yaml", to_dict=lambda: {"visuals": [{"mesh": str(tmp_path / "in" / "a.stl")}]}
    )
    require_self_contained(vehicle, tmp_path / "in")
    with pytest.raises(IdentificationError, match="expected one within the bundle"):
        require_self_contained(vehicle, tmp_path / "other")


def test_a_row_is_the_same_within_its_tolerance():
    assert Row("a", "N", 1.0, 1.0, TOLERANCE, 0.0).same and not Row("a", "N", 1.0, 1.0, 1.01 * TOLERANCE, 0.0).same


@pytest.mark.slow
def test_a_bundle_is_derived_again_from_its_logs(tmp_path):
    """Two tests of a twin; afterwards one reading less is noticed, and so is another figure."""
    measured = {name: dict(outcome.measured) for name, outcome in FULL.items()} | {"scale": {"anchors": []}}
    outcomes = {name: Outcome((), measured[name]) for name in FULL}
    dossier = written(tmp_path, outcomes, failed=False)
    vehicle = load_vehicle(dossier.request.vehicle)
    excite, estimated = (dossier.attempts(name)[-1].folder for name in ("excite", "identify"))
    (excite / "part-1" / "log.mcap").unlink()
    for number in (1, 2):
        flown(excite / f"part-{number}" / "log.mcap", vehicle, number)
    records = [one for k in (1, 2) for one in read_records(excite / f"part-{k}" / "log.mcap", vehicle)]
    result = identify(vehicle, records, free=FREE, options={"rate": 10.0})
    (estimated / "identified.yaml").write_text(dump_yaml(result.file()))
    result.save(estimated / "identified.nc", overwrite=True)
    folder, outcome = certified(dated(dossier))
    assert any(check.what == "re-derivation" and check.verdict == "ok" for check in outcome.checks)
    found = verify(folder / "bundle.zip")
    assert found.good and len(found.rows) == len(FREE) and max(abs(row.apart) for row in found.rows) < 1e-3
    manifest = found.manifest.model_copy(update={"derived": _moved(found.manifest.derived)})
    (folder / "bundle" / "MANIFEST.json").write_text(manifest.text())
    assert "in the manifest and" in verify(folder / "bundle").contradiction


def _moved(given: Derived | None) -> Derived:
    """With one figure by a tenth larger."""
    assert given is not None
    first, *rest = given.parameters
    return given.model_copy(update={"parameters": [first.model_copy(update={"value": 1.1 * first.value}), *rest]})
