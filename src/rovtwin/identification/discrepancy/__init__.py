"""What the identified model lacks, learned from the tests: a wrench of velocity and thrust as Gaussian processes.

`regression` finds where there is something to learn and over which lengths it changes, `training` estimates it together
with all parameters, `acceptance` decides by prediction whether it is taken, `sparse` is the comparison with a sparse
regression of chosen terms. The equations are in `vehicle/physics/discrepancy.py`. Needs `joint` and `diagnostics`.
"""
