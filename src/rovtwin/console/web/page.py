"""The page: what is always visible on top, two views beside each other, a panel to act in, thrusters and log below."""

from collections.abc import Callable, Sequence
from html import escape

from nicegui import ui

from rovtwin.console.web.panels.chart import chart
from rovtwin.console.web.panels.hud import hud
from rovtwin.console.web.panels.thrusters import thrusters

Filler = Callable[[], None]


def page(is_test: bool = False, own: Sequence[str] = ()) -> None:
    """Build it, for missions or for a test; `own` are the names of views of one's own."""
    forms = {"Plan": "plan", "Pilot": "pilot"} if not is_test else {}
    forms |= {"World": "world", "Replay": "runs", "Commission": "commissionings"}
    acting = {"Identify": later("identify")} if is_test else {}
    head()
    with ui.element("div").classes("console").props("id=console"):
        bar()
        ui.element("div").props('id=alerts role=region aria-label="Alerts"')
        with ui.element("div").classes("views"):  # in NiceGUI's own main
            tabs("left", "Views, left", {"Chart": chart, "3-D": later("scene")})
            right = {"Camera": hud, "Plots": later("plots"), "Changes": later("changes")}
            right |= {} if is_test else {"Rehearsal": later("rehearsal")}
            tabs("right", "Views, right", right, own)
            tabs("side", "Actions", acting | {title: section(name) for title, name in forms.items()})
        with ui.element("footer").classes("strip"):
            with ui.element("div").classes("cell"):
                thrusters()
            with ui.element("div").classes("cell"):
                later("events")()
    for module in ("page", "bar", *forms.values()):
        ui.add_body_html(f'<script type="module" src="/static/{module}.js"></script>')


def head() -> None:
    """Sheets and colours that all pages share."""
    ui.add_head_html('<link rel="stylesheet" href="/static/theme.css"><link rel="stylesheet" href="/static/page.css">')
    ui.add_head_html('<link rel="stylesheet" href="/static/replay.css"><meta name="color-scheme" content="dark light">')
    ui.add_head_html('<script>document.documentElement.lang = "en"</script>')  # screen readers choose a voice by it


def bar(stop: bool = True) -> None:
    """STOP, where there is something to stop, and the state of things; `bar.js` fills it."""
    with ui.element("header").classes("bar"):
        with ui.element("h1").classes("unseen"):
            ui.html("rovtwin console", sanitize=False)
        if stop:
            ui.element("button").props('id=stop aria-label="STOP: thrusters off (Esc)"').classes("stop")
        ui.element("div").props('id=bar role=status aria-label="State of the vehicle"').classes("facts")


def tabs(name: str, label: str, views: dict[str, Filler], own: Sequence[str] = ()) -> None:
    """Views of which one is shown; `page.js` switches them, and hidden ones keep what they have.

    Args:
        name: Of the group.
        label: For who does not see it.
        views: By title.
        own: Names of views of one's own, which come behind these; two may have one name.
    """
    shown = [*views.items(), *((escape(title), own_one(number, title)) for number, title in enumerate(own))]
    with ui.element("section").classes(f"tabs {name}").props(f'aria-label="{label}"'):
        with ui.element("div").props(f'role=tablist aria-label="{label}"').classes("tablist"):
            for i, (title, _) in enumerate(shown):
                key = f"{name}-{i}"
                button = ui.element("button").props(
                    f"role=tab id=tab-{key} aria-controls=panel-{key} aria-selected={'true' if i == 0 else 'false'}"
                )
                with button:
                    ui.html(title, sanitize=False)
        for i, (_, fill) in enumerate(shown):
            key = f"{name}-{i}"
            hidden = "" if i == 0 else " hidden"
            panel = ui.element("div").classes("panel")
            panel.props(f"role=tabpanel id=panel-{key} aria-labelledby=tab-{key}{hidden}")
            with panel:
                fill()


def own_one(number: int, name: str) -> Filler:
    """A view of one's own."""
    from rovtwin.console.web.panels.own_view import own_view

    return lambda: own_view(number, name)


def section(name: str) -> Filler:
    """A form with a module of its own in `static/`."""

    def fill() -> None:
        ui.element("section").props(f"id={name}").classes("form")

    return fill


def later(name: str) -> Filler:
    """A view with a module of its own in `panels`."""
    from importlib import import_module

    def fill() -> None:
        getattr(import_module(f"rovtwin.console.web.panels.{name}"), name)()

    return fill
