"""The chart: tank or sea seen from above, on which way-points are laid and moved. `chart.js` draws it."""

from nicegui import ui


def chart() -> None:
    """Add the chart to the element that is open; it fills that element."""
    ui.add_head_html('<link rel="stylesheet" href="/static/chart.css">')
    ui.element("section").props('id=chart aria-label="Chart seen from above"')
    ui.add_body_html('<script type="module" src="/static/chart.js"></script>')
