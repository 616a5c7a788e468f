"""Guidance, navigation and control by name, with what may be changed about them."""

import logging
from functools import cache
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, field_validator, model_validator

from rovtwin.core.user_files.config import NonNegative, Number, Positive, Strict
from rovtwin.scenario.schema.own_block import OwnBlock, by_short_form
from rovtwin.scenario.schema.supervisor import SupervisorSection

logger = logging.getLogger(__name__)

PLACES = ("observer", "guidance", "reference", "controller", "allocation")
"""Keys at which a block of one's own may stand."""
MOST_PITCH = 85.0  # that the thesis's Euler angles bear [deg]


class ObserverSection(Strict):
    """The extended Kalman filter of thesis 2.13."""

    tuning: Literal["consistent", "as_printed"] = Field(default="consistent", description="as_printed: table 7.2")
    force_walk: NonNegative | None = Field(
        default=None, description="declared random walk of the disturbance force [N/sqrt(s)]; default of the tuning"
    )


class ControllerSection(Strict):
    """Five decoupled PIDs."""

    gains: Literal["table_7_1", "table_3_2", "pole_placement"] = Field(
        default="table_7_1", description="tables of the thesis, or placed from the model"
    )


class ReferenceSection(Strict):
    """Second-order reference model, thesis (7.8)."""

    damping: Positive = 1.0
    frequency: Positive = Field(default=1.5, description="[rad/s]")
    obey_speed: bool = Field(
        default=False, description="keep to the way-points' speeds; the thesis's reference does not"
    )


class GuidanceSection(Strict):
    """2-D line of sight with the phases dive, turn, go, switch."""

    lookahead: Positive = Field(default=2.0, description="Delta of (2.45) [m]")


class ThesisSection(Strict):
    """The baseline: the thesis's guidance, navigation and control, put right or as printed."""

    type: Literal["thesis"] = "thesis"
    observer: ObserverSection = ObserverSection()
    controller: ControllerSection = ControllerSection()
    reference: ReferenceSection = ReferenceSection()
    guidance: GuidanceSection = GuidanceSection()
    supervisor: SupervisorSection = SupervisorSection()

    @model_validator(mode="before")
    @classmethod
    def _refuse_own_blocks(cls, data: Any) -> Any:
        own = [key for key in PLACES if key in data and _names_block(data[key])] if isinstance(data, dict) else []
        if own:
            raise ValueError(f"{own[0]}: blocks of your own go into the model-based autopilot; write type: model_based")
        return data

    @model_validator(mode="after")
    def _stays_short_of_ninety(self) -> "ThesisSection":
        limit = self.supervisor.attitude_limit_deg.limit
        if limit is not None and limit > MOST_PITCH:
            raise ValueError(
                f"supervisor.attitude_limit_deg: found {limit:g}, expected at most {MOST_PITCH:g}: the Euler angles of "
                "the thesis's filter fail at 90; use autopilot=model_based"
            )
        return self


class NavigationSection(Strict):
    """What the error-state filter assumes; what is left out has the default of `gnc.navigation.tuning`."""

    force_walk: Positive | None = Field(default=None, description="random walk of the disturbance force [N/sqrt(s)]")
    force_std: Positive | None = Field(default=None, description="disturbance force at the start [N]")
    drag_std: Positive | None = Field(default=None, description="relative error of the model's drag")
    current_std: Positive | None = Field(default=None, description="water's velocity at the start, each axis [m/s]")
    acceleration_share: NonNegative | None = Field(default=None, description="relative error of accelerations")
    max_age: Annotated[Number, Field(ge=0, le=2.5)] | None = Field(
        default=None, description="oldest reading that is compared with the past [s]"
    )


Six = Annotated[list[NonNegative], Field(min_length=6, max_length=6)]


class TrackingSection(Strict):
    """Model-based tracking of the path."""

    bandwidth: Six | None = Field(
        default=None, description="natural frequency of the error along each axis [rad/s]; default: from the vehicle"
    )
    damping_ratio: Positive = 1.0
    integral: NonNegative = Field(default=0.1, description="rate of the moments' integral, as a share of the bandwidth")
    dive_speed: Positive | None = Field(default=None, description="largest [m/s]; default: from the vehicle")
    turn_rate_deg: Positive | None = Field(default=None, description="largest [deg/s]; default: from the vehicle")


class TunedSection(Strict):
    """How `rovtwin tune` found the values beside it; nothing flies by it."""

    vehicle: str
    made_with: str = Field(description="fingerprint of the vehicle's parts")
    scenario: str
    plants: str = Field(description="what they were drawn from, in words")
    seas: list[str]
    seed: int
    evaluations: int = Field(description="autopilots that were tried")
    cost: list[Number] = Field(description="of the values before and after, on plants that chose among candidates")
    held_out: list[Number] = Field(
        description="mean change of the cost on plants that nobody tuned on, and its 95 % interval"
    )
    held_out_plants: int
    rovtwin: str = Field(description="version")


@cache
def _say_replaced(steering: str) -> None:
    """A line on standard error, once for each."""
    logger.warning("autopilot.guidance.steering: %s is flown as los, which has taken its place: write los", steering)


class PathSection(OwnBlock):
    """Guidance along the path, or a block in its place."""

    steering: Literal["auto", "crab", "los"] = Field(
        default="auto",
        description="crab sideways, or turn the bow by line of sight; auto: los where sway is weak or not there",
    )
    lookahead: Positive | None = Field(
        default=None,
        description="how far from a point los goes there at cruising speed [m]; default: from the vehicle",
    )

    @field_validator("steering", mode="before")
    @classmethod
    def _replaced(cls, value: Any) -> Any:
        if value in ("ilos", "alos"):  # learned a crab angle; los takes the filter's current
            _say_replaced(value)
            return "los"
        return value


class ModelBasedSection(Strict):
    """The default: error-state filter, guidance along a smooth path, model-based tracking; or blocks in their place.

    A block is named by its address (`package.module:Name`) or an entry point of the group rovtwin.blocks.
    """

    type: Literal["model_based"] = "model_based"
    navigation: NavigationSection = NavigationSection()
    guidance: PathSection = PathSection()
    control: TrackingSection = TrackingSection()
    observer: OwnBlock | None = Field(default=None, description="takes ObserverInput, gives Estimate")
    reference: OwnBlock | None = Field(default=None, description="takes Setpoint, gives Reference")
    controller: OwnBlock | None = Field(default=None, description="takes ControlInput, gives Wrench")
    allocation: OwnBlock | None = Field(default=None, description="takes AllocationInput, gives Allocated")
    given: str = Field(default="", description="class of a whole autopilot that was handed over in Python")
    supervisor: SupervisorSection = SupervisorSection()
    tuned: TunedSection | None = Field(default=None, description="note of `rovtwin tune`")

    @field_validator(*PLACES, mode="before")
    @classmethod
    def _block_by_address(cls, value: Any) -> Any:
        return by_short_form(value)

    @property
    def own_blocks(self) -> dict[str, OwnBlock]:
        """Blocks in place of ours, by key; `autopilot` where it is the whole."""
        named = {key: one for key in PLACES if (one := getattr(self, key)) is not None and one.is_own}
        return named | ({"autopilot": OwnBlock(given=self.given)} if self.given else {})


def _names_block(value: Any) -> bool:
    return isinstance(value, str) or (isinstance(value, dict) and bool({"block", "given"} & value.keys()))


def _kind(section: Any) -> str:
    """Type of a section; without one that of the default, unless a key says that the thesis's autopilot is meant."""
    if not isinstance(section, dict):
        return str(getattr(section, "type", "model_based"))
    of_thesis = [key for key in ("observer", "controller", "reference") if not _names_block(section.get(key, ""))]
    return str(section.get("type", "thesis" if of_thesis else "model_based"))


AutopilotSection = Annotated[
    Annotated[ThesisSection, Tag("thesis")] | Annotated[ModelBasedSection, Tag("model_based")], Discriminator(_kind)
]


PRESETS: dict[str, dict[str, Any]] = {
    "model_based": {"type": "model_based"},
    # Baselines: the thesis's autopilot with its errors mended, as printed, and with gains from the vehicle's own model
    # and a reference that the vehicle can follow.
    "thesis": {"type": "thesis"},
    "thesis_as_printed": {"type": "thesis", "observer": {"tuning": "as_printed"}},
    "thesis_placed": {
        "type": "thesis",
        "controller": {"gains": "pole_placement"},
        "reference": {"obey_speed": True},
    },
}
