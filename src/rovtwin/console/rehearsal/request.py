"""What is rehearsed: a plan, from where the vehicle is, in the water and the fence of now; as a scenario."""

import math
from dataclasses import dataclass
from typing import Any

from rovtwin.console.engine.fence import padded, with_fence
from rovtwin.console.planning import waypoint_of
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.runs.compose.world import current_at
from rovtwin.runs.limits import compass_point
from rovtwin.scenario.schema import (
    ConstantCurrentSection,
    MissionSection,
    Scenario,
    ShearedCurrentSection,
    Waypoint,
    WorldSection,
)
from rovtwin.scenario.schema.world import CurrentSection

FASTEST = 5.0  # current that somebody may give [m/s]
HIGHEST = 20.0  # waves [m]
LITTLE = 0.005  # current that is called none [m/s]


@dataclass(frozen=True)
class Water:
    """The water as the page in control gives it, in place of the scenario's; None: the scenario's.

    Attributes:
        current: North and east [m/s].
        waves: Significant height [m].
    """

    current: tuple[float, float] | None = None
    waves: float | None = None

    @classmethod
    def of(cls, what: dict[str, Any], has_waves: bool) -> "Water":
        """From an order: `speed` [m/s] and `toward` [deg], or neither; `waves` [m], where the scenario has any.

        Raises:
            ConfigError: Something else than numbers that water can have.
        """
        speed, toward, waves = (what.get(name) for name in ("speed", "toward", "waves"))
        if (speed is None) != (toward is None):
            raise ConfigError("the current: found one of speed and direction, expected both, or neither")
        current = None
        if speed is not None:
            size, angle = _number("speed", speed, FASTEST), math.radians(_number("toward", toward, 360.0))
            current = size * math.cos(angle), size * math.sin(angle)
        if waves is None:
            return cls(current)
        if not has_waves:
            raise ConfigError("waves: found a height, but the scenario has no waves: start the console with some")
        return cls(current, _number("waves", waves, HIGHEST, above=0.0))


def _number(name: str, value: Any, most: float, above: float = -1.0) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    if not is_number or not max(above, 0.0) <= value <= most or value <= above:
        least = "more than 0" if above >= 0.0 else "0"
        raise ConfigError(f"rehearse.{name}: found {value!r:.40}, expected {least} to {most:g}")
    return float(value)


@dataclass(frozen=True)
class Request:
    """One rehearsal.

    Attributes:
        number: Of it; a newer one takes its place.
        rows: Way-points as in the plan.
        place: Where the vehicle is, n [m].
        heading_deg: Its heading.
        water: As somebody gave it.
        added: Current that the twin has beside the scenario's [m/s].
        floor: Depth of the floor by the altimeter [m]; None where there is none, or the scenario knows better.
        charge: Of the batteries, 0 to 1; None: not measured.
        fence: Corners of the one that was drawn, north and east [m]; None: the scenario's.
        is_twin: Whether the vehicle is computed; of a real one the scenario's tank does not count.
    """

    number: int
    rows: tuple[dict[str, Any], ...]
    place: tuple[float, float, float]
    heading_deg: float
    water: Water = Water()
    added: tuple[float, float] = (0.0, 0.0)
    floor: float | None = None
    charge: float | None = None
    fence: tuple[tuple[float, float], ...] | None = None
    is_twin: bool = True

    def scenario(self, scenario: Scenario) -> Scenario:
        """The scenario of a console, with this plan, begun here, in this water."""
        waypoints = [parse(Waypoint, waypoint_of(row), f"way-point {i + 1}") for i, row in enumerate(self.rows)]
        depth = max(self.place[2], 0.0)
        begun = {"position": [*self.place[:2], depth], "heading_deg": self.heading_deg}
        start = scenario.start.model_copy(update=begun)
        changes: dict[str, Any] = {"mission": MissionSection(waypoints=waypoints), "start": start}
        if scenario.battery is not None and self.charge is not None:  # low ones end a mission
            changes["battery"] = scenario.battery.model_copy(update={"charge": min(max(self.charge, 0.0), 1.0)})
        if self.fence is not None:  # in one shape, so that another fence needs no other program
            scenario = with_fence(scenario, padded([[*corner] for corner in self.fence]).tolist())
        return scenario.model_copy(update=changes | {"world": self._world(scenario)})

    def _world(self, scenario: Scenario) -> WorldSection:
        world = scenario.world
        changed: dict[str, Any] = {"current": self._current(world.current)}
        if self.water.waves is not None and world.waves is not None:
            changed["waves"] = world.waves.model_copy(update={"significant_height": self.water.waves})
        if not self.is_twin:
            changed["tank"] = None
            if self.floor is not None:
                changed |= {"floor": self.floor, "relief": None}
        return world.model_copy(update=changed)

    def _current(self, own: CurrentSection) -> CurrentSection:
        """As somebody gave it, or the scenario's with what the twin has beside it."""
        if self.water.current is not None:
            return ConstantCurrentSection(velocity=[*self.water.current, 0.0])

        def more(velocity: list[float]) -> list[float]:
            return [velocity[0] + self.added[0], velocity[1] + self.added[1], velocity[2]]

        if isinstance(own, ConstantCurrentSection):
            return own.model_copy(update={"velocity": more(own.velocity)})
        if isinstance(own, ShearedCurrentSection):
            return own.model_copy(update={"velocities": [more(one) for one in own.velocities]})
        return own.model_copy(update={"mean": more(own.mean)})

    def words(self, scenario: Scenario) -> str:
        """The water in words, and who says so."""
        world = self.scenario(scenario).world
        north, east = current_at(world, self.place[2])
        size = math.hypot(north, east)
        current = "no current"
        if size >= LITTLE:
            toward = math.degrees(math.atan2(east, north)) % 360.0
            current = f"current {size:.2g} m/s to the {compass_point(math.radians(toward))} ({toward:.0f} deg)"
        who = "as given" if self.water.current is not None else "the twin's" if self.is_twin else "of the scenario"
        height = getattr(world.waves, "significant_height", None)
        return f"{current}, {who}; {'no waves' if height is None else f'waves {height:.2g} m'}"

    def floor_by(self, scenario: Scenario) -> str:
        """What the depth of the floor is known by, "" where it is not known."""
        if not self.is_twin and self.floor is not None:
            return "the altimeter, here; taken as level"
        return "the scenario" if scenario.world.floor is not None else ""
