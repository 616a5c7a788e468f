"""One estimate from all evidence: parameters, prior, multiple shooting, noise, and the file that comes out.

`model` is what is estimated, `solver` the sum of squares and its derivatives, `estimate` finds the maximum of the
posterior, `uncertainty` says how sure it is, `result` what follows from it. `build` makes a problem from records.
"""
