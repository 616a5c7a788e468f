"""The contract of evidence of one's own: as many numbers as were measured, pure, compiled the same, with a gradient."""

from typing import Any

import numpy as np

from rovtwin.core.errors import RovtwinError
from rovtwin.core.numerics import jax, jnp
from rovtwin.identification.identify import default_free
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.identification.own_evidence import OwnEvidence, numbers_of, predicted

STEP = 1e-5  # of theta, for the gradient by differences
TOLERANCE = 1e-3  # between that and the derivative, as a share of the largest


def check_evidence(evidence: OwnEvidence, vehicle: Any = "double_blueye") -> None:
    """Hold evidence to what an estimate needs of it, at a vehicle's model and around it.

    Args:
        evidence: Made, with what was measured.
        vehicle: Whose model predicts it, as of `rovtwin.load_vehicle`.

    Raises:
        AssertionError: It breaks a clause.
    """
    from rovtwin.api import load_vehicle

    assert isinstance(evidence, OwnEvidence), f"found {type(evidence).__name__}, expected an OwnEvidence"
    name = type(evidence).__name__
    one = load_vehicle(vehicle)
    everything = catalogue(one)
    parameters = choose(everything, default_free(everything, []))
    try:
        measured, _ = numbers_of(evidence, parameters.model, name)
    except RovtwinError as error:
        raise AssertionError(str(error)) from error
    first = np.asarray(predicted(evidence, parameters.model))
    again = np.asarray(predicted(evidence, parameters.model))
    assert np.array_equal(first, again), f"{name}.predict gives {first}, then {again}: it has to be a function alone"
    _compiles(evidence, parameters, measured)
    _has_a_gradient(evidence, parameters)


def _compiles(evidence: OwnEvidence, parameters: Parameters, measured: np.ndarray) -> None:
    """The same compiled, and of the same shape while it is traced."""
    name = type(evidence).__name__
    try:
        found = jax.jit(lambda model: predicted(evidence, model))(parameters.model)
    except Exception as error:  # of somebody else's code: anything
        raise AssertionError(
            f"{name}.predict cannot be compiled: {type(error).__name__}: {str(error).splitlines()[0]}. Use jax.numpy; "
            "in place of an `if` on an array jnp.where"
        ) from error
    assert found.shape == measured.shape, f"{name}.predict gives {found.shape} compiled, expected {measured.shape}"
    plain = predicted(evidence, parameters.model)
    assert np.allclose(found, plain, rtol=1e-9), f"{name}.predict gives {found} compiled, {plain} otherwise"


def _has_a_gradient(evidence: OwnEvidence, parameters: Parameters) -> None:
    """Finite, that of differences, and of some parameter not zero: else it tells nothing."""
    name = type(evidence).__name__
    try:
        residuals = static_evidence(parameters, [evidence])
    except RovtwinError as error:
        raise AssertionError(str(error)) from error
    assert residuals is not None
    theta = np.zeros(len(parameters.names))
    jacobian = np.asarray(jax.jit(jax.jacfwd(residuals))(jnp.asarray(theta)))
    bad = [n for n, column in zip(parameters.names, jacobian.T, strict=True) if not np.isfinite(column).all()]
    assert not bad, f"{name}.predict has a gradient that is no number, by {', '.join(bad[:4])}"
    largest = np.abs(jacobian).max()
    assert largest > 0, f"{name}.predict depends on none of the parameters, {parameters.names[0]}, ..: it tells nothing"
    compiled = jax.jit(residuals)
    for i, parameter in enumerate(parameters.names):
        ahead, behind = (np.asarray(compiled(jnp.asarray(theta).at[i].add(sign * STEP))) for sign in (1.0, -1.0))
        differs = np.abs((ahead - behind) / (2.0 * STEP) - jacobian[:, i]).max()
        assert differs <= TOLERANCE * largest, (
            f"{name}.predict: its derivative by {parameter} differs from that by differences by {differs:.3g} of "
            f"{largest:.3g}: it is not differentiable there, or holds something back from JAX"
        )
