"""Speed, measured as ratios within one run: `make bench`, or `python benchmarks/run.py --help`.

The other side of the ratios is a plain NumPy program that does the same: `tests/oracle.py` for the equations of
motion, `benchmarks/numpy_loop.py` for the closed loop.
"""
