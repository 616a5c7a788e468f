"""What lies under the plan on the chart: maps of the user's own, and tracks of earlier dives."""

import asyncio
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from fastapi import Response
from nicegui import app

from rovtwin.console.chart.maps import LEVELS, MapFile, tile
from rovtwin.console.chart.tracks import track_of
from rovtwin.console.replays.shelf import Shelf
from rovtwin.console.web.hub import Hub
from rovtwin.console.worker import Worker
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.scenario.schema import Scenario

READING = 60.0  # longest wait for a log, or a tile [s]
MOST_BYTES = 32_000_000  # of tiles that are kept
MOST_TILES = 10_000
FARTHEST_TILE = 10**9  # row and column: beyond any map
BUSY, NOTHING = 202, 204  # not among the errors that a browser lists


@dataclass
class Tiles:
    """Tiles that were made, the newest asked for last; empty ones are kept, too."""

    size: int = 0
    _kept: OrderedDict[tuple[int, ...], bytes] = field(default_factory=OrderedDict)

    def get(self, key: tuple[int, ...]) -> bytes | None:
        """A tile, b"" for an empty one; None where it was not made."""
        if key in self._kept:
            self._kept.move_to_end(key)
        return self._kept.get(key)

    def put(self, key: tuple[int, ...], picture: bytes) -> None:
        """Keep one, and drop those that nobody asked for in the longest time where there are too many."""
        self.size += len(picture) - len(self._kept.pop(key, b""))
        self._kept[key] = picture
        while self.size > MOST_BYTES or len(self._kept) > MOST_TILES:
            self.size -= len(self._kept.popitem(last=False)[1])


def add_layers(hub: Hub, scenario: Scenario, shelf: Shelf, maps: Sequence[MapFile] = ()) -> None:
    """Serve maps, and the tracks of a shelf's runs, about the datum of a scenario."""
    painter, reader, tiles = Worker("the map", READING), Worker("reading the log", READING), Tiles()
    hub.keep({"kind": "layers", "maps": [one.message() for one in maps]})
    app.on_shutdown(painter.close)
    app.on_shutdown(reader.close)

    @app.get("/map/{number}/{level}/{row}/{column}.png")
    async def picture(number: int, level: int, row: int, column: int) -> Response:
        far = max(abs(row), abs(column)) > FARTHEST_TILE
        if far or not (0 <= number < len(maps) and LEVELS[0] <= level <= LEVELS[1]):
            return Response("there is no such map", 404)
        key = number, level, row, column
        if (kept := tiles.get(key)) is None:
            try:
                kept = await painter.call(tile, maps[number], scenario.origin, level, row, column) or b""
            except ConfigError as error:
                hub.say("warning", str(error))
                kept = b""
            except RovtwinError as error:  # many pages ask at once: a page asks again
                return Response(str(error), BUSY)
            tiles.put(key, kept)
        return Response(kept, media_type="image/png") if kept else Response(status_code=NOTHING)

    @app.get("/chart/track")
    async def track(run: str = "") -> Any:
        try:
            folder = await asyncio.to_thread(shelf.find, run)
            return await reader.call(track_of, folder, scenario.origin, scenario.datum.is_given)
        except RovtwinError as error:
            return {"error": str(error)}
