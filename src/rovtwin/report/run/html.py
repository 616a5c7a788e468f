"""The HTML report: one file with everything in it, for the browser, for paper and for a mail."""

from pathlib import Path

from rovtwin.core.log import Log
from rovtwin.report.flight import Flight
from rovtwin.report.parts.page import save, write_page
from rovtwin.report.run.catalogue import drawable, left_out
from rovtwin.report.run.tables import fault_table, manoeuvre_table, mission_table, provenance_table, sensor_table
from rovtwin.report.run.vehicle import vehicle_tables
from rovtwin.report.run.verdict import verdict


def write_report(log: Log, folder: str | Path, title: str | None = None) -> Path:
    """Write `report.html` and its figures as `figures/*.png` and `figures/*.svg`.

    Args:
        log: What was recorded; channels that it lacks are named in the report.
        folder: Where to write; made when it does not exist. A report that is there is replaced.
        title: On top of the report; the name of the scenario, or "Flight report", when None.

    Returns:
        The path of the page.
    """
    folder, flight = Path(folder), Flight(log)
    kept = folder / "scenario.yaml"
    pictures = [
        save(entry.draw(flight), folder, entry.name, entry.title, entry.caption_of(flight))
        for entry in drawable(flight)
    ]
    return write_page(
        folder / "report.html",
        "report.html.j2",
        title=title or log.metadata.get("name") or "Flight report",
        verdict=verdict(flight),
        live=log.metadata.get("live") == "true",
        pictures=pictures,
        mission=mission_table(flight) or manoeuvre_table(flight),
        faults=fault_table(flight),
        sensors=sensor_table(flight),
        vehicle=vehicle_tables(flight),
        provenance=provenance_table(flight),
        scenario=log.metadata.get("scenario", ""),
        replay=f"rovtwin fly {kept if kept.exists() else kept.name}",
        replay_hint="" if kept.exists() else ", save the text below as scenario.yaml",
        left_out=_everything_left_out(log, flight),
    )


def _everything_left_out(log: Log, flight: Flight) -> list[str]:
    sections = (
        (flight.summary, "Scores: the log's metadata has no summary."),
        (
            log.metadata.get("scenario"),
            "Scenario: the log's metadata has none, so the run cannot be repeated from here.",
        ),
        (vehicle_tables(flight), "Vehicle: the log's metadata has no table of its model."),
        (flight.waypoints or flight.json("test"), "Mission: the log's metadata has no way-points."),
        (flight.sensors, "Sensors: the log has no channel sensor/... with readings."),
    )
    return left_out(log) + [line for found, line in sections if not found]
