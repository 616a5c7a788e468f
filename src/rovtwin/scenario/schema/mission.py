"""Where a run begins, and its way-points."""

from typing import Annotated

from pydantic import AfterValidator, Field

from rovtwin.core.config import Degrees, NonNegative, Positive, Strict, Vector3


def _under_water(place: list[float]) -> list[float]:
    if place[2] < 0:
        raise ValueError(f"found {place[2]:g} m as the third number, expected a depth of at least 0 (down is positive)")
    return place


Place = Annotated[Vector3, AfterValidator(_under_water)]


class StartSection(Strict):
    """Where the vehicle begins, at rest and level."""

    position: Place = Field(default=[0.0, 0.0, 0.5], description="CO, north, east, down [m]; depth 0: afloat")
    heading_deg: Degrees = 0.0


class Waypoint(Strict):
    """One way-point."""

    position: Place = Field(description="north, east, down [m]; depth 0: at the surface")
    acceptance: Positive = Field(default=0.2, description="radius [m]")
    speed: Positive = Field(default=0.2, description="wanted speed on the leg [m/s], where the reference obeys it")
    hold_time: NonNegative = Field(default=0.0, description="time to stay [s]")
    heading_deg: Degrees | None = Field(default=None, description="heading to keep; default along the leg")


class MissionSection(Strict):
    """A list of way-points."""

    name: str = "mission"
    description: str = ""
    waypoints: list[Waypoint] = Field(min_length=1, max_length=64)
