"""Rows of a study's files that no likelihood uses, and why."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

import pandas as pd


class Why(StrEnum):
    """Reason why rows are not used."""

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
        Number of rows, at least one.
    specimens : tuple of str
        Specimens of these rows.
    """

    file: str
    why: Why
    rows: int
    specimens: tuple[str, ...]


def unused_of(file: str, why: Why, table: pd.DataFrame) -> tuple[Unused, ...]:
    """Return the entry for unused rows; empty if there are none.

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
    """Return which film rows have a stretch of exactly 1 and a stress of exactly 0.

    Every material law, with any cause, satisfies them, so they carry no information; and an exactly
    met prediction lets a density grow without bound as its error shrinks.

    Examples
    --------
    >>> films = pd.DataFrame({"stretch": [1.0, 1.0, 1.2], "stress_MPa": [0.0, 0.001, 0.0]})
    >>> undeformed(films).tolist()
    [True, False, False]
    """
    return (tensile["stretch"] == 1.0) & (tensile["stress_MPa"] == 0.0)


def at_rest(tables: Iterable[tuple[str, pd.DataFrame | None]]) -> tuple[Unused, ...]:
    """Return the rows of tables without load, whose readings are 0 by the laws or by definition.

    Parameters
    ----------
    tables : iterable of (str, DataFrame or None)
        Films or actuators, with the names of their files.
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
