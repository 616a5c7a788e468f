"""The monitor beside a flight: what has changed of the vehicle since its identification, or why nobody knows."""

from collections.abc import Sequence
from typing import Any

from rovtwin.live.manoeuvres import touched_spans
from rovtwin.monitoring.change import Change, causes
from rovtwin.monitoring.flight import USED, FlightMonitor
from rovtwin.monitoring.reference import identified_std
from rovtwin.runs.compose.composition import Simulation
from rovtwin.runs.compose.sensors import mount_of
from rovtwin.scenario.schema import Scenario

SINCE = "since the identification"


def monitor_of(simulation: Simulation, scenario: Scenario) -> tuple[FlightMonitor | None, str]:
    """The monitor of a flight, compiled: nothing waits for it once the vehicle flies; or None, and why there is none.

    Whatever fails here is such a reason, and ends no flight.
    """
    try:
        if scenario.test and any(span["hand"] for span in touched_spans(scenario)):
            return None, "hands hold the vehicle in this test"
        mounts = {
            name: mount_of(sensor) for name, sensor in simulation.loop.twin.sensors.items() if sensor.kind in USED
        }
        # Thrusters by the names that the identification gives them; those of `simulation` are for channels.
        vehicle = simulation.vehicle
        monitor = FlightMonitor(vehicle.model(), vehicle.thruster_names, mounts, scenario.control_dt)
        if monitor.trouble:
            return None, monitor.trouble
        monitor.warm()
        monitor.reference = identified_std(vehicle, [q.name for q in monitor.quantities.each])
    except Exception as error:
        return None, str(error) or type(error).__name__
    return monitor, ""


def changed(monitor: FlightMonitor | None, unwatched: str = "") -> dict[str, Any]:
    """For a summary: what of an identified vehicle is not as it was, in words, or why that is not known.

    Args:
        monitor: Of the flight, None: there was none.
        unwatched: Why there was none, or why it was given up; "" where nobody asked for one, or nothing failed.
    """
    if unwatched:
        return {"changed": [], "monitor": f"{'did not run' if monitor is None else 'stopped'}: {unwatched}"}
    if monitor is None:
        return {}
    if monitor.trouble:
        return {"changed": [], "monitor": f"stopped: {monitor.trouble}"}
    if monitor.found is None:
        return {"changed": []}
    doubts = {"monitor": "in doubt: " + "; ".join(monitor.found.doubts)} if monitor.found.doubts else {}
    return {"changed": words(monitor.found.changes)} | doubts


def words(found: Sequence[Change]) -> list[str]:
    """A line for each change, and for each cause that it may have."""
    return [f"{change.difference} {SINCE}" for change in found] + causes(found)
