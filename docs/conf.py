"""How Sphinx makes pages of these files; `make docs`."""

from importlib.metadata import version as version_of

project = "rovtwin"
author = "The rovtwin developers"
version = release = version_of("rovtwin")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
exclude_patterns = ["scripts"]
html_theme = "furo"
html_title = f"rovtwin {version}"
myst_heading_anchors = 4
# Links lead to source files and folders as well, which are no pages.
suppress_warnings = ["myst.xref_missing", "toc.not_included"]
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_use_ivar = True
