"""What is to be commissioned, how it is reached, and what it shall be good for."""

import hashlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Self

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import cannot, read_bytes
from rovtwin.live.connect import is_computed, on_this_machine
from rovtwin.planning.tank import Tank
from rovtwin.vehicle import Vehicle, load_vehicle

INTERVAL = 0.05  # half-width of a damping force's 95 % interval that is asked for, as a share
MINUTES = 15.0  # most of excitation


@dataclass(frozen=True)
class Request:
    """What was asked for.

    Attributes:
        vehicle: Its file or library name.
        link: URL of the vehicle.
        sensors: URLs of instruments beside it.
        tank: Length x width x depth of the test water [m].
        prior: An earlier identified file of this vehicle, of these parts or of others; None: there is none.
        speed: Of the vehicle's clock; other than 1 only for a twin on this machine.
        minutes: Most minutes of excitation.
        interval: Half-width of the 95 % intervals of damping forces at which excitation may end, as a share.
        currents: Speeds of the water in which it shall be proven [m/s].
        seas: Sea states, significant wave heights, in which it shall be proven [m].
        samples: Missions of the proof for each current and sea.
        seed: Of all that is drawn.
    """

    vehicle: str
    link: str
    sensors: tuple[str, ...] = ()
    tank: str = "6x3x1.5"
    prior: str | None = None
    speed: float = 1.0
    minutes: float = MINUTES
    interval: float = INTERVAL
    currents: tuple[float, ...] = (0.0, 0.1, 0.2)
    seas: tuple[float, ...] = (0.0,)
    samples: int = 20
    seed: int = 1

    @property
    def room(self) -> Tank:
        """The tank; ConfigError where its text is none."""
        return Tank.parse(self.tank)

    @property
    def too_busy(self) -> str:
        """What else may hold readings up where this machine computes the vehicle; "" where it does not."""
        if self.speed <= 1.0 and not is_computed(self.link):
            return ""
        return f"Is this machine too busy for {self.speed:g} times real time? End what else runs, or a smaller --speed."

    def load_vehicle(self) -> Vehicle:
        """As its file describes it now; ConfigError where that cannot be used."""
        return load_vehicle(self.vehicle)

    def load_prior(self) -> Vehicle | None:
        """The earlier identification, None where there is none; ConfigError where it cannot be used."""
        return None if self.prior is None else load_vehicle(self.prior)

    def require_usable(self) -> None:
        """ConfigError where the tank, the vehicle or the earlier file is none, before anything is written."""
        Tank.parse(self.tank)
        self.load_vehicle()
        self.load_prior()

    def fingerprint(self) -> str:
        """SHA-256 of what stages depend on, so that they notice that it has changed since they were passed.

        That is the vehicle as it is described now, the tank, and whether a twin or a real vehicle is at the other end:
        what a twin has passed says nothing of a real one.
        """
        about = (self.load_vehicle().to_dict(), Tank.parse(self.tank).sizes, on_this_machine(self.link))
        return hashlib.sha256(repr(about).encode()).hexdigest()

    def absolute(self) -> Self:
        """With files named so that another working directory finds them."""
        made = {
            name: str(Path(text).resolve())
            for name in ("vehicle", "prior")
            if (text := getattr(self, name)) is not None and Path(text).is_file()
        }
        return replace(self, **made)

    def to_dict(self) -> dict[str, Any]:
        """As plain data."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> "Request":
        """What `to_dict` gave, tuples being lists."""
        lists = {name: tuple(value) for name, value in data.items() if isinstance(value, list)}
        return cls(**{**data, **lists})


def sha256(path: Path) -> str:
    """Of a file's content; ConfigError where it cannot be read."""
    try:
        return hashlib.sha256(read_bytes(path)).hexdigest()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({cannot(error)})") from None
