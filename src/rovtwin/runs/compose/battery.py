"""The batteries of a vehicle as a block, as a scenario starts them."""

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.scenario.schema import Scenario
from rovtwin.simulation.battery import Battery
from rovtwin.vehicle import Vehicle


def empty_at_start(scenario: Scenario) -> str | None:
    """A line about batteries that a scenario starts without any charge; None where there are none."""
    charge = 1.0 if scenario.battery is None else scenario.battery.charge
    if isinstance(charge, dict):
        names = ", ".join(name for name, share in charge.items() if share == 0.0)
    else:
        names = "all" if charge == 0.0 else ""
    return f"battery empty from the start ({names}): its thrusters do nothing" if names else None


def battery_of(scenario: Scenario, vehicle: Vehicle) -> Battery | None:
    """What feeds the thrusters; None where the scenario has no section `battery`.

    Raises:
        ConfigError: The vehicle has no battery, or none of a name.
    """
    if scenario.battery is None:
        if scenario.sensors.by_name["battery"].on_board:
            raise ConfigError("sensors.battery: no battery is simulated; set battery to true")
        return None
    sources = vehicle.power_sources
    if not sources:
        raise ConfigError(
            f"battery: {vehicle.name} has none; give it, or a part of it, one: battery: {{capacity_wh: 75}}"
        )
    names, charge = [source.name for source in sources], scenario.battery.charge
    if isinstance(charge, dict):
        for name in charge:
            if name not in names:
                raise ConfigError(f"battery.charge: no battery {name!r}; {vehicle.name} has {', '.join(names)}")
        charge = [charge.get(name, 1.0) for name in names]
    feeds = np.zeros((len(sources), len(vehicle.thruster_names)))
    for row, source in zip(feeds, sources, strict=True):
        row[list(source.feeds)] = 1.0
    return Battery(
        [source.capacity_wh for source in sources],
        [source.hotel_load for source in sources],
        feeds,
        vehicle.specific_power(),
        charge,
    )
