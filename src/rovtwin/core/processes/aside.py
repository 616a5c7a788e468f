"""Work that goes on beside: functions called one after the other in a process of their own."""

import pickle
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import Any

from rovtwin.core.errors import RovtwinError
from rovtwin.core.processes.child import end, started

Say = Callable[[str], None]
Task = Callable[[Say], Any]
"""Can be pickled, as its result can; it says what it is at."""


class Aside:
    """Tasks that run in order while their caller does something else; `result` gives what comes of each."""

    def __init__(self, tasks: Sequence[Task]):
        """Starts the process."""
        with _ctrl_c_ignored():
            self._process, self._pipe = started(_main, list(tasks), name="rovtwin-aside")

    def result(self, say: Say = lambda what: None) -> Any:
        """What the next task gives; waits for it, and passes on what it says.

        Raises:
            RovtwinError: The process was killed, or has no further task.
            Exception: That of the task; later ones are not begun.
        """
        while True:
            try:
                kind, content = self._pipe.recv()
            except (EOFError, OSError):
                self._process.join()
                code = self._process.exitcode
                how = f"exit code {code}" + (": is there memory left?" if code == -9 else "")
                raise RovtwinError(f"a process of rovtwin ended before its work was done ({how})") from None
            if kind == "says":
                say(content)
            elif kind == "failed":
                raise content
            else:
                return content

    def close(self) -> None:
        """End the process, whatever it is at."""
        end(self._process, self._pipe, 0.0)

    def __enter__(self) -> "Aside":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextmanager
def _ctrl_c_ignored() -> Iterator[None]:
    """What is started here ignores Ctrl-C from its first moment: while it imports, it would print a traceback."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are the main thread's
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _main(pipe: Connection, tasks: list[Task]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe

    def send(kind: str, content: Any) -> None:
        try:
            pipe.send((kind, content))
        except (EOFError, OSError):
            raise SystemExit from None  # nobody is there to see

    for task in tasks:
        try:
            found = task(lambda what: send("says", what))
        except Exception as error:
            send("failed", error if travels(error) else RuntimeError("".join(traceback.format_exception(error))))
            return
        send("gives", found)


def travels(error: Exception) -> bool:
    """Whether it comes out of a pipe as it went in: some want more arguments than they keep."""
    try:
        return isinstance(pickle.loads(pickle.dumps(error)), type(error))
    except Exception:
        return False
