"""A process that works for the web server: a thread of Python's own work would keep STOP waiting."""

import asyncio
import json
import math
import pickle
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

    def __init__(self, what: str, patience: float = math.inf, plain: bool = False):
        """A worker that is not started yet.

        Args:
            what: It does, for messages.
            patience: With one call [s], after which the process is ended.
            plain: It runs code of somebody else: answers come as JSON, errors as RovtwinError. To read a pickle is to
                import what it names.
        """
        self._what, self._patience, self._plain = what, patience, plain
        self._in_turn, self._starting = asyncio.Lock(), threading.Lock()
        self._waiting = self._ended = 0
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    async def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """What a function gives; it, what it takes and what it gives can be pickled.

        A call that is cancelled ends the process, too.

        Raises:
            RovtwinError: Others wait already, the process was killed, or the call took too long.
            Exception: That of the function; where it is plain, ValueError for an answer that is none.
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
        pipe.recv_bytes()
        return pipe

    def _answer(self, pipe: Connection) -> tuple[Any, Exception | None]:
        """In a thread."""
        answer = pipe.recv_bytes()
        if not self._plain:
            return pickle.loads(answer)
        found, error = json.loads(answer)
        return found, None if error is None else RovtwinError(str(error))

    def _started(self) -> Connection:
        """The pipe to the process, which is started where it does not run."""
        if self._pipe is None or self._process is None or not self._process.is_alive():
            self._process, self._pipe = started(_main, self._plain, name="rovtwin-worker", nice=NICE)
        return self._pipe


def _main(pipe: Connection, plain: bool) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    try:
        while True:
            function, arguments = pipe.recv()  # which imports what it needs
            pipe.send_bytes(b"begun")
            try:
                answer = function(*arguments), None
            except Exception as error:
                answer = None, error
            pipe.send_bytes(_packed(function, *answer, plain))
    except (EOFError, OSError):
        pass  # nobody is there to see


def _packed(function: Callable[..., Any], found: Any, error: Exception | None, plain: bool) -> Any:
    """An answer to be sent, as JSON where it is plain; of one that cannot be sent an error that says so."""
    pack: Callable[[Any], Any] = (lambda answer: json.dumps(answer).encode()) if plain else ForkingPickler.dumps
    if error is not None:
        return pack((None, _sendable(error, plain)))
    try:
        return pack((found, None))
    except Exception as unfit:
        name = getattr(function, "__qualname__", str(function))
        return pack((None, _sendable(RuntimeError(f"{name}: what it gives cannot be sent: {unfit}"), plain)))


def _sendable(error: Exception, plain: bool) -> Exception | str:
    text = "".join(traceback.format_exception(error))
    if plain:
        return str(error) if type(error).__module__ == RovtwinError.__module__ else text
    return error if travels(error) else RuntimeError(text)
