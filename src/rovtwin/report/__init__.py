"""Figures and the HTML report of a run, made from its log alone, whichever channels it has.

Depends on core and vehicle, matplotlib, jinja2 and scipy, which load on first use: a flight without a report needs none
of them. `write_report` writes the page and its figures, `figures` gives them as matplotlib objects, `write_comparison`
shows several runs side by side.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rovtwin.report.run.catalogue import figures
    from rovtwin.report.run.comparison import write_comparison
    from rovtwin.report.run.html import write_report

__all__ = ["figures", "write_comparison", "write_report"]

_HOME = {"figures": "run.catalogue", "write_comparison": "run.comparison", "write_report": "run.html"}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'rovtwin.report' has no attribute {name!r}")
    return getattr(import_module(f"rovtwin.report.{_HOME[name]}"), name)
