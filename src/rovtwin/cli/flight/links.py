"""rovtwin links: the protocols that vehicles and instruments are reached by, ours and those of installed packages."""

from typing import TYPE_CHECKING, Any

from rovtwin.cli.output import AsJson, console, emit

if TYPE_CHECKING:
    from rovtwin.links.endpoint import Endpoint


def links(as_json: AsJson = False) -> None:
    """List the protocols: addresses for --link and --sensor, what each measures, what it needs, how it is served.

    Those of installed packages (entry points rovtwin.links) are listed after our own.
    """
    from rovtwin.core.errors import ConfigError
    from rovtwin.links.registry import found

    rows, failed = [], {}
    for scheme, one in found():
        if isinstance(one, ConfigError):
            failed[scheme] = str(one)
        else:
            rows.append(_row(one))
    if as_json:
        emit({"links": rows, "failed": failed})
        return
    screen = console(as_json)
    for row in rows:
        for line in _lines(row):
            screen.print(line, markup=False, soft_wrap=True)
    for line in failed.values():
        screen.print(f"not to be used: {line}", markup=False, soft_wrap=True)


def _row(one: "Endpoint") -> dict[str, Any]:
    """An endpoint for a list."""
    from rovtwin.core.extras import installed

    use = [option for option, able in (("--link", one.link), ("--sensor", one.source)) if able is not None]
    module, extra = one.requires or ("", "")
    return {
        "protocol": one.scheme,
        "about": one.about,
        "address": one.address,
        "options": dict(one.options),
        "use": use,
        "sensors": list(one.sensors),
        "served": one.server is not None or one.firmware is not None,
        "extra": extra,
        "installed": not module or installed(module),
    }


def _lines(row: dict[str, Any]) -> list[str]:
    """A protocol for people: what it is, and under it how it is used."""
    options = [f"?{name}={form}" if form else f"?{name}" for name, form in row["options"].items()]
    missing = "" if row["installed"] else f", not installed: pip install 'rovtwin[{row['extra']}]'"
    rows = {
        "connect": f"{' '.join(row['use'])} {row['address']}" if row["use"] else "",
        "options": "  ".join(options),
        "measures": ", ".join(row["sensors"]),
        "serve": f"--protocol {row['protocol']}" if row["served"] else "",
        "needs": f"the extra {row['extra']}{missing}" if row["extra"] else "",
    }
    return [f"{row['protocol']}: {row['about']}", *(f"  {name:<9} {text}" for name, text in rows.items() if text)]
