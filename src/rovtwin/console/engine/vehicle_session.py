"""The vehicle of an engine, made ready beside its loop: host process, compiled autopilot, sensors received."""

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovtwin.console.engine.experiment_helm import ExperimentHelm
from rovtwin.console.engine.helm import Helm
from rovtwin.console.engine.reporting.watching import VehicleWatch
from rovtwin.console.engine.world import WorldOpener
from rovtwin.core.errors import RovtwinError
from rovtwin.core.link import Source
from rovtwin.core.processes.urgent import settle
from rovtwin.links.remote_link import CONNECTING, RemoteLink
from rovtwin.live.connect import opener, source
from rovtwin.live.flight import needed_by
from rovtwin.live.readiness import Readiness, SensorMux, listen
from rovtwin.runs.compose.composition import Simulation, compose, vehicle_of
from rovtwin.runs.compose.sensors import rotated
from rovtwin.runs.pace import Clock
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.analysis.performance import performance

TWIN = "twin://"
COMPILING = 240.0  # longest wait for a twin, which is compiled first [s]

STEPS = (  # that make a vehicle ready; a twin is compiled by its own process at the same time
    "reading vehicle and world",
    "compiling the autopilot",
    "compiling the monitor of what changes",
    "opening the link",
    "waiting for the sensors",
)

Say = Callable[[str, str], None]  # stage, note


@dataclass(frozen=True)
class EngineConfig:
    """What to fly: a scenario, the vehicle's URL (`twin://` for a computed one), instruments beside it.

    `stop_at` is the socket of the link's host; `held` is locked as long as a commissioning holds the vehicle.
    """

    scenario: Scenario
    link: str
    sensors: tuple[str, ...]
    stop_at: Path
    held: Path | None = None

    @property
    def is_twin(self) -> bool:
        return self.link == TWIN


@dataclass(frozen=True)
class Step:
    """One of the steps that make a vehicle ready.

    Attributes:
        number: Of STEPS, from 1.
        began, whole: When it and the first of them began [s, monotonic].
    """

    number: int
    began: float
    whole: float

    def message(self) -> dict[str, Any]:
        """For pages: what is done, its number, of how many, and how long it and all of them took so far [s]."""
        now = time.monotonic()
        done = {"what": STEPS[self.number - 1], "step": self.number, "of": len(STEPS)}
        return done | {"seconds": now - self.began, "whole": now - self.whole}


@dataclass(frozen=True)
class Limits:
    """What the vehicle can keep up: `speed` ahead [m/s], in still water and against what current there is; `text`."""

    speed: float
    text: str

    @classmethod
    def of(cls, simulation: Simulation) -> "Limits":
        """From the autopilot's model and the world's current as it begins."""
        top = performance(simulation.model)["surge"]["ahead"].top_speed
        current = getattr(simulation.scenario.world.current, "velocity", None) or [0.0, 0.0, 0.0]
        against = math.hypot(*current[:2])
        text = f"{top:.2g} m/s ahead" + (f" less {against:.2g} m/s of current" if against else "")
        return cls(max(top - against, 0.0), text)


@dataclass
class VehicleSession:
    """A vehicle that is connected."""

    link: RemoteLink
    sources: list[Source]
    mux: SensorMux
    readiness: Readiness
    helm: Helm | ExperimentHelm
    simulation: Simulation
    limits: Limits
    watch: VehicleWatch

    def close(self) -> None:
        """Stop the thrusters and let go of it."""
        self.link.close()
        for one in self.sources:
            one.close()


Compiled = tuple[Simulation, Helm | ExperimentHelm, Limits, VehicleWatch]


class SessionBuilder:
    """Makes sessions in a thread of its own, so that the loop goes on telling and obeying.

    Attributes:
        clock: That readings are stamped with; of a twin it stands until the world is there.
        speed: At which it begins to run.
        step: What is done to make a vehicle ready; None where none is being made.
    """

    def __init__(self, config: EngineConfig, speed: float, say: Say):
        self.config, self.speed, self._say = config, speed, say
        self.clock = Clock(speed)
        self._made: VehicleSession | None = None
        self._helm: Compiled | None = None
        self._thread: threading.Thread | None = None
        self.step: Step | None = None

    def begin(self) -> None:
        """Start to make one, unless one is being made, or is made and nobody has taken it."""
        if self._made is None and (self._thread is None or not self._thread.is_alive()):
            self._thread = threading.Thread(target=self._make, daemon=True, name="making ready")
            self._thread.start()

    @property
    def is_making(self) -> bool:
        """Whether one is being made."""
        return self._thread is not None and self._thread.is_alive()

    def ready(self) -> VehicleSession | None:
        """The vehicle, once."""
        made, self._made = self._made, None
        return made

    def _make(self) -> None:
        try:
            self._made = self._session()
        except RovtwinError as error:
            self._say("lost", str(error))
        except Exception as error:  # a mistake of ours or of a driver: the operator has to see it, not a log
            self._say("lost", f"{type(error).__name__}: {error}")
        finally:
            self.step = None

    def _go_on(self, number: int) -> None:
        """Begin a step; its note is what the page says of it."""
        now = time.monotonic()
        self.step = Step(number, now, now if self.step is None else self.step.whole)
        what = STEPS[number - 1]
        self._say("listening" if number == len(STEPS) else "connecting", f"{what} ({number} of {len(STEPS)})")

    def _session(self) -> VehicleSession:
        config = self.config
        self.clock = Clock(0.0 if config.is_twin else self.speed)
        self._go_on(1)
        with ThreadPoolExecutor(1) as pool:
            opening = pool.submit(self._open)
            try:
                simulation, helm, limits, watch = self._helm or self._compiled()
            except BaseException:
                opening.add_done_callback(lambda done: done.exception() or done.result().close())
                raise
            self._helm = simulation, helm, limits, watch
            self._go_on(4)
            link = opening.result()
        sources: list[Source] = []
        try:
            for url in config.sensors:
                sources.append(source(url, self.clock))
            if config.is_twin:
                link.tell(("pace", *self.clock.run(self.speed)))
            mux = SensorMux(link, sources)
            self._go_on(5)
            names = simulation.sensor_names
            needed, rotation = needed_by(config.scenario), rotated(simulation.loop.twin.sensors).get("attitude")
            settle()
            readiness = listen(
                mux,
                names,
                lambda text: self._say("listening", text),
                self.speed,
                needed=needed,
                rotation=rotation,
                position_noise=simulation.position_noise,
            )
        except BaseException:
            for one in (link, *sources):
                one.close()
            raise
        return VehicleSession(link, sources, mux, readiness, helm, simulation, limits, watch)

    def _open(self) -> RemoteLink:
        config = self.config
        if config.is_twin:
            made, patience = WorldOpener(config.scenario, self.clock), COMPILING
        else:
            made, patience = opener(config.link, config.scenario, self.clock), CONNECTING
        return RemoteLink(made, len(vehicle_of(config.scenario).thruster_names), config.stop_at, patience)

    def _compiled(self) -> Compiled:
        scenario = self.config.scenario
        simulation = compose(scenario)
        _ = simulation.vehicle_table  # which a log has to tell: later it would stop the loop for seconds
        self._go_on(2)
        helm = (ExperimentHelm if scenario.test else Helm)(simulation, scenario)
        self._go_on(3)
        return simulation, helm, Limits.of(simulation), VehicleWatch(simulation, scenario)
