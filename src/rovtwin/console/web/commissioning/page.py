"""The page of a commissioning: STOP and the state of things on top, what to do next, the checklist, a stage's page."""

from nicegui import ui

from rovtwin.console.web.page import bar, head


def commission_page() -> None:
    """Build it; `commission.js` fills it."""
    head()
    ui.add_head_html('<link rel="stylesheet" href="/static/commission.css">')
    with ui.element("div").classes("console commissioning").props("id=console"):
        bar()
        ui.element("div").props('id=alerts role=region aria-label="Alerts"')
        ui.element("section").props('id=commission aria-label="Commissioning"')
    for module in ("page", "bar", "commission"):
        ui.add_body_html(f'<script type="module" src="/static/{module}.js"></script>')
