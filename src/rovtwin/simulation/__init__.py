"""The world around a vehicle: current, waves, sensors, and the twin that puts them round the plant.

Depends on `core` and `vehicle` only. Every process is a `core.block.Block`: seeded by a key in its memory, pure, and
the same bit for bit for the same seed.
"""

from rovtwin.simulation.environment.current import (
    CombinedCurrent,
    ConstantCurrent,
    Flow,
    GaussMarkovCurrent,
    ShearedCurrent,
)
from rovtwin.simulation.environment.waves import ThesisWaves, WaveAction
from rovtwin.simulation.environment.world import World
from rovtwin.simulation.mismatch import drawn, lifted, perturbed
from rovtwin.simulation.sensors.sensor import Sensor, SensorInput, table_5_7
from rovtwin.simulation.twin import Twin, TwinInput, TwinMemory, TwinOutput

__all__ = [
    "CombinedCurrent",
    "ConstantCurrent",
    "Flow",
    "GaussMarkovCurrent",
    "Sensor",
    "SensorInput",
    "ShearedCurrent",
    "ThesisWaves",
    "Twin",
    "TwinInput",
    "TwinMemory",
    "TwinOutput",
    "WaveAction",
    "World",
    "drawn",
    "lifted",
    "perturbed",
    "table_5_7",
]
