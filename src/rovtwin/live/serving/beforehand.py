"""What to know before a served vehicle is flown: from which share of the stick on it tips, and the line to fly it."""

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from rovtwin.links import registry
from rovtwin.links.servers.server import Server
from rovtwin.vehicle import Model
from rovtwin.vehicle.analysis.stability import by_products, hang, stability, steady_speed

LEANS = np.radians(20.0)  # roll or pitch by thrust beside CG that counts as tipping [rad]
PLAIN = "lawnmower_calm"  # scenario whose world a vehicle swims in that is served by its name
SHARES = np.linspace(0.01, 1.0, 100)  # of a stick
Given = Callable[[int, float], float]
"""Share of the largest force that a stick gives: axis, share of the stick."""


class Tips(NamedTuple):
    """From where on a vehicle tips.

    Attributes:
        axis: 0: surge, 1: sway.
        share: Of the stick.
        speed: That it comes to then [m/s].
        leans: Whether its thrust tilts it, for it acts beside CG; else Munk's moment does at that speed.
    """

    axis: int
    share: float
    speed: float
    leans: bool


def linear(axis: int, share: float) -> float:
    """A stick that asks for a share of the force."""
    return share


def tipping(model: Model, largest: Float[np.ndarray, "6"], given: Given = linear) -> Iterator[Tips]:
    """The least share of a stick, ahead and sideways, at which pitch or roll does not stay small; nothing below full.

    Args:
        model: The vehicle.
        largest: Wrench along each axis that a full stick may give [N, N m].
        given: What a share of the stick gives.
    """
    steady, rights = stability(model), hang(model).stiffness
    levels = (min(steady.pitch_depth_held, steady.pitch_free), steady.roll_static)
    for axis, (level, angle) in enumerate(zip(levels, (1, 0), strict=True)):
        arm = abs(float(by_products(model)[angle, axis]))
        for share in SHARES:
            force = float(largest[axis]) * given(axis, float(share))
            speed = steady_speed(model, axis, force)
            moment = arm * force
            leans = moment > np.sin(LEANS) * max(float(rights[angle]), 0.0) and moment > 0.0
            if force > 0.0 and np.isfinite(speed) and (leans or speed > level):
                yield Tips(axis, float(share), speed, leans)
                break


def warnings(model: Model, largest: Mapping[str, Float[np.ndarray, "6"]], given: Given = linear) -> list[str]:
    """Lines of `tipping`, of all drones of a vehicle together."""
    whole = np.sum([np.asarray(one) for one in largest.values()], axis=0)
    lines = []
    for one in tipping(model, whole, given):
        way, what = (("ahead", "pitch"), ("sideways", "roll"))[one.axis]
        why = "its thrust acts beside CG" if one.leans else "Munk's moment"
        lines.append(
            f"held at {100 * one.share:.0f} % of the stick {way} or more it tips in {what} ({why}, {one.speed:.2g} "
            "m/s), unless something holds it level: use less, or raise BG"
        )
    return lines


def stick_of(servers: Iterable[Server]) -> Given:
    """What a stick gives by the protocol that steers: by MAVLink axes are linear in the command, times the gain."""
    one: Any = next((one for one in servers if getattr(one, "mixer", None) is not None), None)
    if one is None:
        return linear
    return lambda axis, share: float(np.abs(one.mixer.motion(one.gain * share * np.eye(6)[axis])[axis]))


def command_line(what: str, is_vehicle: bool, servers: Mapping[str, Server]) -> str:
    """The command that flies what these servers speak for; empty where none of them takes orders.

    Args:
        what: Vehicle or scenario as it was given.
        is_vehicle: Which of them.
        servers: Of `protocols.servers_of`, by protocol.
    """
    spoken = [(one, servers[one.scheme]) for one in registry.endpoints() if one.scheme in servers]
    steered = [(one, server) for one, server in spoken if one.link is not None]
    if not steered:
        return ""
    endpoint, server = steered[0]
    scenario = f"{PLAIN} --set {shlex.quote(f'vehicle={what}')}" if is_vehicle else shlex.quote(what)
    sensors = [one.reached(its) for one, its in spoken if one.source is not None]
    has_position = any(one.gives_position for one, _ in spoken)
    missing = next(one for one in registry.built_in() if one.gives_position and one.source and one.server)
    if not has_position:
        sensors.insert(0, missing.address.replace("HOST", "127.0.0.1"))
    link = shlex.quote(endpoint.reached(server))
    words = f"rovtwin console {scenario} --link {link}{''.join(f' --sensor {shlex.quote(url)}' for url in sensors)}"
    hint = f" (an autopilot needs positions: add --protocol {missing.scheme} to this serve)"
    return f"{endpoint.environment(server)}{words}" + ("" if has_position else hint)
