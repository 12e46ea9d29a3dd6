"""Which rows of the files of a study no likelihood uses, and why."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import pandas as pd


class Why(StrEnum):
    """Why rows are not used."""

    AFTER_BURST = "after_burst"
    OUTSIDE_RANGE = "outside_stretch_range"
    UNDEFORMED = "undeformed"
    UNLOADED = "unloaded"
    BEYOND_REACH = "beyond_reach"
    SET_ASIDE = "set_aside"


@dataclass(frozen=True)
class Unused:
    """Rows of a file that no likelihood uses.

    Parameters
    ----------
    file : str
        Its name.
    why : Why
        The reason.
    rows : int
        How many; one or more.
    specimens : tuple of str
        Whose.
    """

    file: str
    why: Why
    rows: int
    specimens: tuple[str, ...]


def unused_of(file: str, why: Why, table: pd.DataFrame) -> tuple[Unused, ...]:
    """Return the entry of rows that are not used; nothing if there are none.

    Examples
    --------
    >>> rows = pd.DataFrame({"specimen_id": ["a", "a", "b"]})
    >>> unused_of("force.csv", Why.UNLOADED, rows)[0].specimens
    ('a', 'b')
    """
    if table.empty:
        return ()
    named = table["specimen_id"].astype(str) if "specimen_id" in table else pd.Series(dtype=str)
    return (Unused(file, why, len(table), tuple(dict.fromkeys(named))),)


def undeformed(tensile: pd.DataFrame) -> pd.Series:
    """Return which rows of films are at a stretch of exactly 1 and a stress of exactly 0.

    Every law of the material has them, with any cause, so they say nothing of either; and a
    prediction that is met exactly lets a density grow without bound as its error shrinks.

    Examples
    --------
    >>> films = pd.DataFrame({"stretch": [1.0, 1.0, 1.2], "stress_MPa": [0.0, 0.001, 0.0]})
    >>> undeformed(films).tolist()
    [True, False, False]
    """
    return (tensile["stretch"] == 1.0) & (tensile["stress_MPa"] == 0.0)


def at_rest(tables: Iterable[tuple[str, pd.DataFrame | None]]) -> tuple[Unused, ...]:
    """Return the rows of tables at no load, whose readings are 0 by the laws or by definition.

    Parameters
    ----------
    tables : iterable of (str, DataFrame or None)
        Of films or of actuators, by the names of their files.
    """
    found: list[Unused] = []
    for file, table in tables:
        if table is None:
            continue
        if "stretch" in table:
            found += unused_of(file, Why.UNDEFORMED, table[undeformed(table)])
        else:
            found += unused_of(file, Why.UNLOADED, table[table["pressure_kPa"] == 0.0])
    return tuple(found)
