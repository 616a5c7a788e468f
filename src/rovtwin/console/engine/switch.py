"""The arm switch: what has to happen between an operator's request and thrust, and what takes it back."""

import numpy as np

from rovtwin.console.engine.flights import Event, Logbook
from rovtwin.core.errors import RovtwinError
from rovtwin.links.remote_link import RemoteLink


class ArmSwitch:
    """First the log is opened, then the vehicle is asked, then the log begins and commands go to the vehicle.

    Attributes:
        armed, arming: Whether commands go to the vehicle, and whether it is being asked to take them.
        stopped: Whether STOP was pressed since it was last armed.
    """

    def __init__(self, logbook: Logbook, event: Event):
        """`logbook` is of the flights; what becomes of a request is reported to `event`."""
        self._logbook, self._event = logbook, event
        self.armed = self.arming = self.stopped = False
        self._asked, self._asked_at = False, -np.inf  # whether the vehicle was asked, and when the operator did

    def ask(self, asked_at: float) -> None:
        """The operator wants thrust, and said so at a time [s, monotonic]; `go_on` does the rest."""
        self.arming, self._asked, self._asked_at = True, False, asked_at

    def off(self) -> bool:
        """No commands any more; whether there were, or would have been."""
        was, self.armed, self.arming = self.armed or self.arming, False, False
        return was

    def stop(self) -> bool:
        """Off, and said to be stopped; whether that is news."""
        news = self.off() or not self.stopped
        self.stopped = True
        return news

    def is_overtaken(self, link: RemoteLink) -> bool:
        """Whether the link's host was asked to stop since, past us."""
        return (self.armed or self.arming) and link.stopped_at > self._asked_at

    def go_on(self, link: RemoteLink, t: float) -> None:
        """The next step of arming, at a tick's time [s]; what came of it is an event."""
        if not self.arming or self._logbook.is_opening:
            return
        if not self._asked:
            self._asked = True
            link.begin_arming(self._asked_at)
            return
        if (refused := link.refused) is None:
            return
        self.arming = False
        try:
            if not refused:
                self._logbook.begin(t)
        except (RovtwinError, OSError) as error:
            link.stop()
            refused = f"the flight cannot be logged: {error}"
        if refused:
            self._event("danger", f"not armed: {refused}")
            self._logbook.close("not armed")
            return
        self.armed, self.stopped = True, False
        self._event("info", f"armed; logged in {self._logbook.folder}" if self._logbook.folder else "armed")
