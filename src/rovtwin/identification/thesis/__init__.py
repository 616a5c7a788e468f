"""The identification chapters of the 2021 Double Blueye thesis, derived again from the numbers that it prints.

Depends on core, vehicle and the methods of identification. The YAML files hold what the thesis prints, each value with
its table or equation; `rederive` gives, for every result, what was published, what follows from the thesis's own data
by its own formula, the corrected value, and why they differ.
"""

from rovtwin.identification.thesis.study import Study, rederive

__all__ = ["Study", "rederive"]
