"""The page of a replay: the console's views, a time line to move along, and no way to order anything."""

from html import escape
from urllib.parse import quote

from nicegui import ui

from rovtwin.console.rehearsal.flight import FILE
from rovtwin.console.replays.replay import Recording
from rovtwin.console.web.page import bar, head, later, section, tabs
from rovtwin.console.web.panels.chart import chart
from rovtwin.console.web.panels.hud import hud
from rovtwin.console.web.panels.thrusters import thrusters


def replay_page(recording: Recording, run: str, flies: bool) -> None:
    """Build it; STOP is on it where a vehicle flies beside the replay."""
    ui.page_title(f"{recording.name} – replay")
    head()
    address = escape(f"/replay/live?run={quote(run, safe='')}")
    ui.add_head_html(f'<meta name="rovtwin-live" content="{address}">')
    with ui.element("div").classes("console replaying").props("id=console"):
        bar(stop=flies)
        ui.element("div").props('id=alerts role=region aria-label="Alerts"')
        with ui.element("div").classes("views"):
            tabs("left", "Views, left", {"Chart": chart, "3-D": later("scene")})
            right = {"Camera": hud, "Plots": later("plots")}
            right |= {"Rehearsal": later("rehearsal")} if (recording.path.parent / FILE).is_file() else {}
            tabs("right", "Views, right", right)
            tabs("side", "Runs", {"Runs": section("runs")})
        ui.element("section").props('id=timeline aria-label="Time line of the run"')
        with ui.element("footer").classes("strip"):
            with ui.element("div").classes("cell"):
                thrusters()
            with ui.element("div").classes("cell"):
                later("events")()
    for module in ("page", "bar", "runs", "replay", "history"):
        ui.add_body_html(f'<script type="module" src="/static/{module}.js"></script>')


def refused(why: str) -> None:
    """In place of it where a run cannot be opened: why, and the runs there are."""
    head()
    ui.add_head_html('<meta name="rovtwin-live" content="">')
    with ui.element("div").classes("refused").props('role=alert id=refused aria-label="This run cannot be replayed"'):
        ui.label("This run cannot be replayed").style("font-weight: 600")
        ui.label(why)
    section("runs")()
    ui.add_body_html('<script type="module" src="/static/runs.js"></script>')
