"""How well a known Double Blueye is found again: our joint estimate and the thesis's method on the same logs.

    python -m tests.identification.recovery --seeds 1 2 3

The twin flies the thesis's own protocol (`test_steps_thesis`: steps in surge, sway, heave and yaw, releases in roll and
pitch) with the noise of table 5.7 and positions of 3 cm at 15 Hz. The truth is drawn around the library's vehicle and
has thrust ~ a^1.75; the estimate starts from linear thrust, as the thesis assumed, and from one pull on a scale of 2 %.
"""

import argparse
import json
import time
from fnmatch import fnmatchcase

import numpy as np

from rovtwin.identification.identify import default_free, identify
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.couplings import BOTH_WAYS, SKEW
from rovtwin.identification.joint.model.parameters import DIRECTIONS
from rovtwin.identification.steady.free_running import NU, free_running
from rovtwin.planning.records import experiment_records
from rovtwin.runs.loop import stack
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.physics.dynamics import damping_wrench
from rovtwin.vehicle.physics.thrusters import static_force

EXPONENT, PULL = 1.75, 0.02
# The first pattern that fits counts. Couplings are shares: 0.05 is a lever of one or two centimetres.
SPREAD = {f"added_mass.{name}": 0.02 for name in SKEW} | {
    f"*.{name}": 0.02 for name in BOTH_WAYS if min(BOTH_WAYS[name]) > 2
}
SPREAD |= {"*.*_*": 0.05, "added_mass.*": 0.25, "linear_damping*": 0.4, "quadratic_damping*": 0.25}


def with_thrust(vehicle, curve):
    """The same vehicle with another thrust curve on every thruster, without dead band."""
    data = vehicle.to_dict()
    for part in data["parts"]:
        for thruster in part.get("thrusters", []):
            thruster |= {"curve": curve, "dead_band": 0.0}
    return vehicle_from_dict(data, vehicle.name)


def truth_of(seed):
    """A Model around the library's vehicle, with thrust ~ a^1.75."""
    true = catalogue(with_thrust(load_vehicle("double_blueye"), {"power": EXPONENT}))
    # Astern follows ahead where the vehicle's file says so: the vehicle is one that the estimate can describe.
    water = ("added_mass", "linear_damping", "quadratic_damping")
    drawn = choose(true, [name for name in default_free(true, []) if name.startswith(water)])
    rng = np.random.default_rng(seed)
    width = [next(w for pattern, w in SPREAD.items() if fnmatchcase(name, pattern)) for name in drawn.names]
    return drawn.model_at(np.array(width) * rng.standard_normal(len(width)))[0]


def force(model, axis, speeds):
    """Drag in one direction at given speeds [N, N m]."""
    return np.array([float(damping_wrench(model, v * np.eye(6)[axis])[axis]) for v in speeds])


def recovery(seed, scenario="test_steps_thesis"):
    """Errors of one recovery, in per cent."""
    truth = truth_of(seed)
    vehicle = with_thrust(load_vehicle("double_blueye"), "linear")
    records = experiment_records(load_scenario(scenario), stack([truth]), (seed,))[0]
    full = 2 * float(truth.thrusters.force_ahead[0])
    pull = full * (1 + PULL * np.random.default_rng(100 + seed).standard_normal())
    anchor = {"bollard": {"direction": "surge", "force": pull, "sd": PULL * full}}
    begin = time.perf_counter()
    found = identify(vehicle, records, anchors=[anchor])
    seconds = time.perf_counter() - begin
    model, nu = found.model(), np.abs(np.asarray(found.solution.unknowns.nodes.nu))
    fastest = np.quantile(nu, 0.98, axis=0)
    speeds = [np.linspace(0.25, 1.0, 4) * v for v in fastest]
    drag = {d: _worst(force(model, i, speeds[i]), force(truth, i, speeds[i])) for i, d in enumerate(DIRECTIONS)}
    added = np.asarray(model.added_mass).diagonal() / np.asarray(truth.added_mass).diagonal() - 1
    u = np.linspace(-1, 1, 21)[:, None] * np.ones(6)
    thrust = np.array([np.asarray(static_force(model.thrusters, x) - static_force(truth.thrusters, x)) for x in u])
    biggest = np.asarray(truth.thrusters.force_ahead)
    return {
        "seed": seed,
        "minutes_of_log": sum(r.duration for r in records) / 60,
        "seconds": seconds,
        "pull_error": 100 * (pull / full - 1),
        "drag": drag,
        "drag_thesis": thesis_drag(vehicle, records, truth, speeds),
        "added_mass": dict(zip(DIRECTIONS, (100 * added).tolist(), strict=True)),
        "thrust": float(100 * np.max(np.abs(thrust) / biggest)),
        "rms_z": float(np.sqrt(np.mean(_z(found, truth) ** 2))),
        "findings": found.findings,
    }


def _worst(found, true):
    gap = 100 * (found / true - 1)
    return float(gap[np.argmax(np.abs(gap))])


def _z(found, truth):
    """Errors in standard deviations, of the parameters that the truth has."""
    true = catalogue(with_thrust(load_vehicle("double_blueye"), {"power": EXPONENT}), model=truth)
    value = {p.name: p.base for p in true.free}
    rows = [
        (found.theta[i] - p.theta(value[p.name])) / found.std[i]
        for i, p in enumerate(found.parameters.free)
        if "dead_band" not in p.name
    ]
    return np.array(rows)


def thesis_drag(vehicle, records, truth, speeds):
    """The thesis's way: mean speeds, force linear in command, a curve through both."""
    fits = free_running(vehicle.model(), records, method="thesis").fits
    rows = {DIRECTIONS[NU.index(dof)]: (NU.index(dof), fit) for dof, fit in fits.items()}
    return {d: _worst(fit.force(speeds[i]), force(truth, i, speeds[i])) for d, (i, fit) in rows.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--scenario", default="test_steps_thesis")
    args = parser.parse_args()
    for seed in args.seeds:
        print(json.dumps(recovery(seed, args.scenario), indent=1), flush=True)


if __name__ == "__main__":
    main()
