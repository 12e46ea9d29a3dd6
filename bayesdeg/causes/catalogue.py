"""The catalogue: every module of this package that defines a ``CAUSE``."""

import difflib
import importlib
import pkgutil
from collections.abc import Iterable

import bayesdeg.causes
from bayesdeg.causes.cause import Cause
from bayesdeg.errors import BayesdegError


def in_order(causes: Iterable[Cause]) -> tuple[Cause, ...]:
    """Return causes in the order in which they are applied: by stage, then by name."""
    return tuple(sorted(causes, key=lambda cause: (cause.stage, cause.name)))


_MODULES = [
    importlib.import_module(f"{bayesdeg.causes.__name__}.{entry.name}")
    for entry in pkgutil.iter_modules(bayesdeg.causes.__path__)
]
CATALOGUE: dict[str, Cause] = {
    cause.name: cause
    for cause in in_order(module.CAUSE for module in _MODULES if hasattr(module, "CAUSE"))
}


def mechanism_of(name: str) -> str:
    """Return what happens by a cause; empty if it is not in the catalogue.

    Examples
    --------
    >>> mechanism_of("of my own")
    ''
    """
    return CATALOGUE[name].mechanism if name in CATALOGUE else ""


def find(name: str) -> Cause:
    """Return a cause by its name.

    Raises
    ------
    BayesdegError
        If no cause has this name; the message suggests the nearest one.

    Examples
    --------
    >>> find("pressure_offset").parameters[0].unit
    'kPa'
    """
    if name not in CATALOGUE:
        near = difflib.get_close_matches(name, CATALOGUE, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(CATALOGUE)}"
        raise BayesdegError(f"unknown cause {name!r}; {hint}")
    return CATALOGUE[name]
