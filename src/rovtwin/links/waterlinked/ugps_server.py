"""An Underwater GPS G2 that finds the locator where a station's position sensor finds the vehicle."""

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rovtwin.core.datum import Datum
from rovtwin.core.errors import LinkError
from rovtwin.core.flow import Measurement
from rovtwin.links.clock import Due
from rovtwin.links.http_wire import Request
from rovtwin.links.servers.served_vehicle import ServedVehicle
from rovtwin.links.servers.server import Server
from rovtwin.links.waterlinked import ugps_wire as wire
from rovtwin.links.waterlinked.ugps_wire import AcousticPosition, MapPosition
from rovtwin.links.waterlinked.web import MOST_CLIENTS, outcome, serving_pages

PORT = 8080  # the kit itself has 80, which takes root to bind
FIX_PERIOD = 0.25  # [s]: 4 Hz
STALE = 2.0  # a position older than this is not valid any more [s]
DEPTH_LIFE = 10.0  # a depth that a client sent counts so long [s of real time]
# Of the receivers in the topside's frame [m]: corners of a square at 1 m depth. Chosen: the kit's own are configured.
RECEIVERS = ((0.2, 0.2, 1.0), (0.2, -0.2, 1.0), (-0.2, 0.2, 1.0), (-0.2, -0.2, 1.0))


@dataclass
class UgpsServer(Server):
    """Speaks for an Underwater GPS G2 over HTTP.

    The acoustic position is the station's `position` seen from the topside unit, four times a second at most, its depth
    what a client sent last, else `pressure`. Filtered and raw are the same: noise and outliers are those of the
    vehicle's sensor.

    Args:
        host: Address to bind.
        port: TCP port.
        topside: Place of the topside unit in n: north, east [m], and heading of its forward mark [deg].
        datum: Where n is on the map.
        std: Accuracy that the kit tells [m]; the data sheet has 1 % of the range.
        needs_depth: Whether there is a position only while a client tells the depth, as with Locator A1.
    """

    host: str = "127.0.0.1"
    port: int = PORT
    topside: tuple[float, float, float] = (0.0, 0.0, 0.0)
    datum: Datum = field(default_factory=Datum)
    std: float = 0.5
    needs_depth: bool = False
    most_clients: int = MOST_CLIENTS

    @property
    def addresses(self) -> list[str]:
        return [self.host]

    async def run(self, station: ServedVehicle) -> None:
        kit = _Kit(self, station)
        async with serving_pages("ugps", self.host, self.port, kit, self.most_clients):
            station.say(f"ugps: speaks at http://{self.host}:{self.port}")
            async for batch in station.readings():
                kit.receive(batch)


class _Kit:
    """The instrument: what it was sent, and the last fix."""

    def __init__(self, options: UgpsServer, station: ServedVehicle):
        self.options, self.station = options, station
        options.datum.geodetic([0.0, 0.0, 0.0])  # imports what maps need now: later it would hold up the other servers
        self.malformed = 0
        self.fix: AcousticPosition | None = None
        self.given: dict[str, dict[str, float]] = {}
        self._depth_until = -math.inf
        self._due = Due(FIX_PERIOD)
        self._newest: Measurement | None = None
        self._fixes = 0
        self._t_fix = -math.inf
        self._gets: dict[str, Callable[[], Any]] = {
            "/api": lambda: {"version": "v1"},
            wire.FILTERED: self._acoustic,
            wire.RAW: self._acoustic,
            wire.GLOBAL: lambda: wire.body_of(self._global()),
            wire.MASTER: lambda: wire.body_of(self._master()),
            wire.ORIENTATION: lambda: {"orientation": self._given_heading()},
            wire.IMU: lambda: self.given.get(wire.IMU, dict.fromkeys(("roll", "pitch", "yaw", "x", "y", "z"), 0.0)),
            wire.CALIBRATE: self._imu,
            wire.WARNINGS: list,
            wire.ABOUT: _about,
            wire.STATUS: lambda: {"imu": 3, "gps": 3, "battery": -1},
            wire.CONFIG: self._config,
            wire.ANTENNA: lambda: {"x": 0.0, "y": 0.0, "depth": RECEIVERS[0][2], "antenna_rotation": 0},
        }

    # What clients ask.

    def answer(self, request: Request, body: bytes) -> tuple[int, Any]:
        """Status and JSON of the answer to a request."""
        path = request.path.rstrip("/")
        known = path in self._gets or path in wire.PUTS
        if request.method == "GET" and path in self._gets:
            return 200, self._gets[path]()
        if request.method == "PUT" and path in wire.PUTS:
            try:
                self._take(path, wire.parse_put(path, body))
            except LinkError as error:
                self.malformed += 1
                return 400, outcome(str(error))
            return 200, outcome()
        if known:
            return 405, outcome(
                f"{request.method[:20]}: the twin's kit is read here, and set by what {wire.BASE}/external has"
            )
        return 404, outcome("the twin's kit has no such page; it has " + ", ".join(self._gets))

    def _take(self, path: str, given: dict[str, float]) -> None:
        self.given[path] = given
        if path == wire.DEPTH:
            self._depth_until = asyncio.get_running_loop().time() + DEPTH_LIFE

    @property
    def _given_depth(self) -> float | None:
        alive = asyncio.get_running_loop().time() <= self._depth_until
        return self.given[wire.DEPTH]["depth"] if alive else None

    def _given_heading(self) -> float:
        return self.given.get(wire.ORIENTATION, {}).get("orientation", wire.NO_DATA)

    # What the vehicle measures.

    def receive(self, batch: list[Measurement]) -> None:
        """Readings as they come: at most every quarter second one becomes a fix."""
        for reading in batch:
            if reading.sensor == "position" and reading.value.shape == (2,) and np.isfinite(reading.value).all():
                self._newest = reading
        if self._newest is not None and self._due(self.station.now):
            self._locate(self._newest)
            self._newest = None

    def _locate(self, reading: Measurement) -> None:
        north, east, heading = self.options.topside
        offset = (float(reading.value[0]) - north, float(reading.value[1]) - east)
        x, y = wire.to_topside(offset, math.radians(heading))
        z = self._given_depth
        if z is None:
            depth = self.station.latest.get("pressure")
            z = float(depth.value[0]) if depth is not None and math.isfinite(depth.value[0]) else 0.0
        self._fixes += 1
        self._t_fix = reading.t_valid
        # Signal strengths are made up; they differ from fix to fix, as measured ones do: clients tell new ones by it.
        drift = 1e-3 * (self._fixes % 1000)
        self.fix = AcousticPosition(
            x=x,
            y=y,
            z=z,
            std=self.options.std,
            position_valid=True,
            receiver_distance=tuple(math.dist((x, y, z), receiver) for receiver in RECEIVERS),
            receiver_rssi=tuple(-60.0 - i - drift for i in range(4)),
            receiver_nsd=tuple(-90.0 - i + drift for i in range(4)),
            receiver_valid=(1.0,) * 4,
        )

    def _acoustic(self) -> dict[str, Any]:
        nothing = AcousticPosition(0.0, 0.0, 0.0, 0.0, False, *((0.0,) * 4,) * 4)
        fix = wire.body_of(self.fix or nothing)
        valid = abs(self.station.now - self._t_fix) <= STALE and not (
            self.options.needs_depth and self._given_depth is None
        )
        return fix if valid else fix | {"position_valid": False, "receiver_valid": (0.0,) * 4}

    def _master(self) -> MapPosition:
        """The topside unit: where it is, or where a client says that it is."""
        given = self.given.get(wire.EXTERNAL_MASTER)
        if given is not None:
            return MapPosition(**given)
        north, east, heading = self.options.topside
        lat, lon, _ = self.options.datum.geodetic([north, east, 0.0])
        # A good fix of a receiver at rest; satellites and dilution are made up.
        return MapPosition(float(lat), float(lon), heading % 360.0, wire.NO_DATA, 0.0, 0.8, 12.0, 1.0)

    def _global(self) -> MapPosition:
        """The locator: its acoustic position from where the kit has the topside unit."""
        master = self._master()
        fix = self.fix
        if fix is None:
            return MapPosition(master.lat, master.lon, self._given_heading())
        around = Datum(master.lat, master.lon)
        offset = wire.from_topside((fix.x, fix.y), math.radians(master.orientation))
        lat, lon, _ = around.geodetic([*offset, 0.0])
        heading, quality = self._given_heading(), (master.hdop, master.numsats, master.fix_quality)
        return MapPosition(float(lat), float(lon), heading, wire.NO_DATA, wire.NO_DATA, *quality)

    def _imu(self) -> dict[str, Any]:
        """The topside unit's own attitude: level, and calibrated once and for all."""
        return {"roll": 0.0, "pitch": 0.0, "yaw": self._master().orientation, "state": 3, "progress": 100}

    def _config(self) -> dict[str, Any]:
        master = self._master()
        provider = "external" if wire.EXTERNAL_MASTER in self.given else "static"
        return {
            "antenna_enabled": True,
            "channel": 4,
            "compass": provider,
            "gps": provider,
            "locator_type": "a1" if self.options.needs_depth else "u1",
            "speed_of_sound": 1475,
            "static_lat": master.lat,
            "static_lon": master.lon,
            "static_orientation": master.orientation,
        }


def _about() -> dict[str, Any]:
    return {
        "chipid": "0x0",
        "hardware_revision": 1,
        "product_id": 1,
        "product_name": "Underwater GPS (rovtwin)",
        "variant": "standard",
        "version": "3.3.0 (rovtwin)",
        "version_short": "3.3.0",
    }
