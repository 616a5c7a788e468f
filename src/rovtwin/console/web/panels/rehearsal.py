"""What the plan's rehearsal predicts, and the flight beside it, listed by `rehearsal.js`."""

from nicegui import ui


def rehearsal() -> None:
    """Add the view to the element that is open; it fills that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/rehearsal.css">')
    ui.element("section").props('id=rehearsal aria-label="Rehearsal of the plan"')
    ui.add_body_html('<script type="module" src="/static/rehearsal.js"></script>')
