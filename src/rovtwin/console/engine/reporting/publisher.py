"""What the engine says: states, events, the plan and the set-up, to whoever listens."""

import time
from datetime import datetime
from typing import Any

import zmq

from rovtwin.console.wire import encode

STATES = 0.05  # between two states [s]
AGAIN = 1.0  # what does not change is reported as often, for who comes later [s]
EVENTS = 200  # kept


class Publisher:
    """Publishes; who does not read misses it, and gets nothing old.

    Attributes:
        events: The latest.
    """

    def __init__(self, address: str):
        self._socket = zmq.Context.instance().socket(zmq.PUB)
        self._socket.setsockopt(zmq.SNDHWM, 40)
        self._socket.setsockopt(zmq.LINGER, 200)
        self._socket.bind(address)
        self.events: list[dict[str, Any]] = []
        self._state_at = self._all_at = 0.0

    def publish(self, message: dict[str, Any]) -> None:
        try:
            self._socket.send(encode(message), zmq.NOBLOCK)
        except zmq.Again:
            pass

    def event(self, level: str, text: str, t: float) -> None:
        """Something that happened at time t [s]; `level` is info, warning or danger."""
        event = {"kind": "event", "t": t, "clock": f"{datetime.now():%H:%M:%S}", "level": level, "text": text}
        self.events = [*self.events[1 - EVENTS :], event]
        self.publish(event)

    def state_rests(self) -> float:
        """Until the next state is due [s]."""
        return self._state_at + STATES - time.monotonic()

    def state_due(self) -> bool:
        """Whether to tell one now."""
        if self.state_rests() > 0.0:
            return False
        self._state_at = time.monotonic()
        return True

    def all_due(self) -> bool:
        """Whether to tell again what does not change."""
        if self._state_at - self._all_at < AGAIN:
            return False
        self._all_at = self._state_at
        return True

    def close(self) -> None:
        self._socket.close()
