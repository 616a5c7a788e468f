"""Navigation: an error-state filter in which the vehicle's model and its inertial sensors predict together.

`state` says what is estimated, `prediction` how it moves and how sure that is, `measurements` what each sensor says of
it, `filter` joins them into a Block, `tuning` is what it assumes of its surroundings, `smoother` goes back over it.
"""
