"""A view of one's own, filled by `own_views.js` with what its process gives."""

from nicegui import ui


def own_view(number: int, name: str) -> None:
    """Add the view to the element that is open; it fills that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/own_views.css">')
    section = ui.element("section").classes("own-view")
    section.props(f'id=own-view-{number} data-view={number} aria-label="View of your own"')
    section.props["data-name"] = name
    ui.add_body_html('<script type="module" src="/static/own_views.js"></script>')
