"""The table of the vehicle library for docs/vehicles.md: `python -m docs.scripts.fleet`."""

import numpy as np

from rovtwin.vehicle import list_library, load_vehicle
from rovtwin.vehicle.analysis.stability import reach, steady_speed
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.actuation import rank

# Ahead [m/s], where somebody states one. Marked *: the file's forces were chosen to meet it, so that it proves nothing.
STATED = {"gladius_mini": "2.0*", "minerva": "1.0*", "sparus_ii": "1.5 to 2.0", "lbv300": "1.5*", "blueye_x3": "1.5"}
STATED |= {"bluerov2": "1.5", "bluerov2_heavy": "1.5"}


def row(name: str) -> str:
    """One vehicle."""
    vehicle = load_vehicle(name)
    model = vehicle.model()
    T = np.asarray(model.thrusters.configuration)
    free = [axis for axis, r in zip(AXES, np.eye(6), strict=True) if rank(np.column_stack([T, r])) == rank(T)]
    limits = reach(model)
    speeds = [steady_speed(model, i, float(limits[i, 1])) for i in (0, 1, 2)]
    cells = [f"`{name}`", f"{float(vehicle.assembly.solid.mass):.4g}", str(T.shape[1]), ", ".join(free)]
    cells += [f"{v:.2f}" if v > 0 else "-" for v in speeds] + [STATED.get(name, "")]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Print it, lightest first."""
    names = [name for name in list_library() if load_vehicle(name).assembly.thrusters]
    print("| vehicle | mass [kg] | thrusters | controllable | ahead [m/s] | sideways | down | stated ahead |")
    print("|---|---|---|---|---|---|---|---|")
    for name in sorted(names, key=lambda n: load_vehicle(n).assembly.solid.mass):
        print(row(name))


if __name__ == "__main__":
    main()
