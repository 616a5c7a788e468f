"""Load a vehicle, look at its model, fly a scenario, plot the path.

python examples/01_fly.py            # shows where the picture is
python examples/01_fly.py square     # another scenario
"""

import sys

import numpy as np
from matplotlib.figure import Figure

from rovtwin import fly, load_scenario, load_vehicle

vehicle = load_vehicle("double_blueye")
model = vehicle.model()
print(f"{vehicle.name}: {float(model.rigid_body_mass[0, 0]):.1f} kg, thrusters {', '.join(vehicle.thruster_names)}")
print("added mass, diagonal:", np.round(np.diag(model.added_mass), 2))

scenario = load_scenario(sys.argv[1] if len(sys.argv) > 1 else "lawnmower_calm", ["world.current=[0.02,0,0]"], seed=3)
flight = fly(scenario)
print("completed" if flight.completed else f"not completed: {flight.figures['reason']}")
print(f"cross-track rms {flight.figures['cross_track_rms_m']:.3f} m in {flight.figures['duration_s']:.0f} s")

figure = Figure(figsize=(5, 6))
axes = figure.subplots()
truth, estimate = flight.log["truth/eta"], flight.log["autopilot/eta"]
axes.plot(truth["y"], truth["x"], label="truth")
axes.plot(estimate["y"], estimate["x"], lw=0.8, label="estimate")
axes.set(xlabel="east [m]", ylabel="north [m]", aspect="equal")
axes.legend()
figure.savefig("path.png", dpi=150)
print("wrote path.png")
