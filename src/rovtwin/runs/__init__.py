"""How a scenario runs: composed into blocks, looped, recorded, scored; the only place where all packages meet.

`compose` (blocks) -> `loop` (compiled) -> `run` (records) -> `fly` (log, scores, report). `feasibility` says before it
what the vehicle cannot do, `scoring` after it what it did and why. `batch` is many runs, `track`, `smooth` and `watch`
read runs that are over.
"""
