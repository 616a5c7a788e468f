"""Work that goes on beside: functions called one after the other in a process of their own."""

import multiprocessing
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

Say = Callable[[str], None]
Task = Callable[[Say], Any]
"""Can be pickled, as its result can; it says what it is at."""


class Aside:
    """Tasks that run in order while their caller does something else; `result` gives what comes of each."""

    def __init__(self, tasks: Sequence[Task]):
        """Starts the process."""
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_main, args=(theirs, list(tasks)), daemon=True, name="rovtwin-aside")
        self._process.start()
        theirs.close()  # or its end would never be seen closed here

    def result(self, say: Say = lambda what: None) -> Any:
        """What the next task gives; waits for it, and passes on what it says.

        Raises:
            RuntimeError: The process was killed.
            Exception: That of the task; later ones are not begun.
        """
        while True:
            try:
                kind, content = self._pipe.recv()
            except (EOFError, OSError):
                raise RuntimeError(
                    "a process of rovtwin ended before its work was done; is there memory left?"
                ) from None
            if kind == "says":
                say(content)
            elif kind == "failed":
                raise content
            else:
                return content

    def close(self) -> None:
        """End the process, whatever it is at."""
        self._pipe.close()
        self._process.kill()
        self._process.join()

    def __enter__(self) -> "Aside":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _main(pipe: Connection, tasks: list[Task]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    try:
        for task in tasks:
            pipe.send(("gives", task(lambda what: pipe.send(("says", what)))))
    except (EOFError, OSError):
        pass  # nobody is there to see
    except Exception as error:
        pipe.send(("failed", error))
