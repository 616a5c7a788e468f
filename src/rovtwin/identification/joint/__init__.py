"""One estimate from all evidence: parameters, prior, multiple shooting, noise, and the file that comes out.

`parameters` and `prior` say what is sought, `segments` cuts the records, `balance` gives the start, `shooting` the
compiled sums, `problem` the normal equations, `estimate` walks to the top, `noise` beside it; `overlay` writes it down.
"""
