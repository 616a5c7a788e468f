"""Ctrl-C as a request that is granted between two chunks, so that a run ends with a whole log."""

import signal
import threading
from types import FrameType
from typing import Any


class Interrupt:
    """Context in which the first Ctrl-C (or SIGTERM) sets `asked`; a second one interrupts as usual."""

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Interrupt":
        # Signals reach the main thread only; elsewhere whoever owns the thread decides.
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._note)
        return self

    def _note(self, number: int, _: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
