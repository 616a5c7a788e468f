"""What is known of a vehicle before a test, and vehicles as it may truly be."""

import numpy as np

from rovtwin.core.numerics import jax
from rovtwin.identification.experiment.information import with_anchors
from rovtwin.identification.identify import default_free
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.gaussian import Gaussian, root_of
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.result.payload import prior_from
from rovtwin.scenario.schema.experiment import AXES
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.physics.actuation import wrench_limits

BOLLARD = 0.02  # full thrust is known to, before the test


def what_is_known(vehicle: Vehicle, bollard: float | None = BOLLARD) -> tuple[Parameters, Gaussian]:
    """Parameters that a test could tell, and what is known of them before.

    Args:
        vehicle: As it is assumed to be.
        bollard: Standard deviation of the full thrust in surge, sway and heave, as a share of it, from a pull on a
            scale (thesis table 3.1); None: nobody pulled, and no motion tells the scale of all forces.
    """
    everything = catalogue(vehicle)
    parameters = choose(everything, default_free(everything, []))
    prior = default_prior(parameters, vehicle)
    if vehicle.file.identified is not None:
        prior = prior_from(vehicle, parameters, prior, None)
    if bollard is None:
        return parameters, prior
    full = np.asarray(wrench_limits(parameters.model.thrusters)[1])
    pulls = [
        {"bollard": {"direction": axis, "command": 1.0, "force": float(force), "sd": float(bollard * force)}}
        for axis, force in zip(AXES[:3], full, strict=False)
        if force > 0
    ]
    return parameters, with_anchors(parameters, prior, pulls)


def drawn_models(parameters: Parameters, prior: Gaussian, count: int, seed: int) -> list[Model]:
    """Models of vehicles that are drawn from what is known."""
    root = root_of(prior.covariance)
    thetas = prior.mean + np.random.default_rng(seed).standard_normal((count, len(parameters))) @ root.T
    model_at = jax.jit(lambda theta: parameters.model_at(theta)[0])
    return [model_at(theta) for theta in thetas]
