"""The parts of a page, each drawn by a module of `static/`."""
