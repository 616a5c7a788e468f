"""Whether a vehicle holds its place in a sea: the figure and the tables of docs/world.md.

python docs/scripts/holding.py [--out docs/figures] [--fly]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from rovtwin.core.numerics import jax
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.feasibility.sea import holdings, thesis_rms, worst
from rovtwin.runs.feasibility.station_keeping import holding
from rovtwin.runs.fly import fly
from rovtwin.scenario.files import load_scenario
from rovtwin.simulation.environment.airy import AirySea
from rovtwin.simulation.environment.sea import SeaState
from rovtwin.simulation.environment.world import World
from rovtwin.vehicle import load_vehicle

VEHICLES = ("double_blueye", "double_blueye_thesis")
SEAS = ((0.27, 3.0), (1.5, 5.7), (4.1, 8.7))
HEIGHTS = np.array([0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.2, 3.0, 4.1])
PLACE = (0.0, 0.0, 3.0)
# Sea and current to the north, per vehicle: [Hs, Tz, current].
FLOWN = ((0, 0, 0), (0.27, 3.0, 0), (1.5, 5.7, 0), (4.1, 8.7, 0), (0.27, 3.0, 0.1), (0.27, 3.0, 0.3), (0.27, 3.0, 0.5),
         (0.27, 3.0, 0.8))  # fmt: skip


def sea_of(height, period):
    """Pierson-Moskowitz from the north, deep water."""
    return World(waves=AirySea.of(SeaState.of(height, zero_crossing_period=period), direction=np.pi))


def rms(x, axis=None):
    """Root of the mean square."""
    return np.sqrt((np.asarray(x) ** 2).mean(axis))


def figure(path):
    """Required force over wave height, and two minutes of it beside the thrust there is."""
    fig, (left, right) = plt.subplots(1, 2, figsize=(9, 3.9), width_ratios=(1, 1.3))
    for name, colour in zip(VEHICLES, ("C0", "C1"), strict=True):
        model = load_vehicle(name).model()
        for depth, style in ((3.0, "-"), (10.0, "--")):
            seas = [sea_of(height, 4.3 * np.sqrt(height)) for height in HEIGHTS]
            found = [holding(model, sea, jax.random.key(1), (0, 0, depth), 0.0) for sea in seas]
            label = f"{name}, {depth:.0f} m deep"
            left.plot(HEIGHTS, [rms(f.horizontal) for f in found], style, color=colour, label=label)
    left.plot(HEIGHTS, [thesis_rms(h, 4.3 * np.sqrt(h)) for h in HEIGHTS], "k:", label="force of the thesis")
    left.axhline(20.0, color="0.4", lw=1)
    left.text(0.105, 22, "thrust in surge, 20 N", fontsize=8, color="0.3")
    left.set(xscale="log", yscale="log", ylim=(0.01, 300), xlim=(0.1, 4.2), xlabel="Hs [m], Tz = 4.3 s (Hs / 1 m)^1/2",
             ylabel="horizontal force, rms [N]", title="required to keep still")  # fmt: skip
    left.set_xticks([0.1, 0.2, 0.5, 1, 2, 4], ["0.1", "0.2", "0.5", "1", "2", "4"])
    left.minorticks_off()
    left.grid(alpha=0.3)
    left.legend(fontsize=6.5, ncols=2, loc="upper center", bbox_to_anchor=(0.52, -0.2))
    for name, colour in zip(VEHICLES, ("C0", "C1"), strict=True):
        found = holding(load_vehicle(name).model(), sea_of(4.1, 8.7), jax.random.key(1), PLACE, 0.0)
        now = found.t < 120
        right.plot(found.t[now], found.required[now, 0], color=colour, lw=1, label=name)
    right.axhspan(-20, 20, color="0.75", zorder=0, label="thrust there is")
    right.set(xlabel="time [s]", ylabel="surge force [N]", title="Hs 4.1 m, Tz 8.7 s, 3 m deep", xlim=(0, 120))
    right.legend(fontsize=7, ncols=3, loc="upper center", bbox_to_anchor=(0.5, -0.2))
    fig.tight_layout()
    fig.savefig(path, dpi=90)
    plt.close(fig)


def claim_table():
    """The thesis's three seas: its force, and what a real sea asks."""
    print("| Hs, Tz | force of the thesis, rms [N] | `double_blueye`: horizontal / heave, rms [N] | "
          "`double_blueye_thesis`: horizontal / heave, rms [N] | water to and fro, rms [m] |")  # fmt: skip
    print("|---" * 5 + "|")
    for height, period in SEAS:
        cells = []
        for name in VEHICLES:
            found = holding(load_vehicle(name).model(), sea_of(height, period), jax.random.key(1), PLACE, 0.0)
            cells.append(f"{rms(found.horizontal):.3g} / {rms(found.required[:, 2]):.3g}")
        print(f"| {height} m, {period} s | {thesis_rms(height, period):.3f} | {' | '.join(cells)} "
              f"| {found.sweep[0]:.2g} |")  # fmt: skip


def flown_table():
    """The verdict beside a flight of ten minutes, from 120 s on."""
    print("| vehicle | Hs, Tz | current | verdict | foreseen: to and fro, drift | flown: north rms, depth rms, drift |")
    print("|---" * 6 + "|")
    for name in VEHICLES:
        for height, period, current in FLOWN:
            words = [f"vehicle={name}", "autopilot=thesis_placed", "mission=station", "duration=600",
                     "start.position=[0,0,3]", f"world.current=[{current},0,0]", "log.sensors=false",
                     "mission.waypoints=[{position: [0, 0, 3], heading_deg: 0, hold_time: 10000}]"]  # fmt: skip
            if height:
                words.append(f"world.waves={{model: airy, spectrum: pierson_moskowitz, significant_height: {height}, "
                             f"zero_crossing_period: {period}, direction_deg: 180}}")  # fmt: skip
            scenario = load_scenario("lawnmower_calm", words)
            found = worst(holdings(compose(scenario)))
            flight = fly(scenario, refuse=False)  # those that drift off, too
            eta = flight.log["truth/eta"]
            if flight.figures["phase"] == "aborted":
                flown = f"aborted after {eta.t[-1]:.0f} s: {flight.figures['reason']}"
            else:
                late = eta.t > 120
                north, drift = eta["x"][late], np.polyfit(eta.t[late], eta["x"][late], 1)[0]
                flown = f"{north.std():.2f} m, {eta['z'][late].std():.2f} m, {abs(drift):.2f} m/s"
                if found.verdict == "drifts":
                    flown = f"{abs(drift):.2f} m/s, {abs(north[-1]):.0f} m away in the end"
            waves = f"{height} m, {period} s" if height else "none"
            foreseen = f"{found.sweep[0]:.2f} m, {found.drift:.2f} m/s"
            print(f"| `{name}` | {waves} | {current} m/s | {found.verdict} | {foreseen} | {flown} |", flush=True)


def main():
    """Figure into a folder, tables to standard output."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "figures")
    parser.add_argument("--fly", action="store_true", help="the table of flown missions too; minutes")
    given = parser.parse_args()
    figure(given.out / "world_holding.png")
    claim_table()
    if given.fly:
        flown_table()


if __name__ == "__main__":
    main()
