"""The camera's pictures for browsers: drawn while somebody looks, by a process of its own."""

import asyncio
import contextlib
import json
import math
import time
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rovtwin.console.camera import CameraProcess, Picture, Pose, section_of
from rovtwin.core.errors import ConfigError
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Vehicle

BOUNDARY = "picture"
REST = 10.0  # before a camera that failed is tried again [s]

Sight = Callable[[dict[str, Any]], None]


@dataclass
class Truth:
    """The newest true pose that an engine told; picklable, it listens where it is first asked."""

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


class Stream:
    """Hands the camera's newest picture to all who look."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, address: str, sight: Sight, say: Callable[[str], None]):
        """`sight` is told of the markers in each picture, `say` why there are none any more."""
        self._vehicle, self._truth, self._sight, self._say = vehicle, Truth(address), sight, say
        self._lookers, self._picture = 0, None
        self._news = asyncio.Condition()
        self._task: asyncio.Task[None] | None = None
        self._why, self._again = "", -math.inf
        try:
            self._section = section_of(scenario, vehicle)
        except ConfigError as error:
            self._why, self._again = str(error), math.inf

    @property
    def why_not(self) -> str:
        """Why there is no picture now, "" if there can be one."""
        return self._why if time.monotonic() < self._again else ""

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
        """Until nobody looks."""
        try:
            camera = await asyncio.to_thread(CameraProcess, self._section, self._vehicle, self._truth)
            with camera:
                while self._lookers and not camera.why:
                    picture = await asyncio.to_thread(camera.newest)
                    if picture is None:
                        await asyncio.sleep(0.01)
                        continue
                    await self._tell(picture)
                    self._sight({"kind": "sight", "markers": picture.markers, "picture": list(picture.size)})
                if self._lookers:
                    self._why, self._again = camera.why, time.monotonic() + REST
                    self._say(f"no picture from the camera: {camera.why}")
        finally:
            with contextlib.suppress(RuntimeError):
                await self._tell(None)

    async def _tell(self, picture: Picture | None) -> None:
        async with self._news:
            self._picture = picture
            self._news.notify_all()
