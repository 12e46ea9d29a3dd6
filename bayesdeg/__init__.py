"""Bayesian calibration of degrading soft actuators that names what the simulation gets wrong.

>>> import bayesdeg as bd
>>> bd.LogNormal(2, 1)
LogNormal(median=2, sigma=1)

The public names stand in `__init__.pyi`. They are imported on first use, so ``import bayesdeg`` is
fast.
"""

import importlib
import sys

if sys.argv[:1] == ["-m"] and "bayesdeg" in sys.orig_argv:
    # Started by `python -m bayesdeg`: until the command answers signals itself, Ctrl-C ends the
    # process without a traceback. Importing the library changes nothing.
    _signals = importlib.import_module("_signal")  # built in, so available at once
    _signals.signal(_signals.SIGINT, _signals.SIG_DFL)

import os

import lazy_loader

# Read when numba is imported, here and in worker processes. At the default of 3 compiling takes
# twice as long and the kernels are no faster: loops are vectorized at 2 too.
os.environ.setdefault("NUMBA_OPT", "2")

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
