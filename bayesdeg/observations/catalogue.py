"""The kinds of data: every module of this package that reads data from a study.

Such a module has ``from_study``; one whose data are part of another kind, as ruptures are of
actuators whose curvature was read, has ``from_observations``. One with its own file, beyond those
of films and actuators, has ``TABLE``, its columns.
"""

import importlib
import pkgutil
from collections.abc import Iterable, Mapping
from types import MappingProxyType, ModuleType

import bayesdeg.observations
from bayesdeg.data import tables
from bayesdeg.data.study import Study
from bayesdeg.data.tables import Table
from bayesdeg.observations.kinds import Observations


def _discover() -> tuple[ModuleType, ...]:
    return tuple(
        importlib.import_module(f"{bayesdeg.observations.__name__}.{entry.name}")
        for entry in pkgutil.iter_modules(bayesdeg.observations.__path__)
        if entry.name != __name__.rsplit(".", 1)[-1]
    )


MODULES = _discover()

#: All data files by their names in a study.
TABLES: Mapping[str, Table] = MappingProxyType(
    {**tables.BASE_TABLES} | {one.TABLE.name: one.TABLE for one in MODULES if hasattr(one, "TABLE")}
)
DATA_FILES = tuple(table.file for table in TABLES.values())


def in_order(kinds: Iterable[Observations]) -> tuple[Observations, ...]:
    """Return kinds of data in their order of simulation and display."""
    return tuple(sorted(kinds, key=lambda one: one.order))


def of_kind[K: Observations](found: Iterable[Observations], kind: type[K]) -> tuple[K, ...]:
    """Return the data of one kind: one entry, or none."""
    return tuple(one for one in found if isinstance(one, kind))


def observations_of(study: Study) -> tuple[Observations, ...]:
    """Return all data of a study.

    Raises
    ------
    StudyError
        If data are invalid.
    """
    found: list[Observations] = []
    for module in MODULES:
        if hasattr(module, "from_study"):
            found += module.from_study(study)
    for module in MODULES:  # after all others
        if hasattr(module, "from_observations"):
            found += module.from_observations(tuple(found))
    needed = (one.among(tuple(found)) for one in found)
    return in_order(one for one in needed if one.labels)
