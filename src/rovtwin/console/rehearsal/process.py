"""The process that rehearses plans, below all others in priority: neither the autopilot nor the pages wait for it.

What it has compiled serves the next plan, too: it lives as long as the web server.
"""

import signal
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from rovtwin.console.rehearsal.request import Request
from rovtwin.core.arrays.flat import Layout
from rovtwin.core.datum import utc_now
from rovtwin.core.errors import RovtwinError
from rovtwin.core.processes.child import end, started
from rovtwin.runs.ensemble.forecast import forecast
from rovtwin.runs.ensemble.rehearsal import DRAWS, Rehearsal
from rovtwin.runs.feasibility.mission import judge
from rovtwin.runs.loop import SHORT
from rovtwin.scenario.schema import Scenario

NICE = 15
ENDING = 1.0  # a process that does not end by itself in this time is killed [s]
READING = "reading vehicle and water"
FLYING = "compiling and flying the vehicle as it is known"
DRAWN = f"flying {DRAWS} drawn vehicles"


class Superseded(Exception):
    """A newer request has come."""


class RehearsalProcess:
    """The process, seen from the web server."""

    def __init__(self, scenario: Scenario):
        self._process, self._pipe = started(_main, scenario, name="rovtwin-rehearsal", nice=NICE)

    def ask(self, request: Request) -> None:
        """Rehearse this, and nothing that was asked for before.

        Raises:
            OSError: The process is gone.
        """
        self._pipe.send(request)

    def answer(self, patience: float) -> tuple[int, dict[str, Any]] | None:
        """The next answer and the number of its request: `doing` with a `share` or None, `forecast` with `whole`, or
        `error`. None: nothing within `patience` [s].

        Raises:
            EOFError, OSError: The process is gone.
        """
        return self._pipe.recv() if self._pipe.poll(patience) else None

    def close(self) -> None:
        """End the process."""
        end(self._process, self._pipe, ENDING)


def _main(pipe: Connection, scenario: Scenario) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    fast = FastProgram()
    try:
        while True:
            request: Request = pipe.recv()
            if pipe.poll():  # a newer one waits already
                continue
            try:
                Rehearsing(pipe, request).run(scenario, fast)
            except Superseded:
                pass
            except RovtwinError as error:
                pipe.send((request.number, {"error": str(error)}))
            except (EOFError, OSError):
                raise
            except Exception as error:  # a mistake of ours: said there, where a user looks
                pipe.send((request.number, {"error": f"the rehearsal failed ({type(error).__name__}: {error})"}))
    except (EOFError, OSError):
        pass  # nobody is there to see


class FastProgram:
    """The optimised program of the flights, compiled or found in a thread of its own while others fly without it."""

    def __init__(self) -> None:
        self._layout: Layout | None = None
        self._ready = threading.Event()

    def begin(self, rehearsal: Rehearsal) -> None:
        """Have it from some time on, unless it is there or on its way."""
        layout = Layout(rehearsal.base.loop)
        if layout != self._layout:
            self._layout, self._ready = layout, threading.Event()
            threading.Thread(target=self._compile, args=(rehearsal, self._ready), daemon=True).start()

    @staticmethod
    def _compile(rehearsal: Rehearsal, ready: threading.Event) -> None:
        rehearsal.optimise()
        ready.set()

    def short(self) -> int:
        """From which tick on a flight that begins now is flown by it."""
        return 0 if self._ready.is_set() else SHORT


class Rehearsing:
    """One request: what is done of it goes into the pipe."""

    def __init__(self, pipe: Connection, request: Request):
        self._pipe, self._request = pipe, request

    def run(self, scenario: Scenario, fast: "FastProgram") -> None:
        """To the end.

        Raises:
            Superseded: A newer request has come.
            ConfigError: It cannot be flown.
        """
        request, began = self._request, time.monotonic()
        self._doing(READING)
        charge, charge_by = charge_of(request, scenario)
        rehearsal = Rehearsal(request.scenario(scenario), charge)
        beside = self._beside(scenario, charge_by if rehearsal.supply.sources else _without_battery(rehearsal))
        if refused := [one.line for one in judge(rehearsal.scenario, rehearsal.base.model) if one.refused]:
            raise RovtwinError("; ".join(refused))
        self._doing(FLYING)
        nominal = rehearsal.nominal(self._follow(FLYING))
        self._tell(forecast(rehearsal, nominal) | beside | {"whole": False, "took_s": time.monotonic() - began})
        fast.begin(rehearsal)
        drawn = rehearsal.drawn(self._follow(DRAWN), short=fast.short)
        self._tell(forecast(rehearsal, nominal, drawn) | beside | {"whole": True, "took_s": time.monotonic() - began})

    def _beside(self, scenario: Scenario, charge_by: str) -> dict[str, Any]:
        """What the request adds to a forecast."""
        request = self._request
        return {
            "number": request.number,
            "utc": utc_now(),
            "rows": list(request.rows),
            "heading_deg": request.heading_deg,
            "water": request.words(scenario),
            "floor_by": request.floor_by(scenario),
            "charge_by": charge_by,
        }

    def _follow(self, what: str) -> Callable[[float], None]:
        def follow(share: float) -> None:
            self._doing(what, share)

        return follow

    def _doing(self, what: str, share: float | None = None) -> None:
        if self._pipe.poll():
            raise Superseded
        self._pipe.send((self._request.number, {"doing": what, "share": share}))

    def _tell(self, data: dict[str, Any]) -> None:
        self._pipe.send((self._request.number, {"forecast": data}))


def charge_of(request: Request, scenario: Scenario) -> tuple[float, str]:
    """Charge of the emptiest battery at the start, 0 to 1, and what it is known by."""
    if request.charge is not None:
        return request.charge, f"{100.0 * request.charge:.0f} % at the start, by the gauge"
    if scenario.battery is None or not request.is_twin:
        return 1.0, "taken as full at the start: no gauge is on board"
    given = scenario.battery.charge
    least = min(given.values(), default=1.0) if isinstance(given, dict) else given
    return least, f"{100.0 * least:.0f} % at the start, by the scenario: no gauge is on board"


def _without_battery(rehearsal: Rehearsal) -> str:
    name = rehearsal.base.vehicle.name
    return f"{name}'s file has no battery: energy is that of the thrusters alone, and what is left is not known"
