"""What a stage works with: the request, the folder of its attempt, the person, and what earlier stages found."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rovtwin.commission.dossier import Dossier
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Person, Phase
from rovtwin.core.errors import ConfigError
from rovtwin.core.link import Link, Source
from rovtwin.core.user_files.config import parse
from rovtwin.live.connect import as_read, at_origin, connect, on_this_machine, source
from rovtwin.planning.tank import MOTION_CAPTURE
from rovtwin.runs.pace import Clock
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.description.instruments import carries

NOT_THE_PARTS = ("bias", "bias_walk", "latency", "clock_drift", "outlier")  # figures of a carried sensor


def scenario_of(request: Request, vehicle: str, positions: dict[str, Any] | None, changes: dict[str, Any]) -> Scenario:
    """A scenario in the test tank, sensors as the link reads them; the vehicle is in the tank's middle.

    Args:
        request: Tank, link and seed.
        vehicle: Name or file.
        positions: `sensors.position`; None: as the vehicle has it.
        changes: Sections of the scenario; without `mission` and `test` the vehicle keeps its place.

    Raises:
        ConfigError: It is none.
    """
    tank = request.room
    half = [0.5 * tank.length, 0.5 * tank.width]
    walls = {"floor": tank.depth, "tank": {"north": [-half[0], half[0]], "east": [-half[1], half[1]]}}
    data = {"name": "commission", "vehicle": vehicle, "world": walls}
    data |= {"start": {"position": tank.middle}, "seed": request.seed} | changes
    if positions is not None:
        data["sensors"] = {"position": positions} | dict(changes.get("sensors") or {})
    if not {"mission", "test"} & set(changes):
        data["mission"] = {"waypoints": [{"position": tank.middle}]}
    return as_read(request.link, parse(Scenario, data, "commission"))


def positions_of(vehicle: Vehicle, bench: Mapping[str, Any], beside: Sequence[str] = ()) -> dict[str, Any] | None:
    """`sensors.position` of a scenario: as the bench has measured it, before that motion capture in the tank.

    None where a part of the vehicle measures positions, and says how well, unless an instrument beside the vehicle
    tells where its CO is.

    Args:
        vehicle: With its parts.
        bench: Figures of that stage, empty before it.
        beside: URLs of instruments.
    """
    assumed = dict(MOTION_CAPTURE)
    if carries(vehicle, "position"):
        if not any(at_origin(url, "position") for url in beside):
            return None
        assumed |= dict.fromkeys(NOT_THE_PARTS, 0.0)
    for row in bench.get("sensors", []):
        noise = [x for x in row.get("noise", [])[:2] if x is not None]
        if row.get("name") == "position" and noise:
            return assumed | {"noise": max(noise), "rate_hz": _whole(row["rate_hz"])}
    return assumed


def _whole(rate: float) -> float:
    """A counted rate [Hz] as one that has a short period in common with others, which `accuracy_bound` asks for."""
    step = 1.0 if rate >= 5.0 else 0.5 if rate >= 1.0 else 0.1
    return max(round(rate / step), 1) * step


@dataclass(frozen=True)
class Connected:
    """A vehicle that answers: the link, instruments beside it, the clock that both stamp readings with."""

    link: Link
    sources: Sequence[Source]
    clock: Clock


@dataclass(frozen=True)
class Work:
    """What a stage gets.

    Attributes:
        dossier: What was asked for and what earlier stages found.
        folder: Of this attempt.
        person: Whoever stands at the water.
        stop_at: Socket that stops the thrusters, past this process, while a line steers; None: there is none.
        enter: Called with what begins: asking whether thrusters may turn, turning once there is a yes, resting once
            they are off and what follows is computed only.
    """

    dossier: Dossier
    folder: Path
    person: Person
    stop_at: Path | None = None
    enter: Callable[[Phase], None] = lambda phase: None

    @property
    def request(self) -> Request:
        return self.dossier.request

    @property
    def vehicle(self) -> Vehicle:
        """As it is described now, with what this commissioning has identified of it."""
        return self.request.load_vehicle()

    def file(self, stage: str, key: str) -> Path | None:
        """A file that a passed stage names in its figures, None where it has not been passed or names none."""
        passed, name = self.dossier.passed(stage), self.dossier.measured(stage).get(key)
        return None if passed is None or not name else passed.folder / str(name)

    def identified(self) -> Path:
        """The file that this commissioning has identified; ConfigError where there is none."""
        found = self.file("identify", "vehicle_file")
        if found is None:
            raise ConfigError(
                "no identified file of this commissioning: nothing says how sure the model is. Pass the stage identify "
                "first"
            )
        return found

    def current_vehicle(self) -> str:
        """File or name of the best description so far: identified here, else as given."""
        for stage in ("identify", "excite"):
            found = self.file(stage, "vehicle_file")
            same = self.dossier.passed(stage, self.request.fingerprint()) is not None
            if same and found is not None and found.exists():
                return str(found)
        return self.request.vehicle

    def positions(self) -> dict[str, Any] | None:
        """`sensors.position` of a scenario, see `positions_of`."""
        return positions_of(self.vehicle, self.dossier.measured("bench"), self.request.sensors)

    def scenario(self, changes: dict[str, Any], vehicle: str | None = None) -> Scenario:
        """A scenario of the vehicle in the test tank, its sensors as the link reads them.

        Args:
            changes: Sections of it; without `mission` and `test` it keeps its place in the middle.
            vehicle: Its file; None: the best so far.

        Raises:
            ConfigError: It is none.
        """
        return scenario_of(self.request, vehicle or self.current_vehicle(), self.positions(), changes)

    @contextmanager
    def connected(
        self, scenario: Scenario, observe: bool = False, beside: Connected | None = None
    ) -> Iterator[Connected]:
        """The vehicle and its instruments, let go of at the end.

        Args:
            scenario: With the vehicle that is expected there.
            observe: Only look.
            beside: A line to it that is open already: the new one is without instruments, and has its clock.

        Raises:
            ConfigError: A URL cannot be used.
            LinkError: Nobody answers.
        """
        speed, link = self.request.speed, self.request.link
        if speed != 1.0 and not on_this_machine(link):
            raise ConfigError(f"--speed {speed:g}: {link} may be a real vehicle, whose time runs as ours")
        clock = Clock(speed) if beside is None else beside.clock
        with ExitStack() as stack:
            self.person.progress(f"connecting to {link}")
            instruments = self.request.sensors if beside is None else ()
            sources = [stack.enter_context(source(url, clock)) for url in instruments]
            steers = self.stop_at is not None and not observe
            stopped = {"stop_at": self.stop_at} if steers else {}
            vehicle = stack.enter_context(connect(link, scenario, clock, observe=observe, **stopped))
            yield Connected(vehicle, sources, clock)

    def may_move(self, what: str) -> bool:
        """A yes of the person to what moves the vehicle next; asked each time."""
        self.enter("asking")
        confirmed = self.person.confirm(what)
        self.enter("turning" if confirmed else "resting")
        return confirmed

    def at_rest(self) -> None:
        """What follows is computed only: thrusters are off until `may_move` has a yes again."""
        self.enter("resting")
