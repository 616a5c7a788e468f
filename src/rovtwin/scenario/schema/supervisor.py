"""The supervisor's rules: what is watched, how long it has to last, and what is done about it."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from rovtwin.core.user_files.config import NonNegative, Number, Positive, Share, Strict
from rovtwin.core.user_files.quantity import is_number
from rovtwin.gnc.safety.rules import RULES

Action = Literal["ignore", "hold", "return", "surface", "stop"]


class RuleSection(Strict):
    """One rule. What is left out is the default; a bare number is the limit, a bare word the action."""

    limit: NonNegative | None = Field(default=None, description="beyond which it applies, in the rule's unit")
    after: NonNegative | None = Field(default=None, description="how long it has to last [s]")
    action: Action | None = Field(
        default=None, description="hold station, return to the start, surface, stop the thrusters, or ignore it"
    )


class ShareRuleSection(RuleSection):
    """A rule whose limit is a share."""

    limit: Share | None = Field(default=None, description="below which it applies, 0 to 1")


class AngleRuleSection(RuleSection):
    """A rule whose limit is a tilt, short of upside down, where a heading has no meaning."""

    limit: Annotated[Number, Field(gt=0, le=150)] | None = Field(default=None, description="[deg]")


class SwitchRuleSection(RuleSection):
    """A rule without a limit: it either is so or not."""

    limit: None = None


class FenceSection(RuleSection):
    """How far the vehicle may go: a circle about the start, corners on the map, or both."""

    limit: Positive | None = Field(default=None, description="distance from the start [m]")
    polygon: Annotated[list[Annotated[list[Number], Field(min_length=2, max_length=2)]], Field(min_length=3)] | None = (
        Field(default=None, description="corners [north, east] [m]; outside of it the rule applies")
    )


def _short(value: Any) -> Any:
    """A bare number is a limit, a bare word an action."""
    if isinstance(value, str):
        return {"action": value}
    if is_number(value):
        return {"limit": value}
    return value


_Rule = Annotated[RuleSection, BeforeValidator(_short)]
_Switch = Annotated[SwitchRuleSection, BeforeValidator(_short)]
_Charge = Annotated[ShareRuleSection, BeforeValidator(_short)]
_Angle = Annotated[AngleRuleSection, BeforeValidator(_short)]
_Fence = Annotated[FenceSection, BeforeValidator(_short)]


class SupervisorSection(Strict):
    """Rules by name. A graver action takes over from a lesser one; only the operator arms again."""

    depth_limit: _Rule = Field(default=RuleSection(), description="greatest depth [m]")
    attitude_limit_deg: _Angle = Field(
        default=AngleRuleSection(), description="tilt from upright; with the thesis up to 85"
    )
    position_std_limit: _Rule = Field(default=RuleSection(), description="estimate counts as lost beyond it [m]")
    leak: _Switch = Field(default=SwitchRuleSection(), description="water comes in")
    battery_critical: _Charge = Field(default=ShareRuleSection(), description="charge of the emptiest battery")
    battery_low: _Charge = Field(default=ShareRuleSection(), description="charge of the emptiest battery")
    filter_diverged: _Rule = Field(
        default=RuleSection(),
        description="mean squared normalised innovation of positions, by axis, over some 20 of them",
    )
    positions_lost: _Rule = Field(default=RuleSection(), description="since a position was accepted [s]")
    thruster_failed: _Switch = Field(
        default=SwitchRuleSection(), description="and what is left is too little for the mission"
    )
    saturated: _Switch = Field(
        default=SwitchRuleSection(), description="a tenth of an axis's wrench short of what the controller wants"
    )
    link_lost: _Rule = Field(default=RuleSection(), description="since anything came from the vehicle [s]")
    deadline_missed: _Rule = Field(default=RuleSection(), description="lateness of ticks, in control periods")
    geofence: _Fence = Field(default=FenceSection(), description="how far the vehicle may go")
    altitude_limit: _Rule = Field(default=RuleSection(), description="least distance to the floor [m]; needs altimeter")
    time_out: _Rule = Field(default=RuleSection(), description="since the mission began [s]")
    operator_silent: _Rule = Field(default=RuleSection(), description="since the operator's last sign of life [s]")
    no_way_home: _Rule = Field(
        default=RuleSection(), description="since the vehicle last came nearer, while it returns [s]"
    )
    sensor_silent: _Rule = Field(default=RuleSection(), description="since attitude or depth was last received [s]")
    off_course: _Rule = Field(
        default=RuleSection(),
        description="level distance from the set-point beyond which the vehicle has to come nearer [m]; without a "
        "limit or a time those of the vehicle",
    )
    off_depth: _Rule = Field(
        default=RuleSection(),
        description="the same in depth [m]; without a limit or a time those of the vehicle",
    )

    @property
    def deepest(self) -> float:
        """Depth at which the supervisor acts [m]."""
        given = self.depth_limit.limit
        return RULES["depth limit"].limit if given is None else given

    @model_validator(mode="after")
    def _can_be(self) -> "SupervisorSection":
        if self.depth_limit.limit is not None and self.depth_limit.limit <= 0:
            raise ValueError(f"depth_limit: found {self.depth_limit.limit:g} m, expected more than 0")
        return self
