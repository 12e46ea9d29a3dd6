"""Settings of the test run that must stand before numpy is imported."""

import importlib
import os
import signal
import sys

# many small matrices: threads of linear algebra cost more than they give, and disturb one another
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# where the environment forbids Python to keep what it compiled, as that of many containers does,
# each of the hundreds of programs that tests start would compile 2,600 modules anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# a fault of ours ends a run instead of being left out; tests of that pass a guard of their own
os.environ["BAYESDEG_STRICT"] = "1"

# a test run that was started in the background is deaf to Ctrl-C, and so would be the commands that
# tests stop by it
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# for a process of its own, see tests/peers/numpyro_process.py
collect_ignore = ["tests/peers/numpyro_nuts.py"]

# the package loads it where it is first asked for, which is not within the time of one example
importlib.import_module("scipy.special")


if (shift := os.environ.get("BAYESDEG_TEST_SEED")) is not None:
    # every generator that a test or the package makes of a number gets another one
    numpy = importlib.import_module("numpy")
    plain = numpy.random.default_rng

    def default_rng(seed=None):
        """Return the generator of a number and that of the environment."""
        numbered = isinstance(seed, int | numpy.integer)
        return plain([int(seed), int(shift)] if numbered else seed)

    numpy.random.default_rng = default_rng


def pytest_addoption(parser):
    """Add the option to run long campaigns."""
    parser.addoption("--run-long", action="store_true", help="also run tests that are marked long")


def pytest_collection_modifyitems(config, items):
    """Leave out long tests, and put files that hold slow ones first.

    Else the longest ends the run alone, on one core.
    """
    if not config.getoption("--run-long"):
        left_out = [item for item in items if item.get_closest_marker("long") is not None]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in set(left_out)]
    slow = {item.path for item in items if item.get_closest_marker("slow") is not None}
    items.sort(key=lambda item: item.path not in slow)
