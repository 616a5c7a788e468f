"""Do the intervals hold the truth? Many synthetic campaigns, each with a truth of its own drawn from the prior.

    python -m tests.identification.calibration --campaigns 200 --jobs 2 --out coverage.json
    python -m tests.identification.calibration --vehicles all --campaigns 50 --wrong

A campaign: 60 s of held commands, read with noise and positions of 3 cm at 15 Hz, and one pull on a scale, 2 % wide.
The Double Blueye's are random, on every thruster; a vehicle that would tumble by that is pushed along one to three
directions at a time. The errors of the pulls are drawn in strata, one from each of as many equal parts of the normal
distribution as there are campaigns: all forces share this one error, which would make the pooled share jump by 1.5 %
from one set of 200 seeds to the next. Everything is compiled once per process.

With --wrong the plant does what the model lacks (see `broken.drawn`): thrust is lost to the inflow, drag is late,
a tether pulls, the water moves, and the sensors are mounted askew. In either case commands are late by what the prior
says. What a parameter truly is
stays what it is without all that.

Left out, as no test anybody would hand in: logs in which the vehicle tumbles over or leaves at speed (a choice by the
readings, which a posterior does not mind), truths whose thrust curve is vertical at its dead band (exponent below
1: its intervals are no normal distribution; with data, the prior's other half hardly matters), and truths damped so
heavily that they stop within one step of the simulation.
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
from scipy.stats import norm
from tests.identification import broken
from tests.identification.synthetic import STEP, full_pull, steps_command

from rovtwin.identification.diagnostics.reliance import doubts_about
from rovtwin.identification.diagnostics.whiteness import residual_analysis
from rovtwin.identification.identify import default_free
from rovtwin.identification.joint.estimate import estimate
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.parameters import INFLOW, MOUNTING
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.problem import Problem
from rovtwin.identification.joint.solver.segments import cut
from rovtwin.identification.joint.solver.shooting import Shooting
from rovtwin.vehicle import load_vehicle, vehicle_from_dict

DURATION, PULL = 60.0, 0.02
TILT, AWAY = np.deg2rad(75.0), 30.0  # [rad], [m]: beyond, a log is left out
GRID = Options.read({}).grid(DURATION)
# 4 kg and 1.4 m/s: nothing of it is in the library.
_CORNER = {"force": 14.0, "curve": {"power": 1.8}, "time_constant": 0.06}
SMALL_AND_FAST = {
    "name": "small_and_fast",
    "mass": 4.0,
    "volume": 0.00402,
    "center_of_buoyancy": [0.0, 0.0, -0.02],
    "shape": {"box": [0.34, 0.22, 0.16], "drag_coefficient": [0.6, 0.9, 0.9]},
    "thrusters": [
        {"name": f"{end}_{side}", "position": [x, y, 0.0], "direction": {"azimuth_deg": a}, **_CORNER}
        for end, side, x, y, a in (
            ("bow", "port", 0.12, -0.08, 40),
            ("bow", "starboard", 0.12, 0.08, -40),
            ("stern", "port", -0.12, -0.08, 140),
            ("stern", "starboard", -0.12, 0.08, -140),
        )
    ]
    + [
        {"name": f"{side}_heave", "position": [0.0, y, 0.0], "direction": [0, 0, 1], **_CORNER}
        for side, y in (("port", -0.09), ("starboard", 0.09))
    ],
}
# Share of full command; beyond it many of a prior's vehicles tumble.
LARGEST = {"bluerov2_heavy": 0.4, "gladius_mini": 0.4, "small_and_fast": 0.4}
VEHICLES = ("double_blueye", "bluerov2_heavy", "gladius_mini", "small_and_fast")


def vehicle_of(name):
    return vehicle_from_dict(SMALL_AND_FAST, name) if name == "small_and_fast" else load_vehicle(name)


def pulls(count):
    """Errors of the pulls in standard deviations, one from each stratum, in random order, shape (count,)."""
    rng = np.random.default_rng(1)
    return rng.permutation(norm.ppf((np.arange(count) + rng.uniform(size=count)) / count))


def commands(vehicle, seed, duration):
    """Held commands, shape (m, n), and when each begins."""
    if vehicle.name == "double_blueye":
        return steps_command(vehicle, seed, duration)
    return broken.axis_steps(vehicle, seed, duration, hold=2.0, largest=LARGEST.get(vehicle.name, 1.0))


def flown(parameters, L, command, seed, duration=DURATION, wrong=False):
    """A truth from the prior, its model, and its log."""
    rng = np.random.default_rng(10_000 + seed)
    exponents = [i for i, name in enumerate(parameters.names) if name.endswith(".exponent")]
    base = np.array([parameters.free[i].base for i in exponents])
    while True:
        truth = L @ rng.standard_normal(len(parameters))
        losses = [i for i, name in enumerate(parameters.names) if name.endswith(f".{INFLOW}")]
        truth[losses] = 0.0 if wrong else np.abs(truth[losses])  # no propeller gains by an inflow
        if np.any(base * np.exp(truth[exponents]) < 1.0):
            continue
        model, extras = parameters.model_at(truth)
        if np.abs(np.linalg.eigvals(np.linalg.solve(model.inertia, model.linear_damping_ahead))).max() > 1.0 / STEP:
            continue
        lacking = broken.drawn(model, rng) if wrong else broken.Broken()
        if wrong:
            truth[losses] = lacking.thrust_loss  # the same at full force; in proportion to the force, not to its root
        if extras.delay is not None:
            # What is simulated has steps.
            truth[parameters.names.index("commands.delay")] = delay = STEP * np.round(float(extras.delay) / STEP)
            lacking = replace(lacking, delay=delay)
        mounted = [i for i, name in enumerate(parameters.names) if name in MOUNTING]
        if wrong:
            truth[mounted] = lacking.askew
        elif mounted:
            lacking = replace(lacking, askew=tuple(truth[mounted]))
        log = broken.record(model, lacking, *command, duration, seed, signals=broken.SIGNALS)
        tilt = np.abs(log.signals["attitude"].value[:, :2]).max()
        away = np.ptp(log.signals["horizontal"].value, axis=0).max(), np.ptp(log.signals["depth"].value)
        if tilt < TILT and max(away) < AWAY:
            return truth, model, log


def campaigns(seeds, errors, name="double_blueye", wrong=False, inflow=False):
    """Of each campaign in turn: z = (estimate - truth) / standard deviation of every parameter, shape (n,), their
    names, and whether the result is not to be relied on."""
    vehicle = vehicle_of(name)
    everything = catalogue(vehicle)
    parameters = choose(everything, [*default_free(everything, [], inflow), "commands.delay", *MOUNTING])
    prior = default_prior(parameters, vehicle)
    L = np.linalg.cholesky(prior.covariance)
    shooting = None
    for seed in seeds:
        truth, model, log = flown(parameters, L, commands(vehicle, seed, DURATION), seed, wrong=wrong)
        segments = cut([log], GRID)
        if shooting is None:
            shooting = Shooting(parameters, segments)
        shooting.segments = segments
        full = full_pull(model)
        pull = {"direction": "surge", "force": full * (1 + PULL * errors[seed]), "sd": PULL * full}
        problem = Problem(shooting, prior, static_evidence(parameters, [{"bollard": pull}]))
        solution = estimate(problem)
        doubt = bool(doubts_about(solution, problem, residual_analysis(problem, solution), []))
        z = (solution.unknowns.theta - truth) / np.sqrt(np.diag(solution.covariance))
        print(
            f"{name} {seed}: {solution.steps} steps{', not to be relied on' if doubt else ''}, inside "
            f"{np.mean(np.abs(z) < 1.96):.0%}, rms z {np.sqrt(np.mean(z**2)):.2f}, "
            f"wider by {np.median(solution.widening):.2f}",
            flush=True,
        )
        yield z, parameters.names, doubt


def several(*arguments):
    """All campaigns of one process: z, shape (campaigns, n), names, and doubts, shape (campaigns,)."""
    z, names, doubts = zip(*campaigns(*arguments), strict=True)
    return np.array(z), names[0], np.array(doubts)


def coverage(z, names, doubts):
    """Share of 95 % intervals that hold the truth: pooled, and per parameter; of results that nothing speaks against.

    `rovtwin identify` writes no file of the others.
    """
    every, z = np.abs(z) < 1.96, z[~doubts]
    held = np.abs(z) < 1.96
    return {
        "campaigns": len(every),
        "not_to_be_relied_on": int(doubts.sum()),
        "pooled_with_these": float(every.mean()),
        "pooled": float(held.mean()) if len(z) else None,
        "rms_z": float(np.sqrt(np.mean(z**2))) if len(z) else None,
        "parameters": {n: float(h) for n, h in zip(names, held.mean(axis=0), strict=True)},
        "bias": {n: float(b) for n, b in zip(names, z.mean(axis=0), strict=True)},
        "spread": {n: float(b) for n, b in zip(names, np.sqrt(np.mean(z**2, axis=0)), strict=True)},
    }


def run(count, jobs=2, name="double_blueye", wrong=False, inflow=False):
    """Coverage over `count` campaigns on `jobs` processes."""
    seeds, errors = [range(job, count, jobs) for job in range(jobs)], pulls(count)
    if jobs == 1:
        parts = [several(seeds[0], errors, name, wrong, inflow)]
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            parts = list(pool.map(several, seeds, [errors] * jobs, [name] * jobs, [wrong] * jobs, [inflow] * jobs))
    z, doubts = (np.concatenate([part[i] for part in parts]) for i in (0, 2))
    return coverage(z, parts[0][1], doubts) | {"z": z.round(4).tolist(), "doubts": doubts.tolist()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=200, help="of each vehicle")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--vehicles", default="double_blueye", help="'all', or names separated by commas")
    parser.add_argument("--wrong", action="store_true", help="the plant does what the model lacks")
    parser.add_argument("--inflow", action="store_true", help="what an inflow takes of the thrust is estimated, too")
    parser.add_argument("--out", default="")
    args = parser.parse_args()
    found = {}
    for name in VEHICLES if args.vehicles == "all" else args.vehicles.split(","):
        begin = time.perf_counter()
        found[name] = run(args.campaigns, args.jobs, name, args.wrong, args.inflow)
        found[name]["minutes"] = (time.perf_counter() - begin) / 60
        print(json.dumps({key: what for key, what in found[name].items() if key != "z"}, indent=1), flush=True)
        if args.out:
            with open(args.out, "w", encoding="utf-8") as file:
                json.dump(found, file)


if __name__ == "__main__":
    main()
