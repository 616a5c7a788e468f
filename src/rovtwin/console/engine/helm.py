"""The autopilot as an operator needs it: idle until started, a new mission without compiling, a pilot's commands."""

from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.console.engine.fence import Polygon, padded
from rovtwin.console.engine.steering import Steering
from rovtwin.core.block import Start
from rovtwin.core.flow import ABORT, ARM, PAUSE, PILOT, RESUME, Mission
from rovtwin.core.numerics import as_array, jnp
from rovtwin.gnc.autopilot import Autopilot
from rovtwin.gnc.interfaces import MODE_PAUSED, MODE_PILOTED
from rovtwin.runs.compose.composition import Simulation, way_points
from rovtwin.scenario.schema import Scenario

MOST = 512  # way-points of a mission: all share one shape, and so one program


class Helm(Steering):
    """An autopilot that ticks for ever.

    Attributes:
        mission: What a start would fly.
        fastest: Largest velocity that a pilot gets, surge, sway, heave [m/s], and turn rate [rad/s], shape (4,).
    """

    def __init__(self, simulation: Simulation, scenario: Scenario):
        """Compiles."""
        made = simulation.loop.autopilot
        if not isinstance(made, Autopilot):
            raise TypeError(f"found {type(made).__name__}, expected an Autopilot")
        self._scenario, self._model = scenario, simulation.model
        self._has_terrain = made.terrain is not None
        self.mission = self.mission_of(scenario)
        self.fastest = np.asarray(made.contingency.fastest)
        ready = eqx.tree_at(lambda a: a.mission, made, self.mission, is_leaf=lambda leaf: isinstance(leaf, Mission))
        ready = _fenced(ready, scenario.autopilot.supervisor.geofence.polygon)
        super().__init__(simulation, ready, scenario.control_dt)
        self._begun = False  # a mission, since thrusters were last at rest

    def mission_of(self, scenario: Scenario) -> Mission:
        """A scenario's way-points in the shape that all missions share here."""
        mission = way_points(scenario, self._model, pad_to=MOST)
        if self._has_terrain and mission.altitude is None:
            return eqx.tree_at(
                lambda m: m.altitude, mission, jnp.zeros(mission.position.shape[0]), is_leaf=lambda leaf: leaf is None
            )
        return mission

    def start(self, mission: Mission | None = None) -> None:
        """Fly a mission from its beginning, `mission` or the one submitted."""
        self._begin(self.mission if mission is None else mission, RESUME)
        self._begun = True

    def fence(self, polygon: Polygon | None) -> None:
        """Stay within another polygon from now on; None is everywhere."""
        self._autopilot = _fenced(self._autopilot, polygon)
        self._host.change(self._autopilot, self._host.memory)

    def hold(self) -> None:
        """Stay here: from idle or from a fail-safe with thrusters on again, else as a pause of the mission."""
        self._ask(ARM if self._idle or self.mode > MODE_PAUSED else PAUSE)

    def pilot(self) -> None:
        """Go where the pilot wants."""
        if self._idle or self.mode > MODE_PAUSED:
            self._begin(self.mission, PILOT)
            self._begun = False
        else:
            self._ask(PILOT)

    def pause(self) -> None:
        self._ask(PAUSE)

    def resume(self) -> None:
        self._ask(RESUME)

    def abort(self) -> None:
        """Thrusters off."""
        self._ask(ABORT)

    @property
    def is_piloted(self) -> bool:
        return not self._idle and (self.mode == MODE_PILOTED or self._request == PILOT)

    @property
    def can_resume(self) -> bool:
        waits = self.mode in (MODE_PAUSED, MODE_PILOTED) or self._request == PAUSE
        return self._begun and waits

    def idle(self) -> None:
        super().idle()
        self._begun = False

    def restart(self, start: Start) -> None:
        super().restart(start)
        self._begun = False

    @property
    def has_terrain(self) -> bool:
        """Whether way-points may have altitudes."""
        return self._has_terrain

    def _begin(self, mission: Mission, request: int) -> None:
        self._autopilot = eqx.tree_at(lambda a: a.mission, self._autopilot, mission)
        self._host.change(self._autopilot, self._renewed(self._here()))
        self._ask(request)

    def _renewed(self, start: Start) -> Any:
        fresh, memory = self._fresh(start), self._host.memory
        spoilt = bool(memory.failed)

        def parts(m: Any) -> Any:
            # With the monitor: thrusters that were given up are tried again. So are blocks that failed: thrusters
            # are at rest then, and an allocation may begin anew.
            failed = (m.failed, m.allocation) if spoilt else (m.failed,)
            return (m.supervisor, m.guidance, m.contingency, m.reference, m.control, m.terrain, m.monitor, *failed)

        return eqx.tree_at(parts, memory, parts(fresh), is_leaf=lambda leaf: leaf is None)


def _fenced(autopilot: Autopilot, polygon: Polygon | None) -> Autopilot:
    return eqx.tree_at(
        lambda a: a.supervisor.rules.fence, autopilot, as_array(padded(polygon)), is_leaf=lambda leaf: leaf is None
    )
