"""Which tethers are connected, and who holds their upper ends."""

from typing import Annotated, Any, Literal

from pydantic import Field

from rovtwin.core.user_files.config import Number, Positive, Strict, Vector3


class TetherSection(Strict):
    """How a tether runs; what it is made of is in the vehicle's file."""

    connected: bool = True
    anchor: Vector3 | None = Field(
        default=None,
        description="its upper end, north, east, down [m]; default: at the surface above the start, in a tank at the "
        "nearest wall",
    )
    paid_out: Positive | Literal["tended"] = Field(
        default="tended", description="length [m], or tended: somebody pays out and hauls in as the vehicle moves"
    )
    slack: Annotated[Number, Field(ge=1, le=10)] = Field(
        default=1.1, description="of a tended tether: length over the distance"
    )


class TethersSection(TetherSection):
    """All tethers of the vehicle, and what is different about one."""

    by_name: dict[str, TetherSection] = Field(
        default_factory=dict, description="what is different about a tether, by its name as vehicle show gives it"
    )

    def of(self, name: str) -> TetherSection:
        """What holds for one of them."""
        own = self.by_name.get(name)
        given: dict[str, Any] = self.model_dump(exclude={"by_name"})
        if own is not None:
            given |= own.model_dump(exclude_unset=True)
        return TetherSection.model_validate(given)
