"""What the monitor beside the autopilot finds of a vehicle in flight: for the page, and as events."""

import logging
from typing import Any

from rovtwin.live.beside import SINCE, monitor_of
from rovtwin.monitoring.change import Change, causes
from rovtwin.monitoring.flight import FlightMonitor, Found
from rovtwin.monitoring.monitor import BLOCK
from rovtwin.monitoring.quantities import Reading
from rovtwin.runs.compose.composition import Simulation
from rovtwin.scenario.schema import Scenario

logger = logging.getLogger(__name__)

IN_A_ROW = 2  # blocks of evidence in which a change has to be seen: a flight is looked at many times
GROUPS = {  # by the first part of a quantity's name
    "top_speed": "Top speed and rate",
    "net_buoyancy": "Buoyancy and trim",
    "center_of_buoyancy_x": "Buoyancy and trim",
    "center_of_buoyancy_y": "Buoyancy and trim",
    "drag": "Drag",
    "thruster": "Force of each thruster, against the others of its axis",
    "force": "Force by axis",
    "added_mass": "Added mass",
    "metacentric_height": "Stability",
}
SELDOM = ("force", "added_mass", "metacentric_height")  # asked for
IN_A_TEST = "not in a test: its log is for rovtwin identify, which finds every parameter"
BEGINS = (
    f"From arming to disarming. First figures after {BLOCK + 5} s, better ones after turns, dives and legs at speed."
)


class VehicleWatch:
    """The monitors of a vehicle's flights, one after the other.

    Attributes:
        unwatched: Why flights, or this one, are not watched, "" where they are.
        changed: What has changed in the flight under way, or in the last one.
    """

    def __init__(self, simulation: Simulation, scenario: Scenario):
        """Compiles, so that no flight waits for it."""
        self._simulation, self._scenario = simulation, scenario
        first, self._never = (None, IN_A_TEST) if scenario.test else monitor_of(simulation, scenario)
        self.unwatched = self._never
        self._is_compared = first is not None and first.reference is not None
        self._monitor: FlightMonitor | None = None
        self._forget()

    def begin(self) -> FlightMonitor | None:
        """A monitor for the flight to come; what the last one found is forgotten. None where none can be."""
        self._monitor, self.unwatched = None, self._never
        if not self._never:
            self._monitor, self.unwatched = monitor_of(self._simulation, self._scenario)
        self._forget()
        return self._monitor

    def news(self) -> str:
        """What has changed that is news in this flight, in words; "" for nothing. It fails at nothing."""
        try:
            return self._news()
        except Exception as error:  # a mistake of ours, which must end neither the flight nor its log
            logger.exception("what has changed of the vehicle")
            self._monitor, self.unwatched = None, f"{type(error).__name__}: {error}"
            self._forget()
            return ""

    def _news(self) -> str:
        found = None if self._monitor is None else self._monitor.found
        if found is None or (block := round(found.seconds) // BLOCK) == self._block:
            return ""
        self._block = block
        seen = {change.reading.quantity.name: change for change in found.changes}
        self._in_a_row = {name: self._in_a_row.get(name, 0) + 1 for name in seen}
        known = {change.reading.quantity.name: change for change in self.changed}
        sure = {name: seen[name] for name in seen if name in known or self._in_a_row[name] >= IN_A_ROW}
        self.changed = list((sure | {name: known[name] for name in known if name not in sure}).values())
        self._causes, self._rows = causes(self.changed), self._rows_of(found)
        return "; ".join(self._fresh_lines())

    @property
    def names(self) -> list[str]:
        """Of what has changed, as people call it."""
        return [change.reading.quantity.words.rstrip(",") for change in self.changed]

    def message(self, armed: bool) -> dict[str, Any]:
        """What the page shows.

        Each row has the quantity's name for people, and a short one under its heading (`words`, `short`, `group`), the
        difference to before as text (`figures`), two standard deviations below, the value and two above in its `unit`
        (`interval`), whether the flight says anything of it (`learnt`) and whether it `changed`; of a thruster that
        only seems stronger, since another one of its axis is weaker, which that is (`mirrors`).
        """
        found = None if self._monitor is None else self._monitor.found
        return {
            "kind": "watch",
            "watched": not self.unwatched,
            "note": self._note(armed, found),
            "against": f"the identification of {self._simulation.vehicle.name}" if self._is_compared else "",
            "vehicle": self._simulation.vehicle.name,
            "seconds": 0.0 if found is None else found.seconds,
            "rows": self._rows,
            "causes": self._causes,
            "doubts": [] if found is None else found.doubts,
        }

    def _mirrored(self, found: Found) -> dict[str, str]:
        """Thrusters that only seem stronger, by quantity: the one of their axis whose loss theirs is the image of."""
        images = {}
        for change in self.changed:
            lost = change.reading
            for other in found.readings if lost.quantity.group and lost.value < 0.0 else []:
                same = other.quantity.group == lost.quantity.group and other.quantity != lost.quantity
                if same and other.value * lost.value < 0.0 and abs(other.value) > 2.0 * other.std:
                    images[other.quantity.name] = lost.quantity.name.partition(".")[2]
        return images

    def _forget(self) -> None:
        self._block = 0
        self._rows: list[dict[str, Any]] = []
        self._causes: list[str] = []
        self._in_a_row: dict[str, int] = {}
        self._announced: set[str] = set()
        self.changed: list[Change] = []

    def _fresh_lines(self) -> list[str]:
        """Changes and causes that are new; they are not new again."""
        lines = {change.reading.quantity.name: f"{change.difference} {SINCE}" for change in self.changed}
        lines |= {cause: cause for cause in self._causes}
        new = [line for key, line in lines.items() if key not in self._announced]
        self._announced |= lines.keys()
        doubts = [] if self._monitor is None or self._monitor.found is None else self._monitor.found.doubts
        return [f"in doubt ({'; '.join(doubts)}): {new[0]}", *new[1:]] if new and doubts else new

    def _note(self, armed: bool, found: Found | None) -> str:
        if self.unwatched:
            return f"Not watched: {self.unwatched}."
        if self._monitor is not None and self._monitor.trouble:
            return f"Stopped: {self._monitor.trouble}."
        if found is None or not self._rows:
            return BEGINS
        return f"{'This flight' if armed else 'The last flight'}, {found.seconds:.0f} s."

    def _rows_of(self, found: Found) -> list[dict[str, Any]]:
        known = None if self._monitor is None else self._monitor.reference
        names, images, rows = {c.reading.quantity.name for c in self.changed}, self._mirrored(found), []
        for i, reading in enumerate(found.readings):
            width = 0.0 if known is None or known[i] != known[i] else float(known[i])
            row, name = _row(reading, (reading.std**2 + width**2) ** 0.5), reading.quantity.name
            rows.append(row | {"changed": name in names, "mirrors": images.get(name, "")})
        order = list(dict.fromkeys(GROUPS.values()))
        return sorted(rows, key=lambda row: order.index(row["group"]))


def _row(reading: Reading, std: float) -> dict[str, Any]:
    """A quantity for the page, with the standard deviation of its difference to before."""
    difference, quantity = reading.with_values(reading.value, std), reading.quantity
    family, _, which = quantity.name.partition(".")
    alone = " (alone in its axis)" if family == "thruster" and len(quantity.group) < 2 else ""
    return {
        "name": quantity.name,
        "group": GROUPS[family],
        "seldom": family in SELDOM,
        "words": quantity.words.rstrip(","),
        "short": f"{which}{alone}" if which else quantity.words.rstrip(","),
        "figures": difference.figures,
        "interval": difference.interval,
        "unit": difference.scale[1],
        "learnt": reading.learnt,
    }
