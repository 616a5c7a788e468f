"""Batteries in a run."""

from pydantic import Field

from rovtwin.core.user_files.config import Share, Strict


class BatterySection(Strict):
    """The vehicle's batteries run down as it flies; without this section they never do."""

    charge: Share | dict[str, Share] = Field(
        default=1.0, description="at the start: of all, or by the name of the part that has it; 1 is full"
    )
