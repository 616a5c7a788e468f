"""The payload swap: how well the parts predict a change, and what five minutes of tests add to an old identification.

    python -m tests.identification.swap --seeds 1 2 3

A Double Blueye drawn from the prior is identified from 15 minutes of tests and one pull of 2 %. Then 2.5 kg are
bolted on, off centre. What it really changes does not come from the formulas that predict it: added mass is the panel
method's difference of both shapes with all its couplings, drag and its couplings are the formula's times log-normal
factors of 1.5 with 3 % of the whole on top, and its volume is off by 3 %. Compared are the prediction without any test,
5 minutes with the old result as prior, and 15 minutes and a pull without it.
"""

import argparse
import json

import numpy as np
from tests.identification.calibration import flown
from tests.identification.synthetic import full_pull, record, steps_command

from rovtwin.identification.identify import default_free, identify
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.couplings import share_of
from rovtwin.identification.joint.model.parameters import DAMPINGS, DIRECTIONS
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.result.payload import predicted_change
from rovtwin.identification.priors.mesh_file import mesher_of
from rovtwin.identification.priors.panel import panel_added_mass
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.extent import bounding_box
from rovtwin.vehicle.constants import GRAVITY

PART = {
    "name": "camera",
    "mass": 2.5,
    "shape": {"box": [0.2, 0.12, 0.1]},
    "pose": {"position": [0.1, 0.1, 0.26]},
}
LONG, SHORT, PULL = 900.0, 300.0, 0.02
DRAG, INTERACTION, VOLUME = 0.4, 0.03, 0.03
SIDES = ("linear_damping_ahead", "quadratic_damping_ahead", "linear_damping_astern", "quadratic_damping_astern")


def with_part(vehicle, name):
    """The vehicle with the part bolted on; its `identified:` block stays out."""
    data = vehicle.to_dict()
    data.pop("identified", None)
    data["parts"].append(PART)
    return vehicle_from_dict(data, name)


def panels_of(vehicle):
    """Added mass by the panel method, shape (6, 6)."""
    return panel_added_mass(mesher_of(vehicle)).matrix


def added_mass_of(old, new, change, rng):
    """What parts really add to M_A, shape (6, 6): by the panel method; a draw where the vehicle has no shapes."""
    if bounding_box(old.file) is not None:
        return panels_of(new) - panels_of(old)
    return change.hydrodynamics["added_mass"] + np.diag(change.added_mass_std * rng.standard_normal(6))


def truly_changed(model, old, new, rng):
    """The model that parts really make of a true one."""
    change = predicted_change(old, new)
    weight = float(change.model.weight)
    was, now = old.model(), change.model
    net = float(model.buoyancy - model.weight) + float(now.buoyancy - now.weight - was.buoyancy + was.weight)
    net += VOLUME * rng.standard_normal() * change.displaced
    lever = sum(
        sign * np.asarray(m.center_of_buoyancy - m.center_of_gravity) for sign, m in ((1, model), (1, now), (-1, was))
    )
    formula = {f: np.asarray(getattr(now, f)) - np.asarray(getattr(was, f)) for f in SIDES}
    added = now.replace(
        **{f: np.asarray(getattr(model, f)) + delta for f, delta in formula.items()},
        added_mass=np.asarray(model.added_mass) + added_mass_of(old, new, change, rng),
        thrusters=model.thrusters,
        buoyancy=weight + net,
        displaced_mass=(weight + net) / GRAVITY,
        center_of_buoyancy=np.asarray(now.center_of_gravity) + lever,
    )
    everything = catalogue(new, model=added)
    # Linear damping astern acts where that ahead does, for the truth as for the estimate.
    free = choose(everything, [n for n in default_free(everything, []) if n.split(".")[0] in DAMPINGS])
    # One draw for both sides: astern is like ahead where the file says so, for the truth as for the estimate.
    draws = {p.name: np.array([DRAG, INTERACTION]) * rng.standard_normal(2) for p in free.free}
    true = {}
    for p in free.free:
        family, where = p.name.split(".")
        drag, flow = draws[p.name.replace("_astern", "")]
        if where in DIRECTIONS:
            i, field = DIRECTIONS.index(where), family if family in SIDES else f"{family}_ahead"
            own = float(np.asarray(getattr(model, field))[i, i])
            true[p.name] = own * np.exp(flow) + float(formula[field][i, i]) * np.exp(drag)
        else:
            field = family if family in SIDES else f"{family}_ahead"
            part = float(share_of(formula[field], added, p.name))
            true[p.name] = p.base + part * (np.exp(drag) - 1.0) + flow
    return free.model_at(free.thetas(true))[0]


def campaign(seed):
    """Coverage of the prediction, and widths and errors of both ways of identifying the changed vehicle."""
    vehicle = load_vehicle("double_blueye")
    new = with_part(vehicle, "double_blueye_camera")
    everything = catalogue(vehicle)
    parameters = choose(everything, default_free(everything, []))
    L = np.linalg.cholesky(default_prior(parameters, vehicle).covariance)
    truth, model, log = flown(parameters, L, steps_command(vehicle, seed, LONG), seed, LONG)
    rng = np.random.default_rng(seed)
    old = vehicle_from_dict(identify(vehicle, [log], anchors=[pull(model, rng)]).file(), "identified.yaml")
    changed = truly_changed(model, vehicle, new, rng)
    predicted = identify(new, [], old=old)
    quick = identify(new, [tested(changed, vehicle, seed, SHORT)], old=old)
    slow = identify(new, [tested(changed, vehicle, seed, LONG)], anchors=[pull(changed, rng)])
    ours = dict(zip(quick.parameters.names, quick.std, strict=True))
    theirs = dict(zip(slow.parameters.names, slow.std, strict=True))
    ratio = {name: float(ours[name] / theirs[name]) for name in theirs}
    return {
        "seed": seed,
        "predicted": errors(predicted, changed),
        "five_minutes": errors(quick, changed) | {"seconds": quick.seconds, "settled": quick.solution.converged},
        "fifteen_minutes": errors(slow, changed) | {"seconds": slow.seconds, "settled": slow.solution.converged},
        "width_over_that_of_fifteen": {"median": float(np.median(list(ratio.values()))), **ratio},
    }


def pull(model, rng):
    """A bollard pull of all thrusters that push ahead, 2 % wide."""
    full = full_pull(model)
    return {"bollard": {"direction": "surge", "force": full * (1 + PULL * rng.standard_normal()), "sd": PULL * full}}


def tested(model, vehicle, seed, duration):
    """Random held commands on all thrusters."""
    return record(model, *steps_command(vehicle, 1000 + seed, duration), duration, 1000 + seed)


def errors(found, truth):
    """Errors in standard deviations of what the model has as a number of its own."""
    true = {p.name: p.base for p in catalogue(found.vehicle, model=truth).free}
    z = {
        p.name: float((found.theta[i] - p.theta(true[p.name])) / found.std[i])
        for i, p in enumerate(found.parameters.free)
        if p.name in true
    }
    values = np.array(list(z.values()))
    return {
        "left_out": len(found.parameters) - len(z),  # couplings whose truth is near their bound or beyond
        "held": float(np.mean(np.abs(values) < 1.96)),
        "rms_z": float(np.sqrt(np.mean(values**2))),
        "outside": {name: round(v, 2) for name, v in z.items() if abs(v) > 1.96},
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    args = parser.parse_args()
    for seed in args.seeds:
        print(json.dumps(campaign(seed), indent=1), flush=True)


if __name__ == "__main__":
    main()
