"""A process that works for the web server: a thread of Python's own work would keep STOP waiting."""

import asyncio
import math
import signal
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from typing import Any

from rovtwin.core.errors import RovtwinError
from rovtwin.core.processes.aside import travels
from rovtwin.core.processes.child import started

NICE = 5
MOST_WAITING = 16  # calls at a time, with the one that is worked on
STARTING = 120.0  # longest wait for a process to begin: it imports what it calls, below all others in priority [s]


class Worker:
    """Calls functions in a process of its own, one after the other.

    The process is below this one in priority. It is started by the first call, or by `warm`, and ends with this one.
    """

    def __init__(self, what: str, patience: float = math.inf):
        """`what` it does is for messages; `patience` with one call [s], after which the process is ended."""
        self._what, self._patience = what, patience
        self._in_turn, self._starting = asyncio.Lock(), threading.Lock()
        self._waiting = self._ended = 0
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    async def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """What a function gives; it, what it takes and what it gives can be pickled.

        A call that is cancelled ends the process, too.

        Raises:
            RovtwinError: Others wait already, the process was killed, or the call took too long.
            Exception: That of the function.
        """
        if self._waiting >= MOST_WAITING:
            raise RovtwinError(f"{self._what}: {self._waiting} others wait already. Try again in a moment")
        self._waiting += 1
        try:
            async with self._in_turn:
                return await self._called(function, arguments)
        finally:
            self._waiting -= 1

    def warm(self) -> None:
        """Start the process, if it does not run."""
        with self._starting:
            self._started()

    def close(self) -> None:
        """End the process, whatever it is at; may be called twice."""
        with self._starting:
            process, self._process = self._process, None
            self._ended += 1
        if process is not None:
            process.kill()  # who waits for its answer sees the end of the pipe

    async def _called(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        limit = STARTING
        try:
            async with asyncio.timeout(limit):
                pipe = await asyncio.to_thread(self._ask, self._ended, function, arguments)
            limit = self._patience
            async with asyncio.timeout(None if math.isinf(limit) else limit):
                found, error = await asyncio.to_thread(self._answer, pipe)
        except TimeoutError:
            self.close()
            raise RovtwinError(f"{self._what}: found no end within {limit:g} s, and gave up") from None
        except asyncio.CancelledError:
            self.close()
            raise
        except (EOFError, OSError):
            self.close()
            raise RovtwinError(f"{self._what}: its process ended; is there memory left? Try again") from None
        if error is not None:
            raise error
        return found

    def _ask(self, ended: int, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Connection:
        """In a thread: the pipe from which the answer will come, once the call has begun.

        `ended`: how often the process had been ended when this was asked for.
        """
        with self._starting:
            if ended != self._ended:  # in the meantime: nobody waits any more
                raise EOFError
            pipe = self._started()
        pipe.send((function, arguments))
        pipe.recv()
        return pipe

    @staticmethod
    def _answer(pipe: Connection) -> tuple[Any, Exception | None]:
        """In a thread."""
        return pipe.recv()

    def _started(self) -> Connection:
        """The pipe to the process, which is started where it does not run."""
        if self._pipe is None or self._process is None or not self._process.is_alive():
            self._process, self._pipe = started(_main, name="rovtwin-worker", nice=NICE)
        return self._pipe


def _main(pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    try:
        while True:
            function, arguments = pipe.recv()  # which imports what it needs
            pipe.send("begun")
            try:
                answer = function(*arguments), None
            except Exception as error:
                answer = None, error if travels(error) else RuntimeError("".join(traceback.format_exception(error)))
            _send(pipe, function, answer)
    except (EOFError, OSError):
        pass  # nobody is there to see


def _send(pipe: Connection, function: Callable[..., Any], answer: tuple[Any, Exception | None]) -> None:
    """Send an answer; of one that cannot be pickled an error that says so."""
    try:
        packed = ForkingPickler.dumps(answer)
    except Exception as error:
        name = getattr(function, "__qualname__", str(function))
        packed = ForkingPickler.dumps((None, RuntimeError(f"{name}: what it gives cannot be sent: {error}")))
    pipe.send_bytes(packed)
