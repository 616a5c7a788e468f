"""The ballast that an operator adds before a dive, so that a twin that nobody commands does not sink."""

from rovtwin.runs.compose.composition import keys_of, vehicle_of
from rovtwin.runs.compose.world import plant_of
from rovtwin.scenario.schema import Scenario

SPARE = 0.005  # net buoyancy that is left to a ballasted vehicle, as a share of its weight: estimate
UNNOTICED = 1e-6  # net buoyancy that is none, as a share of the weight


def trimmed(scenario: Scenario) -> tuple[Scenario, str]:
    """The scenario with a vehicle that does not sink, and a sentence where that took ballast.

    A vehicle that is heavier than its world's water gets net buoyancy of 0.5 % of its weight, in the plant alone: the
    autopilot's model stays that of the file. One that floats stays as it is, and so does any vehicle whose scenario
    gives `world.net_buoyancy`, be it 0.

    Raises:
        ConfigError: The vehicle cannot be used in that world.
    """
    world = scenario.world
    if "net_buoyancy" in world.model_fields_set:
        return scenario, ""
    vehicle = vehicle_of(scenario)
    plant = plant_of(world, vehicle, vehicle.model(), keys_of(scenario.seed)[0])
    weight, net = float(plant.weight), float(plant.buoyancy - plant.weight)
    if net >= -UNNOTICED * weight:
        return scenario, ""
    added = round(SPARE * weight - net, 3)
    notice = (
        f"{vehicle.name} sinks with {-net:.3g} N in this water: ballasted to float with {net + added:.3g} N, "
        "as before a dive. To have it as described: --set world.net_buoyancy=0"
    )
    return scenario.model_copy(update={"world": world.model_copy(update={"net_buoyancy": added})}), notice
