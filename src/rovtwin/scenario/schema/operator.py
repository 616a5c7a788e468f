"""What the operator asks for during a run."""

from typing import Literal

from pydantic import Field, model_validator

from rovtwin.core.user_files.config import NonNegative, Number, Strict, Vector3


class RequestSection(Strict):
    """One request.

    `arm` ends a fail-safe, once what called it is over: the vehicle holds until `resume`. `pilot` takes the vehicle off
    its mission: it moves with the velocity asked for, and keeps depth, heading and place along what is zero.
    """

    at: NonNegative = Field(description="when [s]")
    ask: Literal["pause", "resume", "abort", "arm", "pilot"] = Field(description="what for")
    velocity: Vector3 = Field(
        default=[0.0, 0.0, 0.0], description="of pilot: surge, sway along the heading, and heave, over ground [m/s]"
    )
    turn_rate_deg: Number = Field(default=0.0, description="of pilot: clockwise [deg/s]")

    @model_validator(mode="after")
    def _only_a_pilot_commands(self) -> "RequestSection":
        if self.ask != "pilot" and (any(self.velocity) or self.turn_rate_deg):
            raise ValueError(f"found a velocity with ask: {self.ask}, expected it with ask: pilot only")
        return self
