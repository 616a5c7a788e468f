"""The figure of docs/world.md on water: what a vehicle trimmed in a pool gains elsewhere.

python docs/scripts/water.py [--out docs/figures]
"""

import argparse
from pathlib import Path

import numpy as np

from rovtwin.report.parts.style import BLACK, SERIES, SMALL, dress, new_figure
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.water import density

# Examples, not measurements: temperature [deg C] and salinity.
PLACES = {"warm pool": (24, 0), "brackish, as the Baltic": (16, 7), "fjord with river water": (8, 20), "sea": (8, 34)}
BELOW = ("brackish, as the Baltic", "sea")  # where the label stands clear of the lines


def gained(vehicle, temperature, salinity):
    """Net buoyancy of a vehicle neutral in water of 1000 kg/m3 [N]."""
    model = vehicle.model(water_density=density(temperature, salinity))
    return float(model.buoyancy - model.weight)


def main():
    """Write the figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    folder, vehicle = parser.parse_args().out, load_vehicle("double_blueye")
    figure = new_figure(height=3.0)
    axes = dress(figure.subplots(), "Net buoyancy [N]", "Temperature [deg C]")
    for colour, salinity in zip(SERIES, (35, 30, 20, 10, 0), strict=False):
        temperatures = np.linspace(0, 30, 61)
        values = [gained(vehicle, t, salinity) for t in temperatures]
        axes.plot(temperatures, values, color=colour, linewidth=1.4)
        axes.text(30.3, values[-1], f"salinity {salinity}", color=colour, fontsize=SMALL, va="center")
    for name, (temperature, salinity) in PLACES.items():
        value = gained(vehicle, temperature, salinity)
        axes.plot(temperature, value, "o", color=BLACK, markersize=5)
        axes.annotate(
            f"{name}: {value:.1f} N",
            (temperature, value),
            (6, -11 if name in BELOW else 5),
            textcoords="offset points",
            fontsize=SMALL,
        )
    axes.axhline(0, color=BLACK, linewidth=0.6)
    axes.set_xlim(0, 34)
    axes.set_xticks(range(0, 31, 5))
    figure.savefig(folder / "world_water.png", dpi=150)


if __name__ == "__main__":
    main()
