"""Random learned discrepancies, and vehicle files that hold one."""

import numpy as np

from rovtwin.vehicle.description.identified import fingerprint

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


def random_part(rng, axis, of, m=5):
    """A part with m kernel functions, of which half of the variance is known, as plain data."""
    own = 6 + AXES.index(axis)
    centres, lengths = 0.5 * rng.normal(size=(m, 12)), [*rng.uniform(0.8, 2.5, 6).tolist(), *[None] * 6]
    centres[:, 6:] = 0.0
    if of == "thrust":
        centres[:, own], lengths[own] = rng.uniform(-8.0, 8.0, m), 6.0
    a = rng.normal(size=(m, 3 * m))
    covariance = 0.5 * np.linalg.inv(np.eye(m) + a @ a.T / m)
    return {
        "axis": axis, "of": of, "std": float(rng.uniform(1.0, 4.0)),
        "lengths": lengths, "centres": centres.tolist(),
        "weights": rng.normal(size=m).tolist(), "covariance": covariance.tolist(),
    }  # fmt: skip


def block(parts):
    return {"parts": parts, "speeds": [0.5, 0.4, 0.4, 0.6, 0.6, 0.8]}


def file_with(vehicle, seed=0, of=("motion", "thrust"), axes=("surge", "sway", "yaw")):
    """Data of the vehicle's file with an `identified:` block that holds its own values and a discrepancy."""
    rng, model = np.random.default_rng(seed), vehicle.model()
    matrices = {
        "added_mass": model.added_mass,
        "linear_damping": model.linear_damping_ahead,
        "linear_damping_astern": model.linear_damping_astern,
        "quadratic_damping": model.quadratic_damping_ahead,
        "quadratic_damping_astern": model.quadratic_damping_astern,
    }
    data = vehicle.to_dict()
    data["identified"] = {
        "made_with": fingerprint(vehicle.file),
        "hydrodynamics": {name: np.asarray(matrix).tolist() for name, matrix in matrices.items()},
        "restoring": {
            "net_buoyancy": float(model.buoyancy - model.weight),
            "center_of_buoyancy": np.asarray(model.center_of_buoyancy).tolist(),
        },
        "estimate": {
            "parameters": [
                {
                    "name": "added_mass.surge",
                    "unit": "kg",
                    "value": float(model.added_mass[0, 0]),
                    "base": float(model.added_mass[0, 0]),
                    "positive": True,
                    "std": 0.05,
                    "prior_std": 0.3,
                    "verdict": "learnt",
                }
            ],
            "covariance": [[0.0025]],
        },
        "discrepancy": block([random_part(rng, axis, of[i % len(of)]) for i, axis in enumerate(axes)]),
    }
    return data
