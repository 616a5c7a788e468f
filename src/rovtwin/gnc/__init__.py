"""Guidance, navigation and control: from measurements and a mission to thruster commands.

`autopilot` joins one block of each kind: an observer, the supervisor (`safety`), guidance, a reference model, control
and allocation; `interfaces` is what they give to each other. Two sets of blocks fill these places: `thesis`, and the
model-based ones in `navigation`, `guidance`, `control` and `allocation`. `experiment` flies identification tests.
Depends on `core` and `vehicle`.
"""
