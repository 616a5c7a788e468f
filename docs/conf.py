"""How Sphinx makes pages of these files; `make docs`."""

import typing
from importlib.metadata import version as version_of

import jax

# Types are shown as they are written, Float[Array, '6 6'], without the modules that they come from.
setattr(typing, "GENERATING_DOCUMENTATION", "rovtwin")  # noqa: B010  (jaxtyping looks for it)
jax.Array.__name__ = jax.Array.__qualname__ = "Array"
jax.Array.__module__ = "builtins"

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
