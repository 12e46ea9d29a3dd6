"""Bayesian calibration of degrading soft actuators that names what the simulation gets wrong.

>>> import bayesdeg as bd
>>> bd.LogNormal(2, 1)
LogNormal(median=2, sigma=1)

The names below are the public interface. They are imported on first use, so ``import bayesdeg`` is
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
from types import ModuleType
from typing import TYPE_CHECKING, Any

# Read when numba is imported, here and in worker processes. At the default of 3 compiling takes
# twice as long and the kernels are no faster: loops are vectorized at 2 too.
os.environ.setdefault("NUMBA_OPT", "2")

__version__ = "0.1.0"

if TYPE_CHECKING:
    from bayesdeg.api import calibrate as calibrate
    from bayesdeg.api import compare as compare
    from bayesdeg.api import control as control
    from bayesdeg.api import criticise as criticise
    from bayesdeg.api import emulator as emulator
    from bayesdeg.api import lifetime as lifetime
    from bayesdeg.api import predict as predict
    from bayesdeg.api import report as report
    from bayesdeg.api import update as update
    from bayesdeg.causes.cause import Cause as Cause
    from bayesdeg.causes.cause import Stage as Stage
    from bayesdeg.data.settings import Dimensions as Dimensions
    from bayesdeg.data.study import Study as Study
    from bayesdeg.errors import BayesdegError as BayesdegError
    from bayesdeg.errors import GeometryError as GeometryError
    from bayesdeg.errors import StudyError as StudyError
    from bayesdeg.inference.own_map import Readings as Readings
    from bayesdeg.pipeline.reading import read_study as read_study
    from bayesdeg.prediction.conditions import ServiceConditions as ServiceConditions
    from bayesdeg.priors import HalfNormal as HalfNormal
    from bayesdeg.priors import LogNormal as LogNormal
    from bayesdeg.priors import Normal as Normal
    from bayesdeg.priors import Parameter as Parameter
    from bayesdeg.priors import StudentT as StudentT
    from bayesdeg.priors import TruncatedNormal as TruncatedNormal
    from bayesdeg.priors import Uniform as Uniform
    from bayesdeg.results import Calibration as Calibration
    from bayesdeg.results import Model as Model
    from bayesdeg.results import Report as Report
    from bayesdeg.results import Verdict as Verdict

_HOMES = {
    "api": (
        *("calibrate", "compare", "control", "criticise", "emulator", "lifetime", "predict"),
        *("report", "update"),
    ),
    "causes.cause": ("Cause", "Stage"),
    "errors": ("BayesdegError", "GeometryError", "StudyError"),
    "priors": (
        *("HalfNormal", "LogNormal", "Normal", "Parameter", "StudentT", "TruncatedNormal"),
        "Uniform",
    ),
    "data.settings": ("Dimensions",),
    "data.study": ("Study",),
    "inference.own_map": ("Readings",),
    "pipeline.reading": ("read_study",),
    "prediction.conditions": ("ServiceConditions",),
    "results": ("Calibration", "Model", "Report", "Verdict"),
}
_HOME = {name: f"bayesdeg.{home}" for home, names in _HOMES.items() for name in names}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module 'bayesdeg' has no attribute {name!r}")
    if name in _VERBS_AND_PACKAGES:
        return importlib.import_module(f"bayesdeg.{name}")
    found = getattr(importlib.import_module(_HOME[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """List the public names."""
    return [*__all__, "__version__"]


_VERBS_AND_PACKAGES = ("emulator", "report")
"""Functions with the same name as a subpackage, which Python binds to that name on import."""


class _CallableSubpackage(ModuleType):
    """A subpackage that can also be called: calling it calls the public function of that name."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call the function of this name in `bayesdeg.api`."""
        return _verb(self)(*args, **kwargs)

    @property
    def __signature__(self) -> Any:
        """Signature of the function, for help and editors."""
        return importlib.import_module("inspect").signature(_verb(self))


def _verb(package: ModuleType) -> Any:
    return getattr(importlib.import_module("bayesdeg.api"), package.__name__.split(".")[-1])


class _Package(ModuleType):
    """The package itself; subpackages with the name of a public function become callable."""

    def __setattr__(self, name: str, value: object) -> None:
        if name in _VERBS_AND_PACKAGES and type(value) is ModuleType:
            value.__class__ = _CallableSubpackage
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
