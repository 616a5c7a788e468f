"""Evidence of one's own: what somebody measured beside the logs, and what a model says of it.

It is named in an evidence file by an address or an entry point of `rovtwin.evidence`, or handed over in Python.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped
from numpy.typing import ArrayLike
from pydantic import ConfigDict

from rovtwin.core.errors import ConfigError, IdentificationError
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.plugins import EVIDENCE, load, origin
from rovtwin.core.user_files.config import Strict, parse
from rovtwin.vehicle.physics.model import Model


class OwnEvidence(Strict):
    """A kind of evidence: its fields are what was measured, its `predict` what a model says of it.

    Residuals are `(predict(model) - measured()) / deviation()`; the estimate takes them as independent and normal, with
    standard deviation 1. Fields are checked as those of every file: an unknown key, a text for a number is an error.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def predict(self, model: Model) -> Float[Array, " k"]:
        """What the model says of it, an array or a number; JAX, differentiable in all arrays of the model."""
        raise NotImplementedError(f"{type(self).__name__}.predict")

    def measured(self) -> ArrayLike:
        """What was measured, shape (k,) or a number, in the unit of `predict`."""
        raise NotImplementedError(f"{type(self).__name__}.measured")

    def deviation(self) -> ArrayLike:
        """Standard deviation of what was measured, shape (k,) or a number, in the same unit."""
        raise NotImplementedError(f"{type(self).__name__}.deviation")


def found_kind(kind: Any, settings: Mapping[str, Any], where: str) -> OwnEvidence:
    """The evidence that an address or entry point and its settings make, or one that is made.

    Raises:
        ConfigError: It cannot be found, nobody consented to run it, it is none, or its settings are wrong.
    """
    if isinstance(kind, OwnEvidence):
        return kind
    target, label = load(str(kind), EVIDENCE, where), f"{where}: {kind}"
    if not (isinstance(target, type) and issubclass(target, OwnEvidence)):
        found = f"the class {target.__name__}" if isinstance(target, type) else type(target).__name__
        raise ConfigError(
            f"{label}: found {found}, expected a class of rovtwin.identification.own_evidence.OwnEvidence"
        )
    return parse(target, dict(settings), label)


def numbers_of(
    evidence: OwnEvidence, model: Model, where: str
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """What was measured and its standard deviation, once a model has shown that all fits together.

    Raises:
        IdentificationError: Code of somebody else fails, or what it gives has another shape or is no number.
    """
    name = type(evidence).__name__

    def asked(method: str, *given: Any) -> Shaped[np.ndarray, "..."]:
        try:
            found = np.atleast_1d(np.asarray(getattr(evidence, method)(*given), dtype=float))
        except Exception as error:  # of somebody else's code: anything
            raise IdentificationError(f"{where}: {name}.{method} failed: {type(error).__name__}: {error}") from error
        if found.ndim != 1 or not np.isfinite(found).all():
            raise IdentificationError(
                f"{where}: {name}.{method} gave {found.tolist()!s:.80}, expected finite numbers of shape (k,)"
            )
        return found

    measured, deviation, predicted = asked("measured"), asked("deviation"), asked("predict", model)
    if not (deviation > 0).all():
        raise IdentificationError(f"{where}: {name}.deviation gave {deviation.tolist()}, expected numbers above 0")
    if predicted.shape != measured.shape or deviation.shape not in ((1,), measured.shape):
        raise IdentificationError(
            f"{where}: {name}: found {len(predicted)} predicted, {len(measured)} measured and {len(deviation)} "
            "standard deviations, expected as many of each"
        )
    return measured, np.broadcast_to(deviation, measured.shape)


def require_differentiable(
    evidence: OwnEvidence, model_at: Callable[[Array], Model], n: int, count: int, where: str
) -> None:
    """Trace what is predicted and its derivative by the n parameters, as the estimate will; nothing is computed.

    Args:
        evidence: Of which `numbers_of` is sound.
        model_at: The model at n parameters.
        n: Number of parameters.
        count: Of what was measured.
        where: For messages.

    Raises:
        IdentificationError: It cannot be traced, or has another shape then.
    """
    name = type(evidence).__name__

    def value(theta: Float[Array, " n"]) -> Float[Array, "..."]:
        return predicted(evidence, model_at(theta))

    try:
        traced, _ = jax.eval_shape(lambda theta: (value(theta), jax.jacfwd(value)(theta)), jnp.zeros(n))
    except Exception as error:  # of somebody else's code: anything
        first = (str(error).splitlines() or [""])[0]
        raise IdentificationError(
            f"{where}: {name}.predict cannot be differentiated by JAX: {type(error).__name__}: {first.rstrip('.')}. "
            "Use jax.numpy; in place of an `if` on an array jnp.where"
        ) from error
    if traced.shape != (count,):
        raise IdentificationError(
            f"{where}: {name}.predict gives shape {traced.shape} compiled, ({count},) otherwise, expected the same"
        )


def predicted(evidence: OwnEvidence, model: Model) -> Float[Array, " k"]:
    """What a model says of it, also while it is traced."""
    return jnp.atleast_1d(jnp.asarray(evidence.predict(model), float))


def about_own(anchors: Any) -> list[str]:
    """Which code of one's own an estimate rests on, a line each."""
    lines = []
    for one in anchors:
        kind = one.get("kind") if isinstance(one, Mapping) else one
        if isinstance(kind, str):
            code = origin(kind, EVIDENCE)
            lines.append(f"evidence of one's own: {kind} ({code.get('package') or code.get('sha256', '')[:12]})")
        elif isinstance(kind, OwnEvidence):
            lines.append(f"evidence of one's own: {type(kind).__module__}:{type(kind).__name__}")
    return lines
