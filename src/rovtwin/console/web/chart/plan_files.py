"""Addresses at which a page gets the plan as a file: as scenarios use it, and as other programs read it."""

from typing import Any

from fastapi import Response
from fastapi.responses import JSONResponse
from nicegui import app

from rovtwin.console.chart.files import exported
from rovtwin.console.engine.fence import with_fence
from rovtwin.console.web.hub import Hub
from rovtwin.core.errors import RovtwinError
from rovtwin.planning.exchange.missions import FORMATS
from rovtwin.scenario.schema import Scenario


def add_plan_files(hub: Hub, scenario: Scenario) -> None:
    """Serve the plan on a hub's table, which belongs to a scenario."""

    @app.get("/plan.yaml")
    def plan() -> Response:
        headers = {"Content-Disposition": 'attachment; filename="mission.yaml"'}
        return Response(hub.draft.as_yaml(), media_type="application/yaml", headers=headers)

    @app.get("/plan/{kind}")
    async def other(kind: str) -> Any:
        if kind not in FORMATS:
            return JSONResponse({"error": f"expected one of {', '.join(FORMATS)}"}, 404)
        try:
            fence = hub.client.last.get("setup", {}).get("fence")  # which may be drawn on the chart
            flown = scenario if fence is None else with_fence(scenario, fence["polygon"])
            text, notes = await hub.worker.call(exported, hub.draft.rows, kind, flown)
        except RovtwinError as error:  # the page shows why, and no error in the browser
            return {"error": str(error)}
        return {"file": f"mission{FORMATS[kind].ending}", "text": text, "notes": notes}
