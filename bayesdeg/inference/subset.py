"""A model without some of its specimens, and which data each specimen has."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.curves import ActuatorCurves, Breaks, TensileCurves
from bayesdeg.inference.model import Model


def specimens_of(model: Model, kind: str) -> tuple[str, ...]:
    """Return the specimens of one kind of log likelihood, row by row.

    Parameters
    ----------
    model : Model
        With its data.
    kind : str
        A key of ``Model.log_likelihood``.

    Returns
    -------
    tuple of str
        Empty for summary statistics, which are of no specimen of the study.
    """
    data = {"tensile": model.tensile, "breaks": model.breaks, "statistics": None}
    rows = data.get(kind, model.actuator)  # an actuator's readings, and whether it burst
    return () if rows is None else rows.specimens


def blocks_of(model: Model, kinds: Iterable[str]) -> dict[str, dict[str, NDArray[np.intp]]]:
    """Return the rows of every specimen in every kind of data that it has.

    A film that was stretched and then torn stands in two tables under one name, one that was
    stretched in two modes has two curves: it is one block.

    Parameters
    ----------
    model : Model
        With its data.
    kinds : iterable of str
        Keys of ``Model.log_likelihood``.

    Returns
    -------
    dict
        Rows by specimen and kind, specimens in the order in which they first stand.
    """
    blocks: dict[str, dict[str, list[int]]] = {}
    for kind in kinds:
        for row, specimen in enumerate(specimens_of(model, kind)):
            blocks.setdefault(specimen, {}).setdefault(kind, []).append(row)
    return {
        specimen: {kind: np.array(rows, dtype=np.intp) for kind, rows in found.items()}
        for specimen, found in blocks.items()
    }


def without(model: Model, specimens: Iterable[str]) -> Model:
    """Return the model for the data without some specimens, in whatever tables they stand.

    Priors, parameters and summary statistics stay.

    Raises
    ------
    ValueError
        If the model has no specimen of a name.
    """
    left_out = frozenset(specimens)
    tables = (model.tensile, model.actuator, model.breaks)
    known = {name for data in tables if data is not None for name in data.specimens}
    if unknown := left_out - known:
        raise ValueError(f"there is no specimen {', '.join(sorted(unknown))}")
    return replace(
        model,
        tensile=_without(model.tensile, left_out),
        actuator=_without(model.actuator, left_out),
        breaks=_without(model.breaks, left_out),
    )


def _without[T: (TensileCurves, ActuatorCurves, Breaks)](
    data: T | None, left_out: frozenset[str]
) -> T | None:
    if data is None:
        return None
    kept = [row for row, name in enumerate(data.specimens) if name not in left_out]
    return data.subset(np.array(kept, dtype=np.intp)) if kept else None
