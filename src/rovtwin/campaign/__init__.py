"""Monte Carlo: many flights of one scenario with what varies drawn, on one machine or many.

Depends on scenario and all below it, on pyarrow, and on dask where more than one process flies (extra `campaign`).
schema, distributions (what people write) -> samples (draws) -> flying (what a worker does) -> workers (who they are) ->
store (what is kept) -> run (all together) -> summary (what it says).
Tuning (`tune*`; needs cmaes): tune_parameters, tune_plants, tune_cost, tune_flights, tune_search -> tune ->
tune_writing.
"""
