"""What breaks in flight: faults of thrusters, a leak, snagged tethers on a time-line, applied once a control tick.

The faults of sensors are the sensors' own (`Sensor.blackouts`, `offsets`, `frozen`), since a reading has a time of its
own. Everything here is an array: other times and sizes of as many faults compile to the same program.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.block import Block, Start
from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Flag, Index, PerThruster, PRNGKey
from rovtwin.simulation.checks import require, require_probability, require_spans, within
from rovtwin.vehicle.physics.model import Model

ThrusterFaultKind = Literal["dead", "weak", "reversed", "stuck"]


@dataclass(frozen=True)
class ThrusterFault:
    """One fault of one or more thrusters.

    Attributes:
        kind: "dead": no force. "weak": a share of the force. "reversed": the command's sign is turned round. "stuck":
            the command it had when the fault came, or `command`, whatever it is sent.
        thrusters: Their numbers.
        start: From when on [s]; it holds from the first control tick that begins then or later.
        end: Until when [s]; inf: for good.
        share: Of the force that is left, for "weak".
        command: For "stuck"; None: the one it had.
    """

    kind: ThrusterFaultKind
    thrusters: Sequence[int]
    start: float = 0.0
    end: float = np.inf
    share: float = 1.0
    command: float | None = None


class FaultInput(eqx.Module):
    """What the thrusters are sent in control tick k, an int that is never batched."""

    command: Command
    k: Index | int


class FaultOutput(eqx.Module):
    """What becomes of it.

    Attributes:
        command: What they obey.
        share: Of their force that is left.
        leak: Whether water comes in.
        snagged: Whether each tether that will ever be caught is so now, by name.
    """

    command: Command
    share: PerThruster
    leak: Flag
    snagged: dict[str, Flag]


class Faults(Block):
    """A time-line of m faults of n thrusters, of leaks and of snagged tethers.

    Faults of one thruster at the same time add up: shares multiply, two reversals cancel, and of several "stuck" the
    last one in the list counts. Its memory is the command that each thruster obeyed last.

    Attributes:
        spans: From (included) to (excluded) [s].
        thrusters: Which thrusters each fault is of.
        share: Factor on their force.
        sign: Factor on their command: 1 or -1.
        stuck: Whether the command no longer changes.
        given: Whether it is `command` then, rather than the last one.
        command: That a stuck one obeys.
        leaks: Spans with a leak [s].
        snags: By the name of a tether, spans in which it is caught [s].
    """

    spans: Float[Array, "m 2"]
    thrusters: Bool[Array, "m n"]
    share: Float[Array, " m"]
    sign: Float[Array, " m"]
    stuck: Bool[Array, " m"]
    given: Bool[Array, " m"]
    command: Float[Array, " m"]
    leaks: Float[Array, "l 2"]
    snags: dict[str, Float[Array, "_ 2"]]

    def __init__(
        self,
        thruster_count: int,
        faults: Sequence[ThrusterFault] = (),
        leaks: Sequence[tuple[float, float]] = (),
        snags: Mapping[str, Sequence[tuple[float, float]]] | None = None,
    ):
        """Of a vehicle with so many thrusters.

        Raises:
            ConfigError: A fault ends before it begins, or its numbers are none that a thruster can have.
        """
        for fault in faults:
            _check(fault, thruster_count)
        count = len(faults)
        which = np.zeros((count, thruster_count), dtype=bool)
        for row, fault in zip(which, faults, strict=True):
            row[list(fault.thrusters)] = True
        self.spans = as_array(np.reshape([(f.start, f.end) for f in faults], (count, 2)))
        self.thrusters = as_array(which, bool)
        self.share = as_array([{"dead": 0.0, "weak": f.share}.get(f.kind, 1.0) for f in faults])
        self.sign = as_array([-1.0 if f.kind == "reversed" else 1.0 for f in faults])
        self.stuck = as_array([f.kind == "stuck" for f in faults], bool)
        self.given = as_array([f.command is not None for f in faults], bool)
        self.command = as_array([0.0 if f.command is None else f.command for f in faults])
        self.leaks = as_array(np.reshape(leaks, (-1, 2)))
        self.snags = {name: as_array(np.reshape(spans, (-1, 2))) for name, spans in (snags or {}).items()}
        for name, spans in {"leaks": self.leaks, **self.snags}.items():
            require_spans(name, spans)

    def init(self, key: PRNGKey, start: Start) -> PerThruster:
        """Thrusters at rest; `key` and `start` are not used."""
        return jnp.zeros(self.thrusters.shape[1])

    def step(self, memory: PerThruster, input: FaultInput, dt: float) -> tuple[PerThruster, FaultOutput]:
        """Control tick k, from k dt on."""
        t = jnp.asarray(input.k) * dt
        active = within(self.spans, t, dt)[:, None] & self.thrusters
        u = input.command.u
        for i in range(self.stuck.shape[0]):
            u = jnp.where(active[i] & self.stuck[i], jnp.where(self.given[i], self.command[i], memory), u)
        share = jnp.where(active, self.share[:, None], 1.0).prod(0)
        sign = jnp.where(active, self.sign[:, None], 1.0).prod(0)
        leak = within(self.leaks, t, dt).any()
        snagged = {name: within(spans, t, dt).any() for name, spans in self.snags.items()}
        return u, FaultOutput(Command(sign * u), share, leak, snagged)


def weakened(model: Model, share: PerThruster) -> Model:
    """A model whose thrusters give a share of their force."""
    return eqx.tree_at(lambda m: m.thrusters.health, model, model.thrusters.health * share)


def _check(fault: ThrusterFault, count: int) -> None:
    where = f"fault '{fault.kind}'"
    if fault.kind not in get_args(ThrusterFaultKind):
        raise ConfigError(f"{where}: expected one of {', '.join(get_args(ThrusterFaultKind))}")
    if not 0 <= fault.start < fault.end:
        raise ConfigError(f"{where}: found from {fault.start:g} s to {fault.end:g} s, expected a time and a later one")
    for number in fault.thrusters:
        if not 0 <= number < count:
            raise ConfigError(f"{where}: found thruster {number}, expected 0 to {count - 1}")
    require_probability(f"{where}: share", as_array(fault.share))
    if fault.command is not None:
        require(f"{where}: command", as_array(fault.command), lambda u: np.abs(u) <= 1.0, "a command from -1 to 1")
