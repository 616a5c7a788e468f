"""What the operator asks for during a run."""

from typing import Literal

from pydantic import Field

from rovtwin.core.config import NonNegative, Strict


class RequestSection(Strict):
    """One request. `arm` ends a fail-safe, once what called it is over: the vehicle holds until `resume`."""

    at: NonNegative = Field(description="when [s]")
    ask: Literal["pause", "resume", "abort", "arm"] = Field(description="what for")
