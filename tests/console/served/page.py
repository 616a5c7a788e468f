"""The views with a fake live module: `python tests/console/served/page.py PORT [MESH]`, then /scene?play=1, or /all."""

import sys
from pathlib import Path

from fastapi.responses import FileResponse
from nicegui import app, ui

import rovtwin.console.web as web
from rovtwin.console.web.panels.events import events
from rovtwin.console.web.panels.plots import plots
from rovtwin.console.web.panels.scene import scene

STATIC = Path(web.__file__).parent / "static"
VIEWS = {"scene": scene, "plots": plots, "events": events}
COLOURS = {
    **{"bg": "#0d1319", "panel": "#17202a", "line": "#64778a", "text": "#eef3f7", "muted": "#a9b7c4"},
    **{"accent": "#5cc2ff", "on-accent": "#06121c", "ok": "#4fd88a", "warn": "#ffb347", "danger": "#ff7b7b"},
    **{"track": "#5cc2ff", "plan": "#f4e06d", "truth": "#c3cbd3", "reference": "#ff8ad8", "water": "#9aa8ff"},
}


@app.get("/static/live.js")
def live() -> FileResponse:
    return FileResponse(Path(__file__).with_name("fake_live.js"), media_type="text/javascript")


@app.get("/mesh/vehicle.glb")
def mesh() -> FileResponse:
    return FileResponse(sys.argv[2], media_type="model/gltf-binary")


app.add_static_files("/static", str(STATIC))


@ui.page("/{name}")
def page(name: str) -> None:
    if (STATIC / "theme.css").is_file():
        ui.add_head_html('<link rel="stylesheet" href="/static/theme.css">')
    else:
        ui.add_css("body {" + "".join(f"--{key}: {value};" for key, value in COLOURS.items()) + "}")
    ui.context.client.content.style("padding: 0; gap: 0")
    shown = VIEWS if name == "all" else {name: VIEWS[name]}
    for view in shown.values():
        with ui.element("main").style(f"width: 100vw; height: {100 / len(shown):.3f}vh; overflow: hidden"):
            view()


if __name__ == "__main__":
    ui.run(
        host="127.0.0.1", port=int(sys.argv[1]), show=False, reload=False, show_welcome_message=False, tailwind=False
    )
