"""The twin as a vehicle of its own: its physics in step with the wall clock, its vendor's protocol in another process.

`vehicle` is what is compiled: twin, the vehicle's own controllers and filter. `host` steps it from Python: commands in,
readings out. `serve` paces it and talks to the process that speaks protocols; `protocols` says which there are.
Composes, as `runs` does.
"""
