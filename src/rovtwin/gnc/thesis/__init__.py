"""The autopilot of the thesis (NTNU 2021, chapters 2 and 7), put right: the baseline for `model_based`.

`ekf` estimates, `los_guidance` gives set-points, `pid` asks for a wrench, `allocation` makes commands of it. The
reference model that both autopilots use is in `control.reference_model`.
"""
