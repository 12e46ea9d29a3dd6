"""Log densities of whole specimens, over everything that was read on each."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import Named
from bayesdeg.inference.subset import blocks_of

Floats = NDArray[np.float64]


def specimen_density(
    model: Model, values: Named
) -> tuple[tuple[str, ...], tuple[str, ...], Floats]:
    """Return log densities of all readings of each specimen.

    Given the parameters, the readings of one specimen in different tables are independent, so that
    their log densities add up.

    Parameters
    ----------
    model : Model
        With its data.
    values : mapping
        Named values, (n,).

    Returns
    -------
    specimens, kinds : tuple of str
        Names, and what was read on each.
    density : array, shape (n, n_specimens)
        −inf where the model has no answer.
    """
    by_kind = model.log_likelihood(values)
    blocks = blocks_of(model, by_kind)
    columns = [
        sum(by_kind[kind][:, rows].sum(axis=-1) for kind, rows in found.items())
        for found in blocks.values()
    ]
    count = len(next(iter(values.values())))
    density = np.stack(columns, axis=-1) if columns else np.empty((count, 0))
    known = np.where(np.isnan(density), -np.inf, density)
    return tuple(blocks), tuple(", ".join(found) for found in blocks.values()), known
