"""A process of Python's own and the pipe to it: how it is started, and how it is ended."""

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from rovtwin.core.processes.urgent import start_below


def started(
    main: Callable[..., None], *arguments: Any, name: str, nice: int | None = None, daemon: bool = True
) -> tuple[BaseProcess, Connection]:
    """A new process, which dies with this one, and our end of the pipe to it.

    Args:
        main: What it runs: takes its end of the pipe, and the arguments.
        arguments: Can be pickled.
        name: Of the process.
        nice: How much below this one in priority it is; None: it is not.
        daemon: False for one that starts processes of its own. It does not die with this one by itself: it has to end
            when its pipe is closed.
    """
    context = multiprocessing.get_context("spawn")
    pipe, theirs = context.Pipe()
    process = context.Process(target=main, args=(theirs, *arguments), daemon=daemon, name=name)
    if nice is None:
        process.start()
    else:
        start_below(process, nice)
    theirs.close()  # or its end would never be seen closed here
    return process, pipe


def end(process: BaseProcess, pipe: Connection, patience: float) -> None:
    """Close the pipe, by which a process knows that it is over, and kill one that goes on [s]; may be called twice."""
    pipe.close()
    process.join(patience)
    if process.is_alive():
        process.kill()
        process.join()
