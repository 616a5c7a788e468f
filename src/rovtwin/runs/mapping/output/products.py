"""What a mosaic was made of and what came out, before it is written."""

from dataclasses import dataclass

from rovtwin.mapping.cells.mosaic import Job, Joined
from rovtwin.mapping.cells.radiometry import Budget
from rovtwin.runs.mapping.area import Rings
from rovtwin.runs.mapping.panel import Seen
from rovtwin.runs.mapping.registering import Registered
from rovtwin.runs.mapping.sources import Inputs


@dataclass(frozen=True)
class Products:
    """What there is to be written.

    Attributes:
        inputs: Sources.
        job: What was done with them.
        joined: Layers.
        budget: Of uncertainty; None for radiances.
        remarks: For people.
        counts: Of what was left out.
        resumed: Parts that an earlier, broken call had made.
        lines_used: How many lines count.
        registration: What it did; None without.
        area: That was to be seen, rings of x and y; None: the hull of what was.
        panel: What a reference panel did; None without.
    """

    inputs: Inputs
    job: Job
    joined: Joined
    budget: Budget | None
    remarks: list[str]
    counts: dict[str, int]
    resumed: int
    lines_used: int
    registration: Registered | None
    area: Rings | None
    panel: Seen | None = None
