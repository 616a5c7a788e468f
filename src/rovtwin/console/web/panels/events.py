"""The event log, listed by `events.js`."""

from nicegui import ui


def events() -> None:
    """Add the event log to the element that is open; it fills that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/events.css">')
    ui.element("section").props('id=events aria-label="Event log"')
    ui.add_body_html('<script type="module" src="/static/events.js"></script>')
