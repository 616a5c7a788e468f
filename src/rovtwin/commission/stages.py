"""The stages in their order."""

from rovtwin.commission import bench, paper
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
    Stage(
        "bench",
        "Bench",
        "link, sensors, clocks, noise at rest and battery, thrusters off",
        "Put the vehicle into the middle of the tank, well below the surface, hands on it.",
        False,
        bench.run,
    ),
)
