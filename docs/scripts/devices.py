"""The table of devices bolted onto vehicles: what `vehicle add` and the payload's prediction say, against flights.

python -m docs.scripts.devices --out runs/devices                          # three vehicles, four devices each: an hour
python -m docs.scripts.devices --out runs/devices my.yaml --steps statics  # your own
python -m docs.scripts.devices --out runs/devices --table                  # only print what is there

- statics: trim and net buoyancy as `vehicle add` predicts them, without and with the ballast that it proposes, against
  the vehicle let go level in still water: the angles at which it settles, and how fast it then rises or sinks.
- bound: for a device that tells the filter of the motion, the position bound before and after against the rms error of
  the filter in `square`, three seeds each, the vehicle ballasted.
- identified: the bare vehicle, its truth drawn half as wide as the prior until one gets through its planned test, flies
  that with one pull on a scale of 2 %. The device is bolted on, with its ballast. What it truly changes does not come
  from the formulas that predict it: added mass is the panel method's, drag is the formula's times log-normal factors
  of 1.5 with 3 % of the
  whole, displaced volumes are off by 3 % (tests/identification/swap.py). The same test is flown again and identified
  with the prediction as prior. How many truths lie in the 95 % intervals, before and after?

Each cell is written to cells.json as soon as it is known; what is there is not run again (--again).
"""

import argparse
import json
import shutil
import zlib
from pathlib import Path

import numpy as np
from docs.scripts.chain import Bench
from tests.identification.swap import errors, pull, truly_changed

from rovtwin.core.block import Start
from rovtwin.core.errors import RovtwinError
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion, rotation_from_quaternion
from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.identify import Identification, identify
from rovtwin.identification.logs.readers import read_records
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import Model, Vehicle, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.extent import around_thrusters, bounding_box
from rovtwin.vehicle.analysis.stability import hang, steady_speed
from rovtwin.vehicle.physics.dynamics import State, rollout

VEHICLES = ("double_blueye", "bluerov2_heavy", "gladius_mini")
PLACES = {
    "dvl_a50": -0.5,
    "imaging_sonar": 0.6,
    "gripper": 0.8,
    "uhi_with_lamps": 0.0,
    "battery_pod": 0.0,
    "ping360": 0.0,
}
"""Under the hull, how far ahead, as a share of half its length."""
LARGEST = ("uhi_with_lamps", "battery_pod", "ping360")
SHARE = 0.25  # of the vehicle's mass that the largest device may have
GAP = 0.01  # between hull and device [m]
STEP, PERIODS, LEAST = 0.01, 15, 60.0  # of a release [s], in natural periods, at least [s]
SWINGS = 0.5  # more than this between the extremes of its last fifth and it has not settled [deg]
USES = ("fit", "validate")
DRAWS, TRIM_DEG = 12, 8.0  # true vehicles that are tried; the trim beyond which somebody would ballast one first
MINUTES, DRAWN = "4", 0.5  # of the plan; of the bare vehicle's truth over the prior's


class Case(Bench):
    """One device on one vehicle; `bare` is the vehicle without it."""

    def __init__(self, bare: Bench, device: str):
        super().__init__(bare.vehicle, bare.folder / device, "1-3")
        self.bare, self.device = bare, device

    def place(self) -> str:
        """Where the device's origin goes, for --at."""
        low, high = _outside(load_vehicle(self.vehicle))
        top = bounding_box(load_vehicle(self.device).file)[0]
        ahead = 0.5 * (low[0] + high[0]) + PLACES.get(self.device, 0.0) * 0.5 * (high[0] - low[0])
        return f"{ahead:.3f},0,{high[2] + GAP - top[2]:.3f}"

    def added(self, ballast: bool) -> dict:
        """What `vehicle add` says; the file is loaded.yaml, ballasted.yaml in the folder."""
        name = "ballasted" if ballast else "loaded"
        kept = self.folder / f"{name}.json"
        if not kept.exists():
            options = ["--at", self.place(), "-o", f"{name}.yaml", "--overwrite", "--json"]
            options += ["--ballast"] if ballast else []
            code, data, message = self.run("vehicle", "add", self.vehicle, self.device, *options)
            if code:
                raise RuntimeError(message)
            kept.write_text(json.dumps(data))
        return json.loads(kept.read_text())

    def figure(self, key: str, ballast: bool, when: str = "after") -> float | None:
        return next(row[when] for row in self.added(ballast)["figures"] if row["key"] == key)

    def with_device(self) -> Vehicle:
        self.added(True)
        return load_vehicle(self.folder / "ballasted.yaml")


def statics(case: Case) -> dict:
    """Predicted and settled roll and pitch [deg], rising speed [m/s], without and with ballast."""
    found = {"mass_kg": round(float(load_vehicle(case.device).assembly.solid.mass), 3), "at": case.place()}
    for name, ballast in (("loaded", False), ("ballasted", True)):
        case.added(ballast)
        model = load_vehicle(case.folder / f"{name}.yaml").model()
        net = case.figure("net_buoyancy", ballast)
        roll, pitch, rising, moving = released(model)
        found[name] = {
            "net_buoyancy_N": net,
            "predicted_deg": [case.figure("list", ballast), case.figure("trim", ballast)],
            "settled_deg": [roll, pitch],
            "predicted_rise_ms": float(np.sign(net)) * steady_speed(model, 2, -net),
            "rise_ms": rising,
            "moving_deg": moving,
        }
    found["ballast_kg"] = sum(piece["mass_kg"] for piece in case.added(True)["ballast"])
    return found


def released(model: Model) -> tuple[float, float, float, float]:
    """Roll and pitch [deg] and rising speed [m/s] at the end of a release; how much the angles still move [deg]."""
    period = np.nanmax([*hang(model).periods, 0.0])
    steps = round(max(LEAST, PERIODS * period) / STEP)
    still = Command(jnp.zeros((steps, model.thrusters.count)))
    path = _let_go(model, State.at(model, Start.at([0.0, 0.0, 50.0])), still)
    late = slice(-round(0.2 * steps), None)
    angles = np.degrees(np.asarray(jax.vmap(euler_from_quaternion)(path.attitude[late])))[:, :2]
    down = np.einsum("tij,tj->ti", jax.vmap(rotation_from_quaternion)(path.attitude[late]), path.nu[late, :3])[:, 2]
    roll, pitch = angles.mean(axis=0)
    return float(roll), float(pitch), -float(down.mean()), float(np.ptp(angles, axis=0).max())


@jax.jit
def _let_go(model: Model, state: State, commands: Command) -> State:
    return rollout(model, state, commands, Environment.calm(), STEP)


def bound(case: Case) -> dict:
    """Position bound and rms error of the filter [m], before and after; empty where the bound stays."""
    bounds = [[case.figure(f"position_bound_{axis}", True, when) for axis in ("surge", "sway")] for when in WHEN]
    if bounds[0][1] is None or bounds[1][1] > 0.9 * bounds[0][1]:
        return {}
    before = scored(case.bare, case.vehicle)
    after = scored(case, "ballasted.yaml")
    both = {key: [before[key], after[key]] for key in ("error_m", "nees", "completed")}
    return {"bound_m": bounds, **both}


WHEN = ("before", "after")


def scored(bench: Bench, vehicle: str) -> dict:
    """Errors of the estimate in `square`: rms over seeds of both axes, and NEES."""
    kept = bench.folder / "score.json"
    if not kept.exists():
        code, data, message = bench.run("score", "square", "--vehicle", vehicle, "--seeds", "1-3", "--json")
        if code not in (0, 1) or "scenarios" not in data:
            raise RuntimeError(message)
        kept.write_text(json.dumps(data))
    (runs,) = json.loads(kept.read_text())["scenarios"].values()
    squares = np.array([run["position_error_rms_m"] for run in runs]) ** 2
    nees = float(np.mean([run["nees_position_mean"] for run in runs]))
    return {
        "error_m": np.sqrt(squares.mean(axis=0)).tolist(),
        "nees": nees,
        "completed": sum(r["completed"] for r in runs),
    }


def identified(case: Case) -> dict:
    """How many truths are inside the intervals of the prediction and of the identification, and their widths."""
    old, truth = case_of_the_bare(case)
    new, rng = case.with_device(), _rng(case.vehicle, case.device)
    swims = truly_changed(truth, load_vehicle(case.vehicle), new, rng)
    predicted = identify(new, [], old=old)
    found = tested(case, new, "ballasted.yaml", swims, 1, old=old)
    widths = {name: float(s) for name, s in zip(found.parameters.names, found.std, strict=True)}
    were = dict(zip(predicted.parameters.names, predicted.std, strict=True))
    return {
        "predicted": errors(predicted, swims),
        "identified": errors(found, swims),
        "of": len(found.parameters),
        "narrower": float(np.median([widths[name] / were[name] for name in widths])),
        "wider": {name: round(widths[name] / were[name], 2) for name in widths if widths[name] > 1.02 * were[name]},
        "doubts": list(found.doubts),
        "seconds": found.seconds,
    }


def case_of_the_bare(case: Case) -> tuple[Vehicle, Model]:
    """The bare vehicle as identified, and its truth."""
    vehicle, kept = load_vehicle(case.vehicle), case.bare.folder / "identified.json"
    parts = identify(vehicle, [])
    rng, L = _rng(case.vehicle), np.linalg.cholesky(parts.covariance)
    drawn = case.bare.folder / "drawn.json"
    skipped = json.loads(drawn.read_text()) if drawn.exists() else None
    for number in range(DRAWS):
        while True:
            truth = parts.parameters.model_at(DRAWN * L @ rng.standard_normal(len(L)))[0]
            rest = hang(truth)
            if rest.stiffness.min() > 0 and np.abs(rest.trim).max() < np.deg2rad(TRIM_DEG):
                break
        if skipped is None and _ends(case.bare, case.vehicle, truth, 0):
            continue  # it tips over in its test: whoever sees that trims the vehicle first
        if skipped in (None, number):
            drawn.write_text(json.dumps(number))
            break
    else:
        raise RuntimeError(f"{case.vehicle}: none of {DRAWS} true vehicles gets through the planned test")
    if not kept.exists():
        result = tested(case.bare, vehicle, case.vehicle, truth, 0, anchors=[pull(truth, rng)])
        print(f"  {case.vehicle}: {json.dumps(errors(result, truth))} {result.doubts}", flush=True)
        kept.write_text(json.dumps(result.file()))
    return vehicle_from_dict(json.loads(kept.read_text()), "identified.yaml"), truth


def tested(bench: Bench, vehicle: Vehicle, name: str, truth: Model, seed: int, **more) -> Identification:
    """The planned test flown by the true vehicle and identified; a second flight of it is predicted."""
    if words := _ends(bench, name, truth, seed):
        raise RuntimeError(words)
    flown = [read_records(bench.folder / use / "log.mcap", vehicle) for use in USES]
    return identify(vehicle, flown[0], validate=flown[1], **more)


def _ends(bench: Bench, name: str, truth: Model, seed: int) -> str:
    """The planned test, flown by the true vehicle once for each of USES: why one of them ended early, or nothing."""
    bare = bench.bare if isinstance(bench, Case) else bench
    plan = bare.folder / "planned.yaml"
    if not plan.exists():
        options = ["--minutes", MINUTES, "--tank", bare.tank(), "-o", "planned.yaml", "--json"]
        code, _, message = bare.run("plan-tests", bare.vehicle, *options)
        if code:
            raise RuntimeError(message)
    path = str(bench.folder / name) if name.endswith(".yaml") and not Path(name).is_absolute() else name
    for use, number in zip(USES, (2 * seed + 1, 2 * seed + 2), strict=True):
        folder = bench.folder / use
        if not (folder / "log.mcap").exists():
            fly(load_scenario(str(plan), [f"vehicle={path}", f"seed={number}"]), folder, truth=truth)
        summary = json.loads((folder / "summary.json").read_text())
        if not summary["completed"]:
            for one in USES:
                shutil.rmtree(bench.folder / one, ignore_errors=True)  # of another true vehicle than the next
            return f"the planned test ended after {summary['duration_s']:.0f} s: {summary['reason']}"
    return ""


STEPS = {step.__name__: step for step in (statics, bound, identified)}


def _outside(vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray]:
    box = bounding_box(vehicle.file) or around_thrusters(vehicle.assembly)
    if box is None:
        raise RuntimeError(f"{vehicle.name}: has neither shapes nor thrusters")
    return box


def _rng(*names: str) -> np.random.Generator:
    return np.random.default_rng(zlib.crc32(" ".join(names).encode()))


def devices_of(vehicle: str) -> list[str]:
    """Doppler log, sonar, gripper, and the largest of three that the vehicle can carry."""
    most = SHARE * float(load_vehicle(vehicle).assembly.solid.mass)
    large = [name for name in LARGEST if load_vehicle(name).assembly.solid.mass <= most]
    return ["dvl_a50", "imaging_sonar", "gripper", *large[:1]]


def table(cells: dict) -> str:
    """Markdown: a table for each step."""
    lines = []
    for step, (head, row) in TABLES.items():
        lines += [head, "|---" * (head.count("|") - 1) + "|"]
        for vehicle, devices in cells.items():
            for device, row_of in devices.items():
                cell = row_of.get(step)
                if cell:
                    text = cell["failed"] if "failed" in cell else row(cell)
                    lines.append(f"| `{Path(vehicle).stem}` | `{device}` | {text} |")
        lines.append("")
    return "\n".join(lines)


def _statics_row(cell: dict) -> str:
    parts = [f"{cell['mass_kg']:g}"]
    for name in ("loaded", "ballasted"):
        one = cell[name]
        parts += [_pair([one["net_buoyancy_N"]], ".2f")]
        swings = f", swings by {one['moving_deg']:.0f}" if one["moving_deg"] > SWINGS else ""
        parts += [_pair(one["predicted_deg"], ".1f"), _pair(one["settled_deg"], ".1f") + swings]
        parts += [_pair([one["predicted_rise_ms"], one["rise_ms"]], ".3f")]
    return " | ".join([*parts, f"{1000 * cell['ballast_kg']:.0f}"])


def _bound_row(cell: dict) -> str:
    parts = []
    for i in (0, 1):
        least, error = (float(np.hypot(*cell[key][i])) for key in ("bound_m", "error_m"))
        parts += [_pair(cell["bound_m"][i], ".3f"), f"{error:.3f}", f"{error / least:.2f}", f"{cell['nees'][i]:.2f}"]
    return " | ".join(parts)


def _identified_row(cell: dict) -> str:
    parts = []
    for which in ("predicted", "identified"):
        count = cell["of"] - cell[which]["left_out"]
        parts += [f"{round(cell[which]['held'] * count)} of {count}", f"{cell[which]['rms_z']:.2f}"]
    return " | ".join([*parts, f"{cell['narrower']:.3f}", "; ".join(cell["doubts"]) or "none"])


def _pair(values: list, form: str) -> str:
    """Numbers as text, without a minus at zero."""
    texts = ["–" if value is None else format(value, form) for value in values]
    return ", ".join(text if text.strip("-+0.") else text.replace("-", "") for text in texts)


TABLES = {
    "statics": (
        "| vehicle | device | kg | net [N] | roll, pitch predicted [deg] | settled | rises predicted, settled [m/s] | "
        "ballasted: net [N] | predicted [deg] | settled | rises [m/s] | ballast [g] |",
        _statics_row,
    ),
    "bound": (
        "| vehicle | device | bound before, along, across [m] | error [m] | over bound | NEES | "
        "bound after | error | over bound | NEES |",
        _bound_row,
    ),
    "identified": (
        "| vehicle | device | predicted: truths inside 95 % | rms of error over sd | identified: inside | rms | "
        "width over predicted, median | doubts |",
        _identified_row,
    ),
}


def main() -> None:
    """Run what is not known yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vehicles", nargs="*", help="files or library names; default three of the library")
    parser.add_argument("--out", type=Path, default=Path("runs/devices"))
    parser.add_argument("--steps", default=",".join(STEPS))
    parser.add_argument("--devices", default="", help="names, separated by commas; default four that suit the vehicle")
    parser.add_argument("--again", action="store_true", help="run cells that are known once more")
    parser.add_argument("--table", action="store_true", help="run nothing, print the table")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    kept = given.out / "cells.json"
    cells = json.loads(kept.read_text()) if kept.exists() else {}
    for vehicle in [] if given.table else given.vehicles or VEHICLES:
        name = str(Path(vehicle).resolve()) if vehicle.endswith((".yaml", ".yml")) else vehicle
        bare = Bench(name, given.out.resolve() / Path(vehicle).stem, "1-3")
        for device in given.devices.split(",") if given.devices else devices_of(name):
            row, case = cells.setdefault(name, {}).setdefault(device, {}), Case(bare, device)
            for step in given.steps.split(","):
                if step in row and not given.again:
                    continue
                try:
                    row[step] = STEPS[step](case)
                except (RovtwinError, RuntimeError) as error:
                    row[step] = {"failed": f"{type(error).__name__}: {error}"[:400]}
                kept.write_text(json.dumps(cells, indent=1))
                print(f"{Path(vehicle).stem:18} {device:16} {step:10} {json.dumps(row[step])[:300]}", flush=True)
    print(table(cells))


if __name__ == "__main__":
    main()
