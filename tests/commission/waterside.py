"""A tank with a twin in it whose truth is not the vehicle file's, for tests of commissioning: no clock runs."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import Link
from rovtwin.core.numerics import jax
from rovtwin.links.twin import TwinLink
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.pace import Clock
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.twin import TwinInput

TICK = 1e-3  # by which time moves on whenever somebody looks at the clock [s]


class CountingClock(Clock):
    """Time that passes by being looked at: whoever waits for it sleeps for no time at all."""

    def __init__(self, speed: float = 1.0):
        super().__init__(1e6)
        self._looked = 0

    def __call__(self) -> float:
        self._looked += 1
        return self._looked * TICK


class Corrupted(Link):
    """A link with a mistake in it: what is read and what is sent are changed on the way."""

    def __init__(
        self,
        link: Link,
        read: Callable[[Measurement], Measurement | None] = lambda reading: reading,
        send: Callable[[np.ndarray], np.ndarray] = lambda u: u,
    ):
        self._link, self._change, self._sent = link, read, send
        self.commands: list[np.ndarray] = []

    def read(self) -> list[Measurement]:
        return [changed for reading in self._link.read() if (changed := self._change(reading)) is not None]

    def send(self, command: Command) -> None:
        u = np.asarray(command.u, dtype=float)
        self.commands.append(u)
        self._link.send(Command(self._sent(u)))

    @property
    def age(self) -> float:
        return self._link.age

    def arm(self) -> None:
        self._link.arm()

    def stop(self) -> None:
        self._link.stop()

    def close(self) -> None:
        self._link.close()


class Yes:
    """Somebody who says yes, and reads off what they are given."""

    def __init__(self, numbers: Mapping[str, float] | None = None, answer: bool = True):
        self.lines: list[str] = []
        self._numbers, self._answer = numbers or {}, answer

    def confirm(self, question: str) -> bool:
        self.lines.append(question)
        return self._answer

    def number(self, question: str, unit: str) -> float | None:
        self.lines.append(question)
        return next((value for words, value in self._numbers.items() if words in question), None)

    def say(self, line: str) -> None:
        self.lines.append(line)

    def progress(self, what: str, share: float | None = None) -> None:
        pass


def twin(truth: str | dict[str, Any] | None, clock: Clock, scenario: Scenario) -> TwinLink:
    """The twin of a vehicle as it truly is, in the scenario's world."""
    true = scenario if truth is None else scenario.model_copy(update={"vehicle": truth})
    simulation = compose(true)
    made, dt = replace(simulation.loop.twin, hand=None), scenario.control_dt
    memory = made.init(jax.random.split(simulation.key)[1], simulation.start)
    step = jax.jit(lambda memory, command, k: made.step(memory, TwinInput(command, k), dt))

    def advance(memory: Any, command: Any, k: int) -> Any:
        memory, moved = step(memory, command, k)
        return memory, moved.measurements

    return TwinLink(advance, memory, made.model.thrusters.count, dt, clock)


def edited(vehicle: str | Path, path: Path, change: Callable[[dict[str, Any]], None]) -> Path:
    """A vehicle file with something changed in it."""
    from rovtwin.core.user_files.yamlfile import dump_yaml
    from rovtwin.vehicle import load_vehicle

    data = load_vehicle(vehicle).to_dict()
    change(data)
    path.write_text(dump_yaml(data))
    return path
