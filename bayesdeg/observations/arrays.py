"""Ragged tables as padded arrays: specimens by observations."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


def padded(columns: Sequence["pd.Series[float]"], size: int, *, fill: float) -> Floats:
    """Return columns as rows of equal length, padded where shorter."""
    out = np.full((len(columns), size), fill)
    for row, column in enumerate(columns):
        out[row, : len(column)] = column.to_numpy(np.float64)
    return out


def chosen[T](data: T, rows: Rows) -> T:
    """Select specimens from a frozen dataclass whose fields have one entry per specimen.

    A field may be None: nothing was recorded.
    """
    found: dict[str, Any] = {}
    for field in fields(data):  # type: ignore[arg-type]
        value = getattr(data, field.name)
        if value is None:
            continue
        if isinstance(value, tuple):
            found[field.name] = tuple(value[i] for i in rows)
        else:
            found[field.name] = chosen(value, rows) if is_dataclass(value) else value[rows]
    changed: T = replace(data, **found)  # type: ignore[type-var]
    return changed
