"""Figures and the HTML report of a run, made from its log alone, whichever channels it has.

Depends on core and vehicle, matplotlib, jinja2 and scipy. `write_report` writes the page and its figures, `figures`
gives them as matplotlib objects, `write_comparison` shows several runs side by side.
"""

from rovtwin.report.run.catalogue import figures
from rovtwin.report.run.comparison import write_comparison
from rovtwin.report.run.html import write_report

__all__ = ["figures", "write_comparison", "write_report"]
