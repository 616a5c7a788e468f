"""The twin behind a link of its own process, with what only a simulated world can do: pause, run fast, break."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import Link
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.links.twin import TwinLink
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.pace import Clock
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.environment.current import CombinedCurrent, ConstantCurrent
from rovtwin.simulation.stepping import step_twin
from rovtwin.simulation.twin import Twin

LEASH = 0.06  # how far the vehicle goes ahead of the autopilot where time runs fast [s]; in a test not at all
TRUTH = "truth"  # a reading that no real vehicle gives: eta (6,), water velocity in n (3,), moving surface's height


class WorldLink(TwinLink):
    """A twin that takes orders (`tell`), says the truth beside its readings, and may be armed again after a stop.

    Orders are `(what, *values)`: `("pace", began, before, speed)` as `Clock.run` gives it, `("reached", t)` with its
    own time [s], `("thruster", number, share)`, `("sensor", name, works)`, `("current", north, east)` [m/s] beside the
    world's own, `("test", t)`: a test with a hand in it begins at its own time t [s], or never, inf.
    """

    def __init__(self, simulation: Simulation, dt: float, clock: Clock):
        self._clock_ = clock
        self._twin = breakable(simulation.loop.twin)
        self._healthy = self._twin.model.thrusters.health
        self._silent: set[str] = set()
        self._hand = None if self._twin.hand is None else np.asarray(self._twin.hand.spans)
        self._twin = self._with_hand(np.inf)
        memory = self._twin.init(jax.random.split(simulation.key)[1], simulation.start)
        self._dt = dt
        self._truth = np.zeros(10)
        super().__init__(self._advance_, memory, self._healthy.shape[0], dt, clock)
        self._reached = np.inf  # time whose command the autopilot has sent, once it tells it [s]
        self._leash = LEASH if simulation.scenario.test is None else 0.0
        self._advance_(memory, Command(jnp.zeros_like(self._healthy)), 0)  # compiled before anybody waits for it
        self._truth = np.zeros(10)

    def _advance_(self, memory: Any, command: Command, k: int) -> Any:
        memory, measurements, truth = step_twin(self._twin, memory, command.u, np.asarray(k), dt=self._dt)
        self._truth = np.asarray(truth)
        return memory, measurements

    def read(self) -> list[Measurement]:
        before = self.tick
        found = [reading for reading in super().read() if reading.sensor not in self._silent]
        if self.tick > before:
            found.append(Measurement(TRUTH, self._truth, self.tick * self._period))
        return found

    @property
    def is_due(self) -> bool:
        return super().is_due and not self._leashed()

    def _leashed(self) -> bool:
        """Whether to wait for the autopilot: faster than real time a vehicle must not outrun it."""
        return self._clock_.speed > 1.0 and self._now() - self._reached > self._leash + 0.5 * self._period

    def arm(self) -> None:
        if self._closed:
            raise LinkError("the twin: closed before it was armed")
        self._stopped = False

    def _with_hand(self, began: float) -> Twin:
        """The twin whose hand knows when the test began [s]."""
        if self._hand is None:
            return self._twin
        spans = as_array(self._hand + began)
        return eqx.tree_at(lambda twin: twin.hand.spans, self._twin, spans)

    def tell(self, order: tuple[Any, ...]) -> None:
        """Do what an order says; one that there is not is a programming mistake."""
        what, *values = order
        if what == "reached":
            self._reached = values[0]
        elif what == "pace":
            self._clock_.follow((values[0], values[1], values[2]))
            self._prompt = self._clock_.speed <= 1.0  # faster, time is in step with the autopilot
        elif what == "test":
            self._twin = self._with_hand(values[0])
        elif what == "thruster":
            health = self._twin.model.thrusters.health.at[values[0]].set(self._healthy[values[0]] * values[1])
            self._twin = eqx.tree_at(lambda twin: twin.model.thrusters.health, self._twin, health)
        elif what == "sensor":
            (self._silent.discard if values[1] else self._silent.add)(values[0])
        elif what == "current":
            self._twin = eqx.tree_at(_added, self._twin, as_array([*values, 0.0]))
        else:
            raise ValueError(f"order {what!r}")


def breakable(twin: Twin) -> Twin:
    """The same twin with room for a current beside its own, so that turning one on compiles nothing."""
    extra = ConstantCurrent(jnp.zeros(3))
    current = extra if twin.world.current is None else CombinedCurrent((twin.world.current, extra))
    return eqx.tree_at(lambda t: t.world.current, twin, current, is_leaf=lambda leaf: leaf is None)


def _added(twin: Twin) -> Any:
    current: Any = twin.world.current
    while isinstance(current, CombinedCurrent):
        current = current.parts[-1]
    return current.velocity


@dataclass(frozen=True)
class WorldOpener:
    """Opens a scenario's twin in the host's process; its clock stands until it is set."""

    scenario: Scenario
    clock: Clock

    def __call__(self) -> Link:
        return WorldLink(compose(self.scenario), self.scenario.control_dt, self.clock)
