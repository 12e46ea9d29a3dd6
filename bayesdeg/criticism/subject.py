"""Parameters of causes in the vectors of an extended model."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.inference.density import Density

Floats = NDArray[np.float64]


def with_neutral(vector: Floats, density: Density, extended: Density) -> Floats:
    """Return a vector of an extended model with the added parameters at their neutral values."""
    known = dict(zip(density.table.names, vector, strict=True))
    return np.array(
        [
            known[p.name] if p.name in known else float(p.law.to_unconstrained(p.neutral or 0.0))
            for p in extended.table.parameters
        ]
    )


def typical_size(cause: Cause) -> Floats:
    """Return the catalogue's size of a cause on the unconstrained scale, (k,)."""
    sizes = [
        float(p.law.to_unconstrained(cause.typical.get(p.name, p.neutral or 0.0)))
        for p in cause.parameters
    ]
    return np.array(sizes)


def columns_of(extended: Density, cause: Cause) -> list[int]:
    """Return the indices of a cause's parameters in the vectors of an extended model."""
    names = extended.table.names
    return [names.index(cause.qualified(p.name)) for p in cause.parameters]
