"""Evidence that is no motion: a bollard pull, forces of a towing test, or of one's own. It says what newtons are.

Motion alone cannot tell the common scale of thrust, mass, drag and restoring; one pull on a scale can.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.user_files.config import Number, Positive, Strict, parse
from rovtwin.identification.joint.model.parameters import DIRECTIONS, Parameters
from rovtwin.identification.joint.solver.problem import Static
from rovtwin.identification.own_evidence import OwnEvidence, found_kind, numbers_of, predicted, require_differentiable
from rovtwin.vehicle.physics.dynamics import damping_wrench, learned_wrench
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import static_force

Direction = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]


class Bollard(Strict):
    """A pull on a scale: all thrusters that push in a direction, at a share of full command."""

    direction: Direction
    command: Number = 1.0
    force: Number
    sd: Positive


class Towing(Strict):
    """Steady drag at given speeds; `force` against the motion, in the direction of positive speed positive."""

    direction: Direction
    speed: list[Number]
    force: list[Number]
    sd: Positive


class Anchor(Strict):
    """One anchor: exactly one of the kinds, or one of one's own by `kind` and its `settings`."""

    bollard: Bollard | None = None
    towing: Towing | None = None
    kind: str | None = Field(None, description="package.module:Name, or an entry point of rovtwin.evidence")
    settings: dict[str, Any] = Field({}, description="of that kind")


Predicted = Callable[[Model], Float[Array, " k"]]
AnchorLike = Mapping[str, Any] | OwnEvidence


def static_evidence(parameters: Parameters, anchors: Sequence[AnchorLike]) -> Static | None:
    """Whitened residuals of anchors, as a function of theta; None without anchors.

    Raises:
        IdentificationError: An anchor is none of a kind that is known, or no thruster pushes that way.
        ConfigError: A kind of one's own cannot be found, or its settings are wrong.
    """
    parts = [_part(parameters, data, i) for i, data in enumerate(anchors)]
    if not parts:
        return None

    def residuals(theta: Float[Array, " n"]) -> Float[Array, " k"]:
        model, _ = parameters.model_at(theta)
        return jnp.concatenate([(predict(model) - measured) / sd for predict, measured, sd in parts])

    return residuals


def _part(
    parameters: Parameters, data: AnchorLike, number: int
) -> tuple[Predicted, Float[np.ndarray, " k"], float | Float[np.ndarray, " k"]]:
    where = f"anchors[{number}]"
    if isinstance(data, OwnEvidence):
        return _own(parameters, data, where)
    anchor = parse(Anchor, dict(data), where)
    if sum(one is not None for one in (anchor.bollard, anchor.towing, anchor.kind)) != 1:
        raise IdentificationError(f"{where}: expected one of bollard, towing, kind")
    if anchor.settings and anchor.kind is None:
        raise IdentificationError(f"{where}.settings: expected none without a kind of your own")
    if anchor.kind is not None:
        return _own(parameters, found_kind(anchor.kind, anchor.settings, where), where)
    if anchor.towing is not None:
        return _towing(anchor.towing, where)
    assert anchor.bollard is not None
    return _bollard(parameters, anchor.bollard, where)


def _own(
    parameters: Parameters, evidence: OwnEvidence, where: str
) -> tuple[Predicted, Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    measured, sd = numbers_of(evidence, parameters.model, where)
    require_differentiable(
        evidence, lambda theta: parameters.model_at(theta)[0], len(parameters.names), len(measured), where
    )
    return (lambda model: predicted(evidence, model)), measured, sd


def _bollard(parameters: Parameters, pull: Bollard, where: str) -> tuple[Predicted, Float[np.ndarray, "1"], float]:
    axis = DIRECTIONS.index(pull.direction)
    row = np.asarray(parameters.model.thrusters.configuration)[axis]
    if not np.any(np.abs(row) > 1e-6):
        raise IdentificationError(f"{where}: no thruster pushes in {pull.direction}")
    if abs(pull.command) > 1:
        raise IdentificationError(f"{where}.command: found {pull.command:g}, expected -1 to 1")
    # Every thruster that helps is driven, by as much as it helps: a horizontal one at 45 degrees fully, too.
    u = jnp.asarray(pull.command * np.sign(np.where(np.abs(row) > 0.05 * np.abs(row).max(), row, 0.0)))

    def predict(model: Model) -> Float[Array, "1"]:
        tau = model.thrusters.configuration @ static_force(model.thrusters, u)
        return (tau + learned_wrench(model, jnp.zeros(6), tau))[axis][None]

    return predict, np.array([pull.force]), pull.sd


def _towing(table: Towing, where: str) -> tuple[Predicted, Float[np.ndarray, " k"], float]:
    if len(table.speed) != len(table.force) or not table.speed:
        raise IdentificationError(f"{where}: found {len(table.speed)} speeds and {len(table.force)} forces")
    axis = DIRECTIONS.index(table.direction)
    nu = jnp.zeros((len(table.speed), 6)).at[:, axis].set(jnp.asarray(table.speed))

    def predict(model: Model) -> Float[Array, " k"]:
        return jax.vmap(lambda v: (damping_wrench(model, v) - learned_wrench(model, v, jnp.zeros(6)))[axis])(nu)

    return predict, np.array(table.force), table.sd
