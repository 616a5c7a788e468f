"""The stages in their order."""

from rovtwin.commission import paper
from rovtwin.commission.stage import Stage

STAGES: tuple[Stage, ...] = (
    Stage(
        "paper",
        "Paper",
        "what parts, geometry and formulas say, before anything gets wet",
        "Put the vehicle beside the tank, switched on, and start the bench test.",
        False,
        paper.run,
    ),
)
