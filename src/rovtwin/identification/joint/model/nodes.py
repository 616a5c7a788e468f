"""States at the start of segments, and errors of such states: what the shooting moves."""

from typing import Any, NamedTuple

from jaxtyping import Float

from rovtwin.core.frames import quaternion_turned, rotation_between
from rovtwin.core.numerics import Array, jnp

NODE = 18  # size of a node's error
FADES = 5.0  # time constant of a push [s]


class Nodes(NamedTuple):
    """State at the start of every segment: position (S, 3), attitude (S, 4), nu (S, 6), push (S, 6).

    A push is the part of nu_dot that the model lacks [m/s2, rad/s2], a first-order process.
    """

    position: Any
    attitude: Any
    nu: Any
    push: Any


def undisturbed(position: Any, attitude: Any, nu: Any) -> Nodes:
    """States without a push."""
    return Nodes(position, attitude, nu, 0.0 * nu)


def moved(node: Nodes, error: Float[Array, "18"]) -> Nodes:
    """A state off by an error (18,): position, nu and push by sums, attitude by a small rotation in b."""
    attitude = quaternion_turned(node.attitude, 0.5 * error[3:6])
    return Nodes(node.position + error[:3], attitude, node.nu + error[6:12], node.push + error[12:])


def difference(a: Nodes, b: Nodes) -> Float[Array, "18"]:
    """The error (18,) of a state a against b: `moved` by it, b is a to first order."""
    angle = rotation_between(a.attitude, b.attitude)
    return jnp.concatenate([a.position - b.position, angle, a.nu - b.nu, a.push - b.push])
