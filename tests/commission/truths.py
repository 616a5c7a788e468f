"""Vehicles that are not quite as they are described: drawn from what is known of them before any test."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from rovtwin.identification.identify import Identification, identify
from rovtwin.identification.joint.result.overlay import to_yaml
from rovtwin.vehicle import load_vehicle


def hidden_truth(name: str, seed: int, path: Path, share: float = 0.5) -> Identification:
    """A truth as far from the description as a draw of the prior, times `share`; its file is written to the path.

    Dead bands, delays, mountings and the couplings stay as they are described.
    """
    predicted = identify(load_vehicle(name), ())
    theta = share * predicted.sampled(1, seed)[0]
    kept = ("linear_damping.", "quadratic_damping.", "added_mass.", "thrusters.")
    for i, p in enumerate(predicted.parameters.free):
        coupling = "_" in p.name.rpartition(".")[2] and not p.name.startswith("thrusters.")
        if not p.name.startswith(kept) or coupling or "dead_band" in p.name:
            theta[i] = 0.0
    truth = replace(predicted, theta=np.asarray(theta))
    path.write_text(to_yaml(truth.file(), "a test"), encoding="utf-8")
    return truth
