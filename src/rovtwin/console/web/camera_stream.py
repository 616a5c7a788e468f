"""The camera's pictures for browsers: made while somebody looks, by a process of its own."""

import asyncio
import contextlib
import json
import math
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rovtwin.console.camera import Drawn, Pose, section_of
from rovtwin.console.pictures import Feed, Picture, PictureProcess
from rovtwin.console.video import Filmed
from rovtwin.core.errors import ConfigError
from rovtwin.core.vision import opencv
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle

BOUNDARY = "picture"
REST, LONGEST = 5.0, 60.0  # before a camera that failed is tried again, at first and at most [s]

Tell = Callable[[dict[str, Any]], None]


@dataclass
class Truth:
    """The newest true pose that an engine sent; picklable, it listens where it is first asked."""

    address: str
    _ear: Any = field(default=None, repr=False)

    def __call__(self) -> Pose | None:
        import zmq

        if self._ear is None:
            self._ear = zmq.Context.instance().socket(zmq.SUB)
            self._ear.setsockopt(zmq.RCVHWM, 4)
            self._ear.setsockopt(zmq.SUBSCRIBE, b'{"kind":"state"')
            self._ear.connect(self.address)
        newest = None
        while self._ear.poll(0):
            newest = self._ear.recv()
        state = json.loads(newest) if newest else {}
        if not state.get("truth"):
            return None
        return state["t"], np.array(state["truth"])


def feed_of(scenario: Scenario, vehicle: Vehicle, is_twin: bool, news: str, camera: str | None) -> Feed:
    """Where pictures come from: a camera's own stream, or what a twin's camera sees.

    Args:
        scenario: That is flown.
        vehicle: That carries the camera.
        is_twin: Whether the vehicle is computed.
        news: Address at which the engine tells where it is.
        camera: Address of the stream, if there is one.

    Raises:
        ConfigError: There are none; says why, and what to do.
    """
    if camera is not None:
        opencv("a camera's picture")
        return Filmed(camera, scenario.cameras[0].scene if scenario.cameras else None)
    if is_twin:
        return Drawn(section_of(scenario, vehicle), vehicle, Truth(news))
    raise ConfigError("no camera over this link; give the address of its stream, as --camera rtsp://HOST:8554/test")


class Stream:
    """Hands the newest picture of a feed to all who look.

    Attributes:
        why: Why there are no pictures, "" if there are, or may be.
    """

    def __init__(self, feed: Feed | None, why: str, send: Tell, keep: Tell):
        """`send` tells pages of the markers in each picture, `keep` those to come, too, whether there may be any.

        Without a feed `why` says why not.
        """
        self._feed, self.why, self._send, self._keep = feed, why, send, keep
        self._lookers, self._picture = 0, None
        self._news = asyncio.Condition()
        self._task: asyncio.Task[None] | None = None
        self._rest, self._again = REST, -math.inf
        self._say()

    def _say(self) -> None:
        self._keep({"kind": "camera", "live": self._feed is not None, "why": self.why})

    @property
    def rests(self) -> bool:
        """Whether nothing is to be had now: there is no camera, or it failed and is tried again later."""
        return self._feed is None or time.monotonic() < self._again

    async def parts(self) -> AsyncIterator[bytes]:
        """Pictures as parts of a multipart answer, as long as somebody takes them."""
        self._lookers += 1
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._draw())
        try:
            while True:
                async with self._news:
                    await self._news.wait()
                    picture: Picture | None = self._picture
                if picture is None:
                    return
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(picture.jpeg)}\r\n\r\n"
                yield head.encode() + picture.jpeg + b"\r\n"
        finally:
            self._lookers -= 1

    async def _draw(self) -> None:
        """Until nobody looks, or there are no more; also for who comes while a process ends."""
        assert self._feed is not None
        try:
            while self._lookers and not self.rests:
                process = await asyncio.to_thread(PictureProcess, self._feed)
                try:
                    await self._hand_out(process)
                finally:
                    await asyncio.to_thread(process.close)  # it may take seconds, and STOP must not wait
        except OSError as error:  # no more processes, or no memory
            self._found(f"the camera's process cannot be started ({error.strerror})")
        finally:
            with contextlib.suppress(RuntimeError):
                await self._tell(None)

    async def _hand_out(self, process: PictureProcess) -> None:
        while self._lookers and not process.why:
            picture = await asyncio.to_thread(process.newest)
            if picture is None:
                await asyncio.sleep(0.01)
                continue
            await self._tell(picture)
            self._send({"kind": "sight", "markers": picture.markers, "picture": list(picture.size)})
            self._found("")
        if self._lookers:
            self._found(process.why)

    def _found(self, why: str) -> None:
        """Pictures come, or do not; who fails again and again is asked ever more seldom."""
        self._again = time.monotonic() + self._rest if why else -math.inf
        self._rest = min(2.0 * self._rest, LONGEST) if why else REST
        if why != self.why:
            self.why = why
            self._say()

    async def _tell(self, picture: Picture | None) -> None:
        async with self._news:
            self._picture = picture
            self._news.notify_all()
