"""A test as its operator needs it: thrusters off until it is started, flown from its beginning, and off again."""

from typing import Any

import equinox as eqx

from rovtwin.console.engine.steering import Steering
from rovtwin.core.block import Start
from rovtwin.core.flow import ABORT, RESUME
from rovtwin.gnc.experiment import Experiment
from rovtwin.runs.compose.composition import Simulation
from rovtwin.scenario.schema import Scenario


class ExperimentHelm(Steering):
    """An Experiment that ticks for ever.

    A test cannot be held and gone on with, it would be another one: what ends it switches the thrusters off, and a
    start begins it anew, with its home where the vehicle then is.
    """

    def __init__(self, simulation: Simulation, scenario: Scenario):
        """Compiles."""
        made = simulation.loop.autopilot
        if not isinstance(made, Experiment):
            raise TypeError(f"found {type(made).__name__}, expected an Experiment")
        super().__init__(simulation, made, scenario.control_dt)

    def start(self) -> None:
        """Fly the test from its beginning."""
        self._host.change(self._autopilot, self._renewed(self._here()))
        self._ask(RESUME)

    def abort(self) -> None:
        """Thrusters off."""
        self._ask(ABORT)

    def _renewed(self, start: Start) -> Any:
        fresh = self._fresh(start)
        return eqx.tree_at(lambda m: m.estimate, fresh, self._host.memory.estimate)
