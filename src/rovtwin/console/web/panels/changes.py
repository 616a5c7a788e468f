"""What has changed of the vehicle since its identification, listed by `changes.js`."""

from nicegui import ui


def changes() -> None:
    """Add the list to the element that is open; it fills that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/changes.css">')
    ui.element("section").props('id=changes aria-label="What has changed of the vehicle"')
    ui.add_body_html('<script type="module" src="/static/changes.js"></script>')
