"""XLA's banner about slow compiling kept off the terminal; all else that it writes passes, errors above all.

The banner is an error to XLA's own log, which C++ writes to file descriptor 2 two minutes into a compilation: a level
that hides it hides errors too. So while a compilation is a long one, what comes by the descriptor goes through a thread
that leaves the banner's lines out. What Python writes to `sys.stderr` goes past it.
"""

import os
import sys
import threading
from collections.abc import Callable
from typing import Any

BEGINS = "/jax/compilation_cache/compile_requests_use_cache"
ENDS = "/jax/core/compile/backend_compile_duration"
LONG = 20.0  # [s] from which a compilation is looked at; XLA's alarm comes after more than that


class Banner:
    """Lines of a stream without those of the banner."""

    def __init__(self) -> None:
        self._inside = False

    def passes(self, line: bytes) -> bool:
        """Whether a line is none of the banner's; empty lines next to it belong to it."""
        bare = line.strip()
        own = b"slow_operation_alarm.cc" in bare or b"Very slow compile?" in bare
        own = own or (self._inside and (not bare or not bare.strip(b"*")))
        self._inside = own
        return not own


class Quiet:
    """File descriptor 2 without the banner, while compilations that take long go on."""

    def __init__(self, after: float = LONG) -> None:
        self._after, self._lock = after, threading.Lock()
        self._going: dict[int, threading.Timer] = {}  # by thread
        self._restore: Callable[[], None] | None = None

    def begins(self, event: str, **_: Any) -> None:
        """Told of events by `jax.monitoring`."""
        if event == BEGINS:
            timer = threading.Timer(self._after, self._close)
            timer.daemon = True
            with self._lock:
                if (old := self._going.pop(threading.get_ident(), None)) is not None:
                    old.cancel()
                self._going[threading.get_ident()] = timer
            timer.start()

    def ends(self, event: str, duration_secs: float, **_: Any) -> None:
        """Told of durations by `jax.monitoring`."""
        if event == ENDS:
            with self._lock:
                timer = self._going.pop(threading.get_ident(), None)
                if timer is not None:
                    timer.cancel()
                if not self._going and self._restore is not None:
                    self._restore()
                    self._restore = None

    def _close(self) -> None:
        with self._lock:
            if self._going and self._restore is None:
                self._restore = _filtered()


def _filtered() -> Callable[[], None]:
    """Put a filter behind descriptor 2; what it returns takes it away again."""
    try:
        kept = os.dup(2)
    except OSError:  # there is none
        return lambda: None
    end, entry = os.pipe()
    own, by_name = sys.stderr, _writes_there(sys.stderr)
    if by_name:
        sys.stderr = open(os.dup(kept), "w", buffering=1, encoding=own.encoding, errors=own.errors)
    os.dup2(entry, 2)
    os.close(entry)
    reader = threading.Thread(target=_pass_on, args=(end, kept), daemon=True)
    reader.start()

    def restore() -> None:
        os.dup2(kept, 2)
        if by_name:
            sys.stderr.flush()
            sys.stderr = own
        reader.join(1.0)  # a child process that began meanwhile may still hold the other end: then it goes on

    return restore


def _writes_there(stream: Any) -> bool:
    try:
        return stream.fileno() == 2
    except (AttributeError, OSError, ValueError):
        return False


def _pass_on(end: int, to: int) -> None:
    banner = Banner()
    with os.fdopen(end, "rb") as stream, os.fdopen(to, "wb", buffering=0) as out:
        for line in stream:
            if banner.passes(line):
                out.write(line)
