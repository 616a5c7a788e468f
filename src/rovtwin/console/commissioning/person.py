"""The person at a page, seen from the process of a stage: questions go out over a pipe, answers come back."""

import itertools
import os
import signal
import threading
import time
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any

from rovtwin.links.host import writable

EVERY = 0.2  # between two messages of progress [s]
ENDING = 15.0  # longest time from STOP, or from the end of the console, until this process is ended [s]


class RemotePerson:
    """Whoever stands at the water with a page of the console. Once it is over, nothing more is asked.

    Attributes:
        over: Whether the console is gone, or somebody pressed STOP.
    """

    def __init__(self, pipe: Connection):
        self._pipe, self._sending = pipe, threading.Lock()
        self._answers: SimpleQueue[tuple[int, Any]] = SimpleQueue()
        self._numbers = itertools.count(1)
        self._shown, self._shown_at = "", 0.0
        self.over = False

    def attend(self) -> None:
        """Take answers from now on, in a thread; where the console is gone this process ends as by STOP."""
        threading.Thread(target=self._listen, daemon=True, name="answers").start()

    def confirm(self, question: str) -> bool:
        """Yes or no; only a yes that was given to this very question is one."""
        return self._asked("confirm", question, "") is True

    def number(self, question: str, unit: str) -> float | None:
        """A figure that only a person can read off, None: not to be had."""
        found = self._asked("number", question, unit)
        return None if isinstance(found, bool) or not isinstance(found, int | float) else float(found)

    def say(self, line: str) -> None:
        """A line to read now."""
        self.send("say", line)

    def progress(self, what: str, share: float | None = None) -> None:
        """What goes on; not more often than a page can show, and never so that a loop has to wait for it."""
        now = time.monotonic()
        if (what == self._shown and now - self._shown_at < EVERY) or not writable(self._pipe):
            return
        self._shown, self._shown_at = what, now
        self.send("progress", (what, share))

    def send(self, kind: str, content: Any) -> None:
        """A message to the console, which may be gone."""
        try:
            with self._sending:
                self._pipe.send((kind, content))
        except OSError:
            self.over = True

    def _asked(self, kind: str, question: str, unit: str) -> Any:
        """What was answered to a question; KeyboardInterrupt where it is over."""
        number = next(self._numbers)
        if self.over:
            raise KeyboardInterrupt
        self.send("question", {"id": number, "kind": kind, "text": question, "unit": unit})
        while True:
            answered, value = self._answers.get()
            if self.over:
                raise KeyboardInterrupt
            if answered == number:  # one to an earlier question is none
                return value

    def _listen(self) -> None:
        try:
            while True:
                kind, content = self._pipe.recv()
                if kind == "answer":
                    self._answers.put(content)
                elif kind == "stop":  # the signal comes by itself
                    self._end()
        except (EOFError, OSError):
            self._end()
            os.kill(os.getpid(), signal.SIGINT)
        time.sleep(ENDING)  # a stage that computes does not see the signal until it is through
        os.killpg(0, signal.SIGKILL)

    def _end(self) -> None:
        self.over = True
        self._answers.put((0, None))
