"""Do the intervals hold the truth? Many synthetic campaigns, each with a truth of its own drawn from the prior.

    python -m tests.identification.calibration --campaigns 200 --jobs 2 --out coverage.json

A campaign: 60 s of random held commands on all thrusters of the Double Blueye, read with noise and positions of 3 cm at
15 Hz, and one pull on a scale, 2 % wide. The errors of the pulls are drawn in strata, one from each of as many equal
parts of the normal distribution as there are campaigns: all forces share this one error, which would make the pooled
share jump by 1.5 % from one set of 200 seeds to the next. Everything is compiled once per process.

Left out, as no test anybody would hand in: logs in which the vehicle tumbles over or leaves at speed (a choice by the
readings, which a posterior does not mind), and truths whose thrust curve is vertical at its dead band (exponent below
1: its intervals are no normal distribution; with data, the prior's other half hardly matters).
"""

import argparse
import json
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from scipy.stats import norm
from tests.identification.synthetic import record, steps_command

from rovtwin.identification.identify import default_free
from rovtwin.identification.joint.anchors import static_evidence
from rovtwin.identification.joint.catalogue import catalogue, choose
from rovtwin.identification.joint.estimate import estimate
from rovtwin.identification.joint.prior import default_prior
from rovtwin.identification.joint.problem import Problem
from rovtwin.identification.joint.segments import Grid, cut
from rovtwin.identification.joint.shooting import Shooting
from rovtwin.vehicle import load_vehicle

DURATION, PULL = 60.0, 0.02
TILT, AWAY = np.deg2rad(75.0), 30.0  # [rad], [m]: beyond, a log is left out
GRID = Grid(0.02, 250, 20.0)


def pulls(count):
    """Errors of the pulls in standard deviations, one from each stratum, in random order, shape (count,)."""
    rng = np.random.default_rng(1)
    return rng.permutation(norm.ppf((np.arange(count) + rng.uniform(size=count)) / count))


def flown(parameters, L, command, seed, duration=DURATION):
    """A truth from the prior, its model, and its log."""
    rng = np.random.default_rng(10_000 + seed)
    exponents = [i for i, name in enumerate(parameters.names) if name.endswith(".exponent")]
    base = np.array([parameters.free[i].base for i in exponents])
    while True:
        truth = L @ rng.standard_normal(len(parameters))
        if np.any(base * np.exp(truth[exponents]) < 1.0):
            continue
        model, _ = parameters.model_at(truth)
        log = record(model, *command, duration, seed)
        tilt = np.abs(log.signals["attitude"].value[:, :2]).max()
        away = np.ptp(log.signals["horizontal"].value, axis=0).max(), np.ptp(log.signals["depth"].value)
        if tilt < TILT and max(away) < AWAY:
            return truth, model, log


def campaigns(seeds, errors):
    """z = (estimate - truth) / standard deviation of every parameter, shape (campaigns, n), and their names."""
    vehicle = load_vehicle("double_blueye")
    everything = catalogue(vehicle)
    parameters = choose(everything, default_free(everything, []))
    prior = default_prior(parameters, vehicle)
    L = np.linalg.cholesky(prior.covariance)
    shooting, rows = None, []
    for seed in seeds:
        truth, model, log = flown(parameters, L, steps_command(vehicle, seed, DURATION), seed)
        segments = cut([log], GRID)
        if shooting is None:
            shooting = Shooting(parameters, segments)
        shooting.segments = segments
        full = 2 * float(model.thrusters.force_ahead[0])
        pull = {"direction": "surge", "force": full * (1 + PULL * errors[seed]), "sd": PULL * full}
        solution = estimate(Problem(shooting, prior, static_evidence(parameters, [{"bollard": pull}])))
        std = np.sqrt(np.diag(solution.covariance))
        rows.append((solution.unknowns.theta - truth) / std)
        print(f"campaign {seed}: {solution.steps} steps, rms z {np.sqrt(np.mean(rows[-1] ** 2)):.2f}", flush=True)
    return np.array(rows), parameters.names


def coverage(z, names):
    """Share of 95 % intervals that hold the truth: pooled, and per parameter."""
    held = np.abs(z) < 1.96
    return {
        "campaigns": len(z),
        "pooled": float(held.mean()),
        "rms_z": float(np.sqrt(np.mean(z**2))),
        "parameters": {n: float(h) for n, h in zip(names, held.mean(axis=0), strict=True)},
        "bias": {n: float(b) for n, b in zip(names, z.mean(axis=0), strict=True)},
        "spread": {n: float(b) for n, b in zip(names, np.sqrt(np.mean(z**2, axis=0)), strict=True)},
    }


def run(count, jobs=2):
    """Coverage over `count` campaigns on `jobs` processes."""
    seeds, errors = [range(job, count, jobs) for job in range(jobs)], pulls(count)
    if jobs == 1:
        parts = [campaigns(seeds[0], errors)]
    else:
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            parts = list(pool.map(campaigns, seeds, [errors] * jobs))
    z = np.concatenate([z for z, _ in parts])
    return coverage(z, parts[0][1]) | {"z": z.round(4).tolist()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", default="")
    args = parser.parse_args()
    begin = time.perf_counter()
    found = run(args.campaigns, args.jobs) | {"minutes": (time.perf_counter() - begin) / 60}
    print(json.dumps({name: what for name, what in found.items() if name != "z"}, indent=1))
    if args.out:
        with open(args.out, "w", encoding="utf-8") as file:
            json.dump(found, file)


if __name__ == "__main__":
    main()
