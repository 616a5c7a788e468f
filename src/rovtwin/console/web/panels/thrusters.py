"""What each thruster is sent and what it still can do, as bars drawn by `thrusters.js`."""

from nicegui import ui


def thrusters() -> None:
    """Add the thrusters' bars to the element that is open; they fill that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/thrusters.css">')
    ui.element("section").props('id=thrusters aria-label="Thrusters"')
    ui.add_body_html('<script type="module" src="/static/thrusters.js"></script>')
