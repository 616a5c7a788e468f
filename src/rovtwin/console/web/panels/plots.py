"""Live plots of any channel against its reference, drawn by `plots.js`."""

from nicegui import ui


def plots() -> None:
    """Add the plots to the element that is open; they fill that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/plots.css">')
    ui.element("section").props('id=plots aria-label="Live plots"')
    ui.add_body_html('<script type="module" src="/static/plots.js"></script>')
