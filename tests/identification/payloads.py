"""Does the predicted change of added mass hold what the panel method finds? Random payloads on several vehicles.

    python -m tests.identification.payloads --first 20000 --count 100

A payload (box, cylinder, sphere or ellipsoid of 0.2 to 6 kg, 0.8 to 3 times as dense as water) sits 1 to 12 cm under,
above, beside, before or behind the shapes of a vehicle. The truth is the panel method on all shapes together, on
meshes of about 1000 panels (the same panels of the vehicle with and without the payload, so that their error cancels;
panels two thirds as large change what a payload does by 2 to 10 % of it). The prediction starts from the panel
method's M_A of the vehicle alone, as if it had been identified. The widths (joint/result/interaction.py) were chosen
by seeds 0 to 99 on double_blueye, bluerov2_heavy, nosway and torpedo, and made a twelfth wider after a look at seeds
from 10000 on; seeds from 20000 on and frame250 were looked at only afterwards.
"""

import argparse
import json

import numpy as np

from rovtwin.identification.joint.result.payload import predicted_change
from rovtwin.identification.priors.mesh_file import mesher_of
from rovtwin.identification.priors.panel import panel_added_mass
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.extent import bounding_box
from rovtwin.vehicle.constants import AXES

PANELS = 700  # of the vehicle alone, about; the payload adds 150 to 500
THRUSTER = {"name": "t", "direction": [1, 0, 0], "force": 10.0}
SIDES = ((2, 1), (2, 1), (2, 1), (2, -1), (1, 1), (1, -1), (0, 1), (0, -1))  # axis and way: mostly under the vehicle


def vehicles():
    """Data of vehicles with shapes, by name: those of the fit, and frame250."""
    made_up = {
        "nosway": (6.5, [0.06, 0.11, 0.12], {"box": [0.42, 0.30, 0.20]}),
        "torpedo": (35.0, [0.13, 7.5, 7.5], {"cylinder": {"radius": 0.085, "length": 1.6}}),
        "frame250": (250.0, [22, 42, 45], {"box": [1.5, 0.9, 0.8]}),
    }
    heavy = load_vehicle("bluerov2_heavy").to_dict() | {"shape": {"box": [0.42, 0.30, 0.24]}}
    return {"double_blueye": load_vehicle("double_blueye").to_dict(), "bluerov2_heavy": heavy} | {
        name: {"name": name, "mass": mass, "inertia": inertia, "shape": shape, "thrusters": [THRUSTER]}
        for name, (mass, inertia, shape) in made_up.items()
    }


def payload(rng, vehicle):
    """A part that is bolted on somewhere."""
    mass, density = np.exp(rng.uniform(np.log([0.2, 800.0]), np.log([6.0, 3000.0])))
    part = {"name": "payload", "mass": float(mass), "shape": _shape(rng, mass / density)}
    low, high = bounding_box(vehicle.file)
    reach = bounding_box(vehicle_from_dict({"name": "payload", "parts": [part]}).file)
    gap = np.exp(rng.uniform(np.log(0.01), np.log(0.12)))
    (axis, way), at = SIDES[rng.integers(len(SIDES))], rng.uniform(low, high)
    at[axis] = high[axis] + gap - reach[0][axis] if way > 0 else low[axis] - gap - reach[1][axis]
    return part | {"pose": {"position": at.tolist()}}


def _shape(rng, volume):
    kind, sides = rng.choice(["box", "cylinder", "sphere", "ellipsoid"]), np.exp(rng.uniform(0, np.log(3), 3))
    ball = 4 / 3 * np.pi
    if kind == "box":
        shape = {"box": (sides * np.cbrt(volume / np.prod(sides))).tolist()}
    elif kind == "cylinder":
        radius = float(np.cbrt(volume / (2 * np.pi * sides[0] / sides[1])))
        shape = {"cylinder": {"radius": radius, "length": float(2 * radius * sides[0] / sides[1])}}
    elif kind == "sphere":
        shape = {"sphere": float(np.cbrt(volume / ball))}
    else:
        shape = {"ellipsoid": (sides * np.cbrt(volume / ball / np.prod(sides))).tolist()}
    return shape | {"attitude_deg": [0.0, *(float(rng.choice([0, 90, rng.uniform(-45, 45)])) for _ in range(2))]}


def campaign(data, seeds):
    """Of each payload and axis: whether the interval holds the truth; its half width; error, own value by formula.

    Returns:
        Arrays of shape (payloads, 6), by name.
    """
    alone = vehicle_from_dict(data)
    size = float(np.sqrt(mesher_of(alone).area / PANELS))
    found = panel_added_mass(mesher_of(alone), panel_size=size).matrix
    inner = data | {"hydrodynamics": {"added_mass": found.tolist()}}
    old, rows = vehicle_from_dict(inner), []
    held = {key: value for key, value in inner.items() if key != "description"} | {"name": "rov", "keeps_names": True}
    for seed in seeds:
        part = payload(np.random.default_rng(seed), alone)
        new = vehicle_from_dict({"name": "new", "parts": [held, part]})
        true = panel_added_mass(mesher_of(new), panel_size=size).matrix.diagonal()
        change = predicted_change(old, new)
        predicted = np.asarray(change.model.added_mass).diagonal()
        half = 1.96 * change.added_mass_std
        # As the prior has it: log-normal about the total.
        inside = np.abs(np.log(np.maximum(true, 1e-9) / np.maximum(predicted, 1e-9))) <= half / predicted
        rows.append((inside, half, true - predicted, change.hydrodynamics["added_mass"].diagonal(), predicted))
    return dict(zip(("held", "half", "error", "own", "total"), map(np.array, zip(*rows, strict=True)), strict=True))


def summary(found):
    """Shares and medians for people."""
    own = np.where(found["own"] > 0, found["own"], np.nan)
    by_axis = {
        "held": found["held"].mean(axis=0),
        "half_width_over_own": np.nanmedian(found["half"] / own, axis=0),
        "half_width_over_total": np.median(found["half"] / found["total"], axis=0),
        "rms_error_over_std": np.sqrt(np.mean((1.96 * found["error"] / found["half"]) ** 2, axis=0)),
    }
    return {"payloads": len(found["held"]), "held_all_six": float(found["held"].all(axis=1).mean())} | {
        key: dict(zip(AXES, np.round(value, 3).tolist(), strict=True)) for key, value in by_axis.items()
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vehicles", nargs="+", default=["double_blueye", "bluerov2_heavy", "nosway"])
    parser.add_argument("--first", type=int, default=20_000)
    parser.add_argument("--count", type=int, default=100)
    args = parser.parse_args()
    known = vehicles()
    for name in args.vehicles:
        found = summary(campaign(known[name], range(args.first, args.first + args.count)))
        print(json.dumps({"vehicle": name} | found), flush=True)


if __name__ == "__main__":
    main()
