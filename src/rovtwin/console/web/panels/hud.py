"""The camera's picture with a head-up display over it, drawn by `hud.js`."""

from nicegui import ui


def hud() -> None:
    """Add camera and head-up display to the element that is open; they fill that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/hud.css">')
    ui.element("section").props('id=hud aria-label="Camera with head-up display"')
    ui.add_body_html('<script type="module" src="/static/hud.js"></script>')
