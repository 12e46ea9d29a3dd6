"""Batches of specimens: the column ``batch``, as names and as numbers."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray


def recorded_batches(table: pd.DataFrame | None) -> dict[str, str]:
    """Return the recorded batch of each specimen of a table, in order of appearance.

    Examples
    --------
    >>> table = pd.DataFrame({"specimen_id": ["a", "a", "b"], "batch": ["1", "1", None]})
    >>> recorded_batches(table), recorded_batches(None)
    ({'a': '1'}, {})
    """
    if table is None or "batch" not in table:
        return {}
    known = table[table["batch"].notna() & (table["batch"].astype(str) != "")]
    first = known.drop_duplicates("specimen_id")
    return dict(zip(first["specimen_id"].astype(str), first["batch"].astype(str), strict=True))


def batch_order(tensile: pd.DataFrame | None, actuator: pd.DataFrame | None) -> tuple[str, ...]:
    """Return the batches of films and actuators, the reference batch first.

    The reference is the batch of most films; where films record none, of most actuators. Other
    batches of actuators follow by name, then those of films alone. Row order does not matter.

    Examples
    --------
    >>> films = pd.DataFrame({"specimen_id": ["f", "g"], "batch": ["B", "B"]})
    >>> parts = pd.DataFrame({"specimen_id": ["a", "b", "c"], "batch": ["C", "A", "B"]})
    >>> batch_order(films, parts)
    ('B', 'A', 'C')
    """
    films, actuators = (recorded_batches(one) for one in (tensile, actuator))
    counted = list((films or actuators).values())
    if not counted:
        return ()
    names = sorted({*actuators.values()}) + sorted({*films.values()} - {*actuators.values()})
    first = max(sorted(set(counted)), key=counted.count)
    return (first, *(name for name in names if name != first))


def batch_numbers(table: pd.DataFrame, order: Sequence[str]) -> NDArray[np.int64]:
    """Return the index of each specimen's batch in `batch_order`, (n_specimens,).

    0 where none is recorded. Specimens are taken in order of appearance.

    Examples
    --------
    >>> table = pd.DataFrame({"specimen_id": ["a", "b", "c"], "batch": ["C", None, "A"]})
    >>> batch_numbers(table, ("B", "A", "C")).tolist()
    [2, 0, 1]
    """
    of, place = recorded_batches(table), {name: k for k, name in enumerate(order)}
    names = table["specimen_id"].astype(str).drop_duplicates()
    return np.array([place.get(of.get(name, ""), 0) for name in names], dtype=np.int64)
