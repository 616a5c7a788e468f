"""The console's pages: NiceGUI elements here, what moves in them in `static/` (plain ES modules, served at /static)."""
