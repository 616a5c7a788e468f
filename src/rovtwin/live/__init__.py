"""Flying a vehicle that is not computed here: over a Link, by the wall clock, with an explicit arm step.

`connect` turns URLs into links and sources, `readiness` listens before anything moves, `flight` is the fixed-rate loop,
`recorder` keeps what it did, `manoeuvres` tells the operator of a test what comes. Composes, as `runs` does.
"""
