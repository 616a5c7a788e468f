"""Who flies: this process, worker processes on this machine, or dask workers elsewhere.

Each gives the rows of portions of samples as they come, until asked to stop.
"""

import asyncio
import logging
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Protocol

from rovtwin._version import __version__
from rovtwin.campaign.flying import Row, fly_samples
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.extras import installed, require
from rovtwin.core.trust import consent

Stopped = Callable[[], bool]
PATIENCE = 0.3  # how long a request to stop may go unnoticed [s]
CONNECT = "10s"  # within which a scheduler has to answer
AHEAD = 3  # portions handed over for each core, so that none waits


class Workers(Protocol):
    """Those who fly.

    Attributes:
        cores: How many portions fly at the same time, as far as known now.
        description: What they are, for people.
    """

    description: str

    @property
    def cores(self) -> int: ...

    def fly(self, text: str, portions: list[list[int]], lanes: int, stopped: Stopped) -> Iterator[list[Row]]:
        """Rows of each portion, in whatever order they come; ends early once `stopped()`.

        Args:
            text: The complete campaign as JSON.
            portions: Numbers of samples.
            lanes: How many of them side by side.
            stopped: Asked often.
        """
        ...


class _Stop(Exception):
    """Ends a flight half-way."""


class Here:
    """This process, one portion after the other."""

    description, cores = "this process", 1

    def fly(self, text: str, portions: list[list[int]], lanes: int, stopped: Stopped) -> Iterator[list[Row]]:
        """See `Workers`."""

        def look() -> None:
            if stopped():
                raise _Stop

        for portion in portions:
            if stopped():
                return
            try:
                rows = fly_samples(text, portion, lanes, __version__, look)
            except _Stop:
                return
            yield rows


class Dask:
    """The workers of a dask scheduler; a portion whose worker dies is flown by another."""

    def __init__(self, client: Any, description: str):
        self._client, self.description = client, description

    @property
    def cores(self) -> int:
        return sum(self._client.nthreads().values())

    def fly(self, text: str, portions: list[list[int]], lanes: int, stopped: Stopped) -> Iterator[list[Row]]:
        """See `Workers`."""
        from distributed import wait

        waiting, flying = iter(portions), set()
        try:
            while not stopped():
                for portion in waiting:
                    work = (fly_samples, text, portion, lanes, __version__)
                    flying.add(self._client.submit(*work, pure=False, consent=consent()))
                    if len(flying) >= max(AHEAD * self.cores, 8):
                        break
                if not flying:
                    return
                try:
                    waited: Any = wait(list(flying), timeout=PATIENCE, return_when="FIRST_COMPLETED")
                except TimeoutError:
                    continue
                for future in waited.done:
                    flying.discard(future)
                    yield _result(future, self.description)
        finally:
            with suppress(OSError):  # a scheduler that is gone flies nothing any more
                self._client.cancel(list(flying), force=True)


def _result(future: Any, description: str) -> list[Row]:
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    try:
        return future.result()
    except KilledWorker:
        raise RovtwinError(
            f"{description}: workers died again and again over the same samples, perhaps for want of memory. "
            "What is flown is kept; run the same command again, with smaller --lanes or fewer workers on a machine"
        ) from None
    except (CommClosedError, OSError, CancelledError, asyncio.CancelledError) as error:
        raise RovtwinError(
            f"{description}: lost ({error}). What is flown is kept; run the same command again"
        ) from None


@contextmanager
def _closing(one: Any) -> Iterator[Any]:
    """A client or cluster, closed at the end.

    Workers that do not end in time (a mission is not left half-way) must not spoil what was flown; those of this
    machine die with this process.
    """
    try:
        yield one
    finally:
        with suppress(OSError):  # TimeoutError and broken connections are such
            one.close()


@contextmanager
def on_this_machine(count: int) -> Iterator[Workers]:
    """`count` worker processes, one core each; 1: this process does it."""
    if count == 1:
        yield Here()
        return
    require("distributed", "campaign", "a campaign of several processes")
    from distributed import Client, LocalCluster

    options: dict[str, Any] = {"memory_limit": 0, "dashboard_address": "127.0.0.1:0", "silence_logs": logging.ERROR}
    with ExitStack() as stack:
        cluster = stack.enter_context(_closing(LocalCluster(n_workers=count, threads_per_worker=1, **options)))
        client = stack.enter_context(_closing(Client(cluster)))
        client.run(_leave_ctrl_c)
        yield Dask(client, f"{count} processes on this machine")


def _leave_ctrl_c() -> None:
    """A terminal sends Ctrl-C to all processes; only the one that keeps the results decides what it means."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def at_scheduler(address: str) -> Iterator[Workers]:
    """The workers of a running dask scheduler.

    Raises:
        ConfigError: Nobody answers there.
    """
    require("distributed", "campaign", "a campaign of several processes")
    from distributed import Client

    try:
        client = Client(address, timeout=CONNECT)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigError(
            f"--scheduler {address}: nobody answers there ({str(error).splitlines()[0] or type(error).__name__}); "
            "expected the address that `dask scheduler` prints, such as tcp://10.0.0.5:8786"
        ) from None
    with _closing(client):
        yield Dask(client, f"dask workers at {address}")


@contextmanager
def on_slurm(jobs: int) -> Iterator[Workers]:
    """Workers as SLURM jobs; queue, account, cores and time are those of dask-jobqueue's own configuration.

    Raises:
        ConfigError: dask-jobqueue is not installed or not configured, or SLURM is not there.
    """
    require("distributed", "campaign", "a campaign of several processes")
    if not installed("dask_jobqueue"):
        raise ConfigError(
            "--slurm: needs the package dask-jobqueue, which is not installed. Install it (pip install dask-jobqueue), "
            "or start `dask scheduler` and `dask worker` in jobs of your own and give --scheduler tcp://HOST:8786"
        )
    from dask_jobqueue import SLURMCluster  # type: ignore[import-not-found]  (an extra of the user's own)
    from distributed import Client

    with ExitStack() as stack:
        try:
            cluster = stack.enter_context(_closing(SLURMCluster()))
            cluster.scale(jobs=jobs)
        except (ValueError, OSError, RuntimeError) as error:
            raise ConfigError(
                f"--slurm: {error}. Say cores, memory, queue and walltime under jobqueue: slurm: in "
                "~/.config/dask/jobqueue.yaml"
            ) from None
        yield Dask(stack.enter_context(_closing(Client(cluster))), f"{jobs} SLURM jobs")
