"""From parts, geometry and short tests to the parameters of a vehicle, with their uncertainty.

Depends on core and vehicle. `logs` turns recordings into Records and `checks` looks for mistakes in them; `priors` is
what shapes say before any test; `steady` and `decay` are the classical tests, each usable alone; `joint` makes one
estimate of everything, `diagnostics` says what it is worth, and `identify` is the whole way through. `experiment`
designs the next test, `thesis` derives the published tables again.
"""
