"""Where a run begins, and its way-points."""

from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from rovtwin.core.datum import Datum
from rovtwin.core.user_files.config import Degrees, NonNegative, Number, Positive, Strict, Vector3
from rovtwin.scenario.schema.datum import on_earth


def _under_water(place: list[float]) -> list[float]:
    if place[2] < 0:
        raise ValueError(f"found {place[2]:g} m as the third number, expected a depth of at least 0 (down is positive)")
    return place


Place = Annotated[Vector3, AfterValidator(_under_water)]
Tilt = Annotated[Number, Field(ge=-85, le=85)]
LONGEST = 4096  # way-points: a survey of hours; a typing mistake that asks for more is caught
PlaceOnEarth = Annotated[Vector3, AfterValidator(on_earth)]


class StartSection(Strict):
    """Where the vehicle begins, at rest."""

    position: Place = Field(default=[0.0, 0.0, 0.5], description="CO, north, east, down [m]; depth 0: afloat")
    heading_deg: Degrees = 0.0
    attitude_deg: Annotated[list[Tilt], Field(min_length=2, max_length=2)] = Field(
        default=[0.0, 0.0], description="roll and pitch, for decay tests"
    )


class Waypoint(Strict):
    """One way-point, in the world frame or on the map."""

    position: Place | None = Field(default=None, description="north, east, down [m]; depth 0: at the surface")
    geodetic: PlaceOnEarth | None = Field(
        default=None, description="in place of position: latitude, longitude [deg, WGS-84], depth [m]"
    )
    acceptance: Positive = Field(default=0.2, description="radius [m]; left out, the vehicle's own: docs/scenarios.md")
    speed: Positive = Field(default=0.2, description="desired on the leg [m/s]; left out, the vehicle's own")
    hold_time: NonNegative = Field(default=0.0, description="time to stay [s]")
    heading_deg: Degrees | None = Field(default=None, description="heading to keep; default along the leg")
    altitude: Positive | None = Field(
        default=None,
        description="distance to the floor to keep [m]; the depth holds while the altimeter says nothing",
    )

    @model_validator(mode="after")
    def _is_one_place(self) -> "Waypoint":
        if (self.position is None) == (self.geodetic is None):
            found = "neither position nor geodetic" if self.position is None else "both position and geodetic"
            raise ValueError(f"found {found}, expected one: [north, east, down] or [latitude, longitude, depth]")
        return self

    @property
    def depth(self) -> float:
        """Below the water [m]."""
        return (self.position or self.geodetic or [0.0, 0.0, 0.0])[2]

    def placed(self, datum: Datum) -> list[float]:
        """Where it is in the world frame about a datum: north, east, down [m]."""
        if self.geodetic is None:
            return list(self.position or [])
        return datum.position(*self.geodetic).tolist()


class MissionSection(Strict):
    """A list of way-points."""

    name: str = "mission"
    description: str = ""
    waypoints: list[Waypoint] = Field(min_length=1, max_length=LONGEST)
