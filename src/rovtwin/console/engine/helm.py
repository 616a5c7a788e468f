"""The autopilot as an operator needs it: idle until told, a new mission without compiling, a pilot's wishes."""

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.block import Start
from rovtwin.core.flow import (
    ABORT,
    ARM,
    ENDS,
    NO_REQUEST,
    PAUSE,
    PILOT,
    RESUME,
    AutopilotOutput,
    Command,
    Measurement,
    Mission,
    Slot,
)
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.supervisor import MODE_PAUSED, MODE_PILOTED, MODE_RUNNING
from rovtwin.scenario.composition import Composed, way_points
from rovtwin.scenario.live.flight import ROOM
from rovtwin.scenario.realtime import NO_WISH, HostAutopilot
from rovtwin.scenario.schema import Scenario

MOST = 512  # way-points of a mission: all share one shape, and so one program


class Helm:
    """An autopilot that ticks for ever.

    Attributes:
        mission: What a start would fly.
        fastest: Largest velocity that a pilot gets, surge, sway, heave [m/s], and turn rate [rad/s], shape (4,).
    """

    def __init__(self, composed: Composed, scenario: Scenario):
        """Compiles."""
        made = composed.loop.autopilot
        if not isinstance(made, Autopilot):
            raise TypeError(f"found {type(made).__name__}, expected an Autopilot")
        self._scenario, self._model = scenario, composed.model
        self._has_terrain = made.terrain is not None
        self.mission = self.mission_of(scenario)
        self._autopilot = eqx.tree_at(
            lambda a: a.mission, made, self.mission, is_leaf=lambda leaf: isinstance(leaf, Mission)
        )
        self.fastest = np.asarray(made.contingency.fastest)
        key, autopilot = jax.random.split(composed.key)[0], self._autopilot
        self._fresh = jax.jit(lambda start: autopilot.init(key, start))
        twin = composed.loop.twin
        slots = {n: Slot.empty(max(ROOM, s.valid.shape[0]), s.value.shape[1]) for n, s in twin.empty().items()}
        self._host = HostAutopilot(self._autopilot, self._fresh(composed.start), slots, scenario.control_dt)
        self._host.change(self._autopilot, self._renewed(self._here()))  # what a start needs is compiled now
        self._request, self._idle = NO_REQUEST, True

    def mission_of(self, scenario: Scenario) -> Mission:
        """A scenario's way-points in the shape that all missions share here."""
        mission = way_points(scenario, self._model, pad_to=MOST)
        if self._has_terrain and mission.altitude is None:
            return eqx.tree_at(
                lambda m: m.altitude, mission, jnp.zeros(mission.position.shape[0]), is_leaf=lambda leaf: leaf is None
            )
        return mission

    def restart(self, start: Start) -> None:
        """Begin anew where the vehicle is; thrusters are off."""
        self._host.restart(self._fresh(start))
        self._idle = True

    def tick(self, readings: Sequence[Measurement], host: Sequence[float], pilot: Sequence[float] = NO_WISH) -> Command:
        """The command for the readings since the last tick, see HostAutopilot.step."""
        # An idle autopilot would begin its mission at the first tick that does not ask it to wait.
        request = PAUSE if self._idle else self._request
        self._request = NO_REQUEST
        return self._host.step(readings, request, host, pilot)

    def start(self, mission: Mission | None = None) -> None:
        """Fly a mission from its beginning, `mission` or the one submitted."""
        self._begin(self.mission if mission is None else mission, RESUME)

    def hold(self) -> None:
        """Stay here: from idle or from a fail-safe with thrusters on again, else as a pause of the mission."""
        self._ask(ARM if self._idle or self.mode > MODE_PAUSED else PAUSE)

    def pilot(self) -> None:
        """Go where the pilot wants."""
        if self._idle or self.mode > MODE_PAUSED:
            self._begin(self.mission, PILOT)
        else:
            self._ask(PILOT)

    def pause(self) -> None:
        self._ask(PAUSE)

    def resume(self) -> None:
        self._ask(RESUME)

    def abort(self) -> None:
        """Thrusters off."""
        self._ask(ABORT)

    def idle(self) -> None:
        """Thrusters off, as before the first start."""
        self._idle = True
        self._host.change(self._autopilot, self._renewed(self._here()))

    @property
    def is_idle(self) -> bool:
        return self._idle

    @property
    def is_running(self) -> bool:
        """Whether a mission is under way, and not over."""
        return not self._idle and self.mode == MODE_RUNNING and int(self.output.setpoint.phase) not in ENDS

    @property
    def is_piloted(self) -> bool:
        return not self._idle and (self.mode == MODE_PILOTED or self._request == PILOT)

    @property
    def has_terrain(self) -> bool:
        """Whether way-points may have altitudes."""
        return self._has_terrain

    @property
    def mode(self) -> int:
        """The supervisor's, one of gnc.supervisor.MODES."""
        return int(self._host.memory.supervisor.mode.mode)

    @property
    def output(self) -> AutopilotOutput:
        """Of the last tick."""
        return self._host.output

    @property
    def row(self) -> tuple[np.ndarray, np.ndarray]:
        """What the last tick took and gave, for `unpacked`."""
        return self._host.taken, self._host.given

    def unpacked(self, taken: Any, given: Any) -> Any:
        """See HostAutopilot."""
        return self._host.unpacked(taken, given)

    def _ask(self, request: int) -> None:
        self._idle, self._request = False, request

    def _begin(self, mission: Mission, request: int) -> None:
        self._autopilot = eqx.tree_at(lambda a: a.mission, self._autopilot, mission)
        self._host.change(self._autopilot, self._renewed(self._here()))
        self._ask(request)

    def _renewed(self, start: Start) -> Any:
        """The memory with all that decides and guides as if it began here; what observes goes on."""
        fresh, memory = self._fresh(start), self._host.memory

        def parts(m: Any) -> Any:
            return (m.supervisor, m.guidance, m.contingency, m.reference, m.control, m.terrain)

        return eqx.tree_at(parts, memory, parts(fresh), is_leaf=lambda leaf: leaf is None)

    def _here(self) -> Start:
        eta = np.asarray(self.output.estimate.eta)
        half = 0.5 * float(eta[5])
        return Start(eta[:3], np.array([math.cos(half), 0.0, 0.0, math.sin(half)]), np.zeros(6))  # type: ignore[arg-type]
