"""What an operator may order, checked on its way in: an order that is none never reaches the autopilot."""

from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError

from rovtwin.core.user_files.config import NonNegative, Number, Positive, Strict
from rovtwin.scenario.schema.mission import Waypoint

Stick = Annotated[Number, Field(ge=-1, le=1)]


Corner = Annotated[list[Annotated[Number, Field(ge=-1e6, le=1e6)]], Field(min_length=2, max_length=2)]
MOST_CORNERS = 64  # of a fence


class Plain(Strict):
    """An order that needs nothing said with it."""

    do: Literal[
        "stop", "alive", "arm", "disarm", "start", "pause", "resume", "abort", "hold", "reconnect", "lend", "quit"
    ]


class Submit(Strict):
    """Way-points to fly at the next start, or only to look at."""

    do: Literal["submit", "check"]
    waypoints: Annotated[list[Waypoint], Field(min_length=1, max_length=512)]


class Goto(Strict):
    """Go to a place at once [m]; without a depth, at the depth where the vehicle is; without a speed, at its own."""

    do: Literal["goto"]
    x: Number
    y: Number
    depth: NonNegative | None = None
    speed: Positive | None = None


class Pilot(Strict):
    """Sticks: shares of the largest velocity ahead, to starboard, down, and of the largest turn rate.

    Only one with `begin` starts piloting; others are not heeded once another order has ended it.
    """

    do: Literal["pilot"]
    begin: bool = False
    surge: Stick = 0.0
    sway: Stick = 0.0
    heave: Stick = 0.0
    yaw: Stick = 0.0


class Pace(Strict):
    """How fast simulated time runs, and whether."""

    do: Literal["pace"]
    speed: Annotated[Number, Field(gt=0, le=50)] | None = None
    running: bool | None = None


class Inject(Strict):
    """Something that breaks, or is mended, in the simulated world."""

    do: Literal["inject"]
    fault: Literal["thruster", "sensor", "current"]
    thruster: Annotated[int, Field(ge=0)] | None = None
    share: Annotated[Number, Field(ge=0, le=1)] = 0.0
    sensor: str | None = None
    works: bool = False
    current: Annotated[list[Annotated[Number, Field(ge=-2, le=2)]], Field(min_length=2, max_length=2)] | None = None


class Fence(Strict):
    """A polygon in which the vehicle has to stay, corners [north, east] [m]; without one, the scenario's own again."""

    do: Literal["fence"]
    corners: Annotated[list[Corner], Field(min_length=3, max_length=MOST_CORNERS)] | None = None


Order = Plain | Submit | Goto | Pilot | Pace | Inject | Fence
_ORDER: TypeAdapter[Order] = TypeAdapter(Annotated[Order, Field(discriminator="do")])


def parse(message: Any) -> Order:
    """The order that a message is.

    Raises:
        ValueError: It is none; the text says where and why.
    """
    if not isinstance(message, dict):
        raise ValueError(f"found {type(message).__name__}, expected an order")
    content = {key: value for key, value in message.items() if key not in ("id", "sent")}
    try:
        return _ORDER.validate_python(content)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"][1:])
        raise ValueError(f"{content.get('do')}{'.' if where else ''}{where}: {first['msg']}") from None
