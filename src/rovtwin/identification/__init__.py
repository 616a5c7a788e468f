"""From parts, geometry and short tests to the parameters of a vehicle, with their uncertainty.

Depends on core and vehicle. `record` is what every log becomes, `readers` make records of files; the methods that stand
alone (`empirical`, `panel`, `towing`, `free_running`, `decay`, `thrust`) and the joint estimate (`estimate`) use them.
"""
