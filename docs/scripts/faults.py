"""The picture of docs/scenarios.md: a flight on which a thruster dies.

python docs/scripts/faults.py [--out docs/figures]
"""

import argparse
from pathlib import Path

from rovtwin.report.run.catalogue import figures
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario

FAULT = "faults=[{at: 150, thruster: starboard.surge, fault: dead}]"


def main():
    """Fly, and keep the figure of the pose."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "figures")
    folder = parser.parse_args().out
    flight = fly(load_scenario("lawnmower_calm", ["autopilot=thesis", FAULT, "duration=300"]))
    figures(flight.log)["pose"].savefig(folder / "scenarios_fault.png", dpi=100)


if __name__ == "__main__":
    main()
