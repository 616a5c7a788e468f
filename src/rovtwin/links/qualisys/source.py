"""Listening to a QTM, real or served, through the vendor's qtm-rt."""

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import LinkError
from rovtwin.core.extras import require
from rovtwin.links.background import BackgroundSource
from rovtwin.links.clock import ClockMap
from rovtwin.links.qualisys import wire
from rovtwin.links.qualisys.guarded import guarded_protocol
from rovtwin.links.qualisys.poses import Lab
from rovtwin.links.qualisys.server import PORT

PATIENCE = 5.0  # for a connection, an answer, and between two frames [s]
SENSORS = ("mocap", "position", "attitude")
NOT_ROUND = 1e-2  # a matrix that differs from a rotation by more is nonsense


class QtmSource(BackgroundSource):
    """Readings of one rigid body: `mocap` (eta in n [m, rad], shape (6,)), and what autopilots know: `position` (north
    and east [m], shape (2,)) and `attitude` (zyx Euler [rad], shape (3,)).

    Orientations come as matrices, so that the definition of Euler angles set in QTM does not matter. A body that is
    lost is quiet. Times are QTM's own, mapped to our clock.

    Args:
        host: Address of the computer that runs QTM.
        body: Name of the rigid body; may be left out where there is one only.
        port: QTM's port for little endian.
        clock: Our clock [s].
        lab: Where the lab's frame lies in n.
        sensors: Which of the readings.
        rate: Frames a second that are asked for; None for all.

    Raises:
        LinkError: qtm-rt is not installed, or there is no such sensor or port.
    """

    def __init__(
        self,
        host: str,
        body: str | None = None,
        port: int = PORT,
        clock: Callable[[], float] = time.monotonic,
        lab: Lab | None = None,
        sensors: Sequence[str] = ("mocap", "position"),
        rate: int | None = None,
    ):
        where = f"qtm://{host}:{port}" + (f"/{body}" if body else "")
        # Needed in the thread: said now when it is not there.
        require("qtm_rt", "qualisys", f"{where}: the vendor's client", LinkError)
        if wrong := sorted(set(sensors) - set(SENSORS)):
            raise LinkError(f"{where}: {wrong[0]}: no such reading; expected some of {', '.join(SENSORS)}")
        self.provides = frozenset(sensors) - {"mocap"}
        super().__init__(where, port, clock)
        self._address, self._body = (host, port), body
        self._lab, self._sensors = lab or Lab(), tuple(sensors)
        self._frames = "allframes" if rate is None else f"frequency:{int(rate)}"
        self._map = ClockMap.to(clock)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: asyncio.Event | None = None
        self._protocol: Any = None
        self._index = 0
        self._received_at = 0.0
        logging.getLogger("qtm_rt").setLevel(logging.CRITICAL)  # it logs every connection that fails; `status` tells
        self._thread.start()

    def _interrupt(self) -> None:
        loop, end = self._loop, self._end
        if loop is not None and end is not None:
            with contextlib.suppress(RuntimeError):  # the loop has just ended by itself
                loop.call_soon_threadsafe(end.set)

    def _visit(self) -> None:
        asyncio.run(self._listen())

    async def _listen(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        self._protocol = None
        try:
            if await self._unless_ended(self._connect(), PATIENCE):
                self._received_at = time.monotonic()
                while time.monotonic() - self._received_at <= PATIENCE:
                    with contextlib.suppress(TimeoutError):
                        await asyncio.wait_for(self._end.wait(), 0.5)
                        break
                else:
                    raise LinkError(f"no frames for {PATIENCE:g} s")
        finally:
            if self._protocol is not None:
                self._protocol.drop()
        if self._protocol is not None and self._protocol.failure is not None:
            raise self._protocol.failure

    async def _unless_ended(self, doing: Coroutine[Any, Any, None], patience: float) -> bool:
        """Do something that must not take longer than `patience` [s]; False when the end came first."""
        assert self._end is not None
        if self._closed.is_set():
            doing.close()
            return False
        tasks = [asyncio.ensure_future(doing), asyncio.ensure_future(self._end.wait())]
        done, _ = await asyncio.wait(tasks, timeout=patience, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        if not done:
            raise LinkError(f"does not answer as QTM does within {patience:g} s")
        if tasks[0] in done:
            tasks[0].result()
        return tasks[0] in done

    async def _connect(self) -> None:
        """Greetings, names of bodies, and the stream started."""
        from qtm_rt.protocol import QRTCommandException
        from qtm_rt.qrt import QRTConnection

        assert self._loop is not None and self._end is not None
        end = self._end
        host, port = self._address
        _, protocol = await self._loop.create_connection(lambda: guarded_protocol(lambda _: end.set()), host, port)
        self._protocol = protocol
        try:
            await protocol.set_version("1.25")
            connection = QRTConnection(protocol, timeout=PATIENCE)
            self._index = self._find(wire.body_names(await connection.get_parameters(["6d"])))
            await connection.stream_frames(self._frames, ["6dres"], on_packet=self._take)
        except QRTCommandException as error:
            raise LinkError(f"refuses: {error}") from None

    def _find(self, names: list[str]) -> int:
        known = ", ".join(name.encode("ascii", "backslashreplace").decode() for name in names[:20]) or "none"
        if self._body is None and len(names) == 1:
            return 0
        if self._body is None or self._body not in names:
            problem = "a body must be named" if self._body is None else f"no rigid body '{self._body}'"
            raise LinkError(
                f"{problem}; QTM has: {known}. Mend the link's address (qtm://HOST/BODY) or the project in QTM"
            )
        return names.index(self._body)

    def _take(self, packet: Any) -> None:
        """A frame, called by the vendor's client."""
        arrival = self.clock()
        self._received_at = time.monotonic()
        self._reached()
        found = packet.get_6d_residual()
        if found is None or len(found[1]) <= self._index:
            self.dropped += 1
            return
        position, rotation, _ = found[1][self._index]
        t_valid = self._map(1e-6 * packet.timestamp, arrival)
        place, R = 1e-3 * np.array(position, dtype=float), np.array(rotation.matrix, dtype=float).reshape(3, 3).T
        if np.isnan(place).any() or np.isnan(R).any():
            return  # lost
        if not (np.isfinite(place).all() and _is_rotation(R)):
            self.dropped += 1
            return
        eta = self._lab.to_eta(place, R)
        for sensor, value in (("mocap", eta), ("position", eta[:2]), ("attitude", eta[3:])):
            if sensor in self._sensors:
                self._keep(sensor, value, t_valid)


def _is_rotation(R: Float[np.ndarray, "3 3"]) -> bool:
    sane = bool((np.abs(R) < 2.0).all())
    return sane and np.allclose(R @ R.T, np.eye(3), atol=NOT_ROUND) and bool(np.linalg.det(R) > 0.0)
