"""How results look and what can be asked of any of them; depends on `errors` and `extras` only."""

from rovtwin.core.notebook.face import Result, axes_of, labelled
from rovtwin.core.notebook.html import html_table

__all__ = ["Result", "axes_of", "html_table", "labelled"]
