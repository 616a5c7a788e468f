"""Guidance, navigation and control: from measurements and a mission to thruster commands.

`observer` estimates; `supervisor` decides whether the vehicle may act; `guidance` gives set-points, `reference`
smooths them, `control` asks for a wrench and `allocation` makes commands of it; `autopilot` joins them into one Block.
These are the thesis's; `navigation`, `path` and `path_guidance`, `tracking` are their model-based counterparts.
Depends on `core` and `vehicle`.
"""
