"""What flies at the engine's ticks: a compiled autopilot, idle until it is started, that goes on for ever."""

import abc
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Block, Start
from rovtwin.core.flow import ENDS, NO_REQUEST, PAUSE, AutopilotOutput, Command, Measurement, Slot
from rovtwin.core.frames import level_attitude
from rovtwin.core.numerics import as_array, jax
from rovtwin.core.programs.compiled import jit_once
from rovtwin.gnc.interfaces import MODE_RUNNING
from rovtwin.live.flight import ROOM
from rovtwin.runs.compose.composition import Simulation
from rovtwin.runs.realtime import NO_PILOT_COMMAND, HostAutopilot

_begun = jit_once(lambda autopilot, key, start: autopilot.init(key, start))


class Steering(abc.ABC):
    """An autopilot for missions (`Helm`) or for a test (`ExperimentHelm`), as the engine ticks it."""

    def __init__(self, simulation: Simulation, autopilot: Block, control_dt: float):
        """Compiles."""
        self._autopilot: Any = autopilot
        key = jax.random.split(simulation.key)[0]
        self._fresh = lambda start: _begun(autopilot, key, start)
        twin = simulation.loop.twin
        slots = {n: Slot.empty(max(ROOM, s.valid.shape[0]), s.value.shape[1]) for n, s in twin.empty().items()}
        self._host = HostAutopilot(autopilot, self._fresh(simulation.start), slots, control_dt)
        self._host.change(autopilot, self._renewed(self._here()))  # what a start needs is compiled now
        self._request, self._idle = NO_REQUEST, True

    @abc.abstractmethod
    def _renewed(self, start: Start) -> Any:
        """The memory with all that decides as if it began here; what listens goes on."""

    def restart(self, start: Start) -> None:
        """Begin anew where the vehicle is; thrusters are off."""
        self._host.restart(self._fresh(start))
        self._idle = True

    def tick(
        self, readings: Sequence[Measurement], host: Sequence[float], pilot: Sequence[float] = NO_PILOT_COMMAND
    ) -> Command:
        """The command for the readings since the last tick, see HostAutopilot.step."""
        # An idle autopilot would begin its mission at the first tick that does not ask it to wait.
        request = PAUSE if self._idle else self._request
        self._request = NO_REQUEST
        return self._host.step(readings, request, host, pilot)

    def idle(self) -> None:
        """Thrusters off, as before the first start."""
        self._idle = True
        self._host.change(self._autopilot, self._renewed(self._here()))

    @property
    def is_idle(self) -> bool:
        return self._idle

    @property
    def is_running(self) -> bool:
        """Whether a mission or test is under way, and not over."""
        return not self._idle and self.mode == MODE_RUNNING and int(self.output.setpoint.phase) not in ENDS

    @property
    def is_over(self) -> bool:
        """Whether what was started has come to an end, its own or another."""
        return not self._idle and int(self.output.setpoint.phase) in ENDS

    @property
    def can_resume(self) -> bool:
        """Whether a mission that was begun waits to be gone on with: it is paused, or a pilot has the vehicle."""
        return False

    @property
    def mode(self) -> int:
        """The supervisor's, one of gnc.interfaces.MODES."""
        return int(self._host.memory.supervisor.mode.mode)

    @property
    def output(self) -> AutopilotOutput:
        """Of the last tick."""
        return self._host.output

    @property
    def row(self) -> tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]:
        """What the last tick took and gave, for `unpacked`."""
        return self._host.taken, self._host.given

    def unpacked(self, taken: Any, given: Any) -> Any:
        """See HostAutopilot."""
        return self._host.unpacked(taken, given)

    def _ask(self, request: int) -> None:
        self._idle, self._request = False, request

    def _here(self) -> Start:
        estimate = self.output.estimate
        return Start(as_array(estimate.position), level_attitude(estimate.heading), as_array(np.zeros(6)))
