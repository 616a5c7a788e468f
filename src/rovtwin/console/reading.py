"""A process that reads logs: parsing is Python's own work, and a thread of it would keep flying's messages waiting."""

import asyncio
import multiprocessing
import signal
import threading
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from rovtwin.core.errors import LogError
from rovtwin.core.log import Log


class Reader:
    """Reads one log at a time; the process is started by the first, or by `warm`, and ends with this one."""

    def __init__(self):
        self._one_at_a_time = threading.Lock()
        self._process: BaseProcess | None = None
        self._pipe: Connection | None = None

    async def read(self, path: Path) -> Log:
        """A log.

        Raises:
            LogError: As `Log.read`; or the process was killed.
        """
        return await asyncio.to_thread(self._read, path)

    def warm(self) -> None:
        """Start the process, if it does not run: somebody is about to choose a log."""
        if self._process is None or not self._process.is_alive():
            context = multiprocessing.get_context("spawn")
            self._pipe, theirs = context.Pipe()
            self._process = context.Process(target=_main, args=(theirs,), daemon=True, name="rovtwin-reader")
            self._process.start()
            theirs.close()  # or its end would never be seen closed here

    def close(self) -> None:
        """End the process; may be called twice."""
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = self._process = None

    def _read(self, path: Path) -> Log:
        with self._one_at_a_time:
            self.warm()
            pipe = self._pipe
            assert pipe is not None
            try:
                pipe.send(path)
                found = pipe.recv()
            except (EOFError, OSError):
                raise LogError(f"{path}: the process that reads it ended; is there memory left? Try again") from None
        if isinstance(found, LogError):
            raise found
        return found


def _main(pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who started it: that closes the pipe
    try:
        while True:
            path = pipe.recv()
            try:
                pipe.send(Log.read(path))
            except LogError as error:
                pipe.send(error)
    except (EOFError, OSError):
        pass  # nobody is there to read for
