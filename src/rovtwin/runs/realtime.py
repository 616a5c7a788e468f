"""The autopilot tick by tick from Python: a link's readings in, the command out, in tens of microseconds."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.flat import Layout, Packer
from rovtwin.core.block import Block
from rovtwin.core.flow import NO_REQUEST, AutopilotInput, AutopilotOutput, Command, Measurement, Measurements
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.programs.compiled import in_one_piece, shapes_in_one_piece

NO_PILOT_COMMAND = (0.0, 0.0, 0.0, 0.0)  # of a pilot: the vehicle stays


@partial(jax.jit, static_argnames="dt")
def _step(autopilot: Block, memory: Any, inputs: AutopilotInput, dt: float) -> tuple[Any, AutopilotOutput]:
    return autopilot.step(memory, inputs, dt)


class HostAutopilot:
    """An autopilot stepped by a host program; it keeps its memory and what the last tick took and gave.

    What crosses between Python and compiled code is one vector each way, [readings, request] and [output, memory]: to
    hand over the forty arrays that they are made of takes longer than the tick. What a log wants of them is unpacked
    later, many ticks at once.

    Attributes:
        taken: The vector that went into the last tick, NumPy.
        given: The vector that came out of it.
    """

    def __init__(self, autopilot: Block, memory: Any, slots: Measurements, control_dt: float):
        """Compiles, so that the first tick takes as long as the others.

        Args:
            autopilot: Takes AutopilotInput, gives AutopilotOutput.
            memory: Its memory before the first tick.
            slots: Room for the readings of one tick; only shapes are used.
            control_dt: Control period [s].
        """
        inputs = AutopilotInput(slots, jnp.asarray(NO_REQUEST))
        _, output = shapes_in_one_piece(_step, autopilot, memory, inputs, dt=control_dt)
        blocks, takes, gives = Layout(autopilot), Layout(inputs), Layout((output, memory))
        self._takes, self._gives = takes, gives
        places = self._takes.places()
        output_places, _ = self._gives.places()
        self._pack = Packer(self._takes, slots, places.measurements)
        self._request, self._pilot = places.request.start, places.pilot
        self._host = [x.start for x in (places.host.link_age, places.host.operator_age, places.host.lateness)]
        self._u, self._phase = output_places.command.u, output_places.setpoint.phase.start

        def tick(
            parameters: Float[Array, " _"], before: Float[Array, " _"], taken: Float[Array, " _"]
        ) -> Float[Array, " _"]:
            # Parameters come as a vector too: as constants they would make every vehicle a program of its own. So would
            # `self`, which holds them, in the key under which the program is kept.
            _, memory = gives.unflatten(before)
            memory, output = _step(blocks.unflatten(parameters), memory, takes.unflatten(taken), dt=control_dt)
            return gives.flatten((output, memory))

        self._tick = in_one_piece(tick)
        self._blocks = blocks
        self._output = Layout(output)
        self._parameters = blocks.flatten(autopilot)
        self.taken: np.ndarray
        self.given: np.ndarray
        self._nothing = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), output)
        self.restart(memory)
        self._tick(self._parameters, self._after, self.taken).block_until_ready()

    def restart(self, memory: Any) -> None:
        """Begin anew with a memory, as that of another start; nothing is compiled."""
        self._after = self._gives.flatten((self._nothing, memory))
        self.taken, self.given = self._pack(()), np.asarray(self._after)

    def change(self, autopilot: Block, memory: Any) -> None:
        """Go on with other parameters and another memory of the same shapes; what the last tick gave stays."""
        self._parameters = self._blocks.flatten(autopilot)
        self._after = self._gives.flatten((self._gives.unflatten(np.asarray(self._after))[0], memory))

    @property
    def memory(self) -> Any:
        """After the last tick, NumPy."""
        return self._gives.unflatten(np.asarray(self._after))[1]

    @property
    def output(self) -> AutopilotOutput:
        """Of the last tick, NumPy."""
        return self._output.unflatten(self.given[: self._output.size])

    def step(
        self,
        readings: Sequence[Measurement],
        request: int = NO_REQUEST,
        host: Sequence[float] = (0.0, 0.0, 0.0),
        pilot: Sequence[float] = NO_PILOT_COMMAND,
    ) -> Command:
        """One tick: the command for the readings since the last one.

        Args:
            readings: In order of arrival.
            request: The operator's, one of core.flow.NO_REQUEST, ...
            host: Age of the link [s], of the operator's last sign [s], lateness [control periods]; see core.flow.Host.
            pilot: Desired surge, sway, heave [m/s] and turn rate [rad/s], see core.flow.AutopilotInput.
        """
        taken = self._pack(readings)
        taken[self._request] = request
        taken[self._host] = host
        taken[self._pilot] = pilot
        self._after = self._tick(self._parameters, self._after, taken)
        self.taken, self.given = taken, np.asarray(self._after)
        return Command(self.given[self._u])  # type: ignore[arg-type]  (NumPy: it goes to a link)

    @property
    def phase(self) -> int:
        """Phase after the last tick, one of `flow.PHASES`."""
        return int(self.given[self._phase])

    def unpacked(
        self, taken: Sequence[np.ndarray], given: Sequence[np.ndarray]
    ) -> tuple[Measurements, AutopilotOutput]:
        """Readings and outputs of several ticks from their vectors, leading axis ticks, NumPy."""
        measurements = self._takes.unflatten(np.stack(taken)).measurements
        return measurements, self._gives.unflatten(np.stack(given))[0]
