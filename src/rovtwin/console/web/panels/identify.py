"""The panel of a test: its manoeuvres, what to do now, the log's quality, the estimate; drawn by `identify.js`."""

from nicegui import ui


def identify() -> None:
    """Add the panel to the element that is open; it fills that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/identify.css">')
    ui.element("section").props('id=identify aria-label="Identification test"').classes("form")
    ui.add_body_html('<script type="module" src="/static/identify.js"></script>')
