"""Bayesian calibration of degrading soft actuators that names what the simulation gets wrong."""

import os

# Read when numba is imported, here and in worker processes. At its default, 3, compiling takes
# twice as long, and the kernels are no faster: loops become vectors at 2 as well.
os.environ.setdefault("NUMBA_OPT", "2")

__version__ = "0.1.0"
