"""The 3-D scene: tank or seabed, vehicle, track, plan and what is known of them, drawn by `scene3d.js`."""

from importlib import import_module

from nicegui import ui


def scene() -> None:
    """Add the scene to the element that is open; it fills that element."""
    import_module("nicegui.elements.scene")  # puts NiceGUI's copy of three.js into the page's import map
    ui.add_head_html('<link rel="stylesheet" href="/static/scene3d.css">')
    ui.element("section").props('id=scene3d aria-label="3-D scene"')
    ui.add_body_html('<script type="module" src="/static/scene3d.js"></script>')
