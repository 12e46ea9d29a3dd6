"""Where the readings of a custom forward map stand, and whether all shapes go together."""

from dataclasses import fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bayesdeg.criticism.subject import Labels, Places

Floats = NDArray[np.float64]


def places_of(
    along: ArrayLike,
    *,
    kind: ArrayLike = "reading",
    level: ArrayLike = 0.0,
    specimen: ArrayLike | None = None,
    history: ArrayLike = "once",
    time: ArrayLike = np.nan,
) -> Places:
    """Return places of readings, by default of one kind and each of a specimen of its own.

    Parameters
    ----------
    along : array, shape (n,)
        What was varied, in its unit.
    kind, level, specimen, history, time : array, optional
        As in `bayesdeg.criticism.subject.Places`; each broadcasts to (n,).

    Raises
    ------
    ValueError
        If shapes do not go together.

    Examples
    --------
    >>> places_of([0.5, 1.0], kind="time").specimen.tolist()
    ['1', '2']
    """
    path = np.asarray(along, dtype=np.float64)
    if path.ndim != 1:
        raise ValueError(f"along must have one axis, that of the readings, not shape {path.shape}")
    own = np.arange(1, len(path) + 1).astype(np.str_) if specimen is None else specimen

    def labels(values: ArrayLike) -> Labels:
        return np.broadcast_to(np.asarray(values, dtype=np.str_), path.shape)

    def numbers(values: ArrayLike) -> Floats:
        return np.broadcast_to(np.asarray(values, dtype=np.float64), path.shape)

    return Places(
        labels(kind), labels("readings"), path, numbers(level), labels(own), labels(history),
        numbers(time),
    )  # fmt: skip


def spread(values: ArrayLike, shape: tuple[int, ...], source: str) -> Floats:
    """Return values brought to the shape of vectors by readings.

    Raises
    ------
    ValueError
        If they do not broadcast; the message names the function that gave them.
    """
    found = np.asarray(values, dtype=np.float64)
    try:
        return np.broadcast_to(found, shape)
    except ValueError:
        raise ValueError(
            f"{source} must return what broadcasts to {shape}, vectors by readings, "
            f"not shape {found.shape}"
        ) from None


def check_shapes(
    observed: Floats, places: Places, group: Labels, rows: NDArray[np.intp] | None
) -> None:
    """Refuse readings, places, groups and rows that do not go together.

    Raises
    ------
    ValueError
        Naming what has the wrong shape, or the specimen that is in several groups.
    """
    if np.ndim(observed) != 1 or not np.all(np.isfinite(observed)):
        raise ValueError(f"observed must be finite, with one axis, not shape {np.shape(observed)}")
    named = {f"places.{f.name}": getattr(places, f.name) for f in fields(Places)}
    for name, values in {**named, "group": group, "rows": rows}.items():
        if values is not None and np.shape(values) != np.shape(observed):
            raise ValueError(
                f"{name} must have the shape of the readings, {np.shape(observed)}, "
                f"not {np.shape(values)}"
            )
    for specimen in np.unique(places.specimen):
        owners = np.unique(group[places.specimen == specimen])
        if len(owners) > 1:
            raise ValueError(
                f"specimen {str(specimen)!r} is in several groups, {owners.tolist()}: "
                "readings of one specimen are held out together"
            )
