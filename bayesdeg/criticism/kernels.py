"""Smooth discrepancies of readings: the covariances by which a misfit is measured.

Within one family of readings a discrepancy is a smooth function of the path and of the degradation
rate, in proportion to a smooth envelope of the readings. It is common to all histories of load or
one for each; it may be each specimen's own; and it may be the same for every kind of reading in the
family or of the first kind alone. Its covariance between readings i and j is

    a² e_i e_j exp(−(s_i − s_j)²/(2 ℓ²) − (D_i − D_j)²/(2 w²)) [same history or specimen],

with s the path in its largest extent, D the degradation rate [%] and e the envelope.

Source: Kennedy and O'Hagan (2001), doi:10.1111/1467-9868.00294, for discrepancies of this kind.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpstrf

from bayesdeg.criticism.linear import Linear
from bayesdeg.criticism.subject import Places

Floats = NDArray[np.float64]

SHORT, LONG = 0.25, 0.625
"""Lengths along the path, in its largest extent: 60 and 150 kPa of 240."""
DRIFT, EACH = 12.0, 2.0
"""Lengths along the degradation rate [%]: one that drifts, and one for each level."""
EVERYWHERE = 1e3
ALIKE = (1.0, 0.0)
"""Discrepancy of the other kinds of a family over that of the first."""
SMALLEST = 1e-8
"""Share of the largest variance at which a kernel's directions are cut off."""


@dataclass(frozen=True)
class Discrepancy:
    """One covariance of discrepancies on the whitened scale.

    Parameters
    ----------
    family : str
        Of which readings.
    label : str
        In words: what it is a function of.
    values : array, shape (r,)
        Eigenvalues for a relative size of 1.
    vectors : array, shape (n, r)
        Eigenvectors.
    """

    family: str
    label: str
    values: Floats
    vectors: Floats


def discrepancies(linear: Linear) -> tuple[Discrepancy, ...]:
    """Return every discrepancy that is tried, on the whitened scale of a linearised model."""
    found = []
    for family, label, root in discrepancy_roots(linear.subject.places, linear.mean):
        half = linear.whiten_columns(root)
        values, turned = np.linalg.eigh(half.T @ half)
        keep = values > SMALLEST * max(float(values[-1]), 1e-300)
        vectors = half @ turned[:, keep] / np.sqrt(values[keep])
        found.append(Discrepancy(family, label, values[keep], vectors))
    return tuple(found)


def discrepancy_roots(places: Places, mean: Floats) -> Iterator[tuple[str, str, Floats]]:
    """Yield family, label and a factor (n, r) of every kernel of relative size 1.

    The discrepancy is in proportion to the given readings (n,); the factor is zero in readings of
    other families.
    """
    for family in dict.fromkeys(places.family.tolist()):
        rows = places.family == family
        kinds = list(dict.fromkeys(places.kind[rows].tolist()))
        shapes = list(_shapes(places.subset(rows)))
        for of_others in ALIKE if len(kinds) > 1 else ALIKE[:1]:
            envelope = _envelope(places, mean, rows, kinds, of_others)[rows]
            for label, kernel in shapes:
                root = _root(kernel * np.outer(envelope, envelope))
                whole = np.zeros((len(rows), root.shape[1]))
                whole[rows] = root
                yield family, label, whole


def _envelope(
    places: Places, mean: Floats, rows: NDArray[np.bool_], kinds: list[str], of_others: float
) -> Floats:
    """Return the readings' size, but not nothing where they are small; 0 in other families."""
    envelope = np.zeros(len(mean))
    for number, kind in enumerate(kinds):
        own = rows & (places.kind == kind)
        size = np.abs(mean[own])
        envelope[own] = (1.0 if number == 0 else of_others) * (size + 0.1 * size.max(initial=0.0))
    return envelope


def _shapes(places: Places) -> Iterator[tuple[str, Floats]]:
    """Return what a discrepancy of one family may be a function of, each (n, n)."""
    along = places.along / max(float(np.ptp(places.along)), 1e-12)
    levels = len(np.unique(places.level.round(6)))

    def smooth(short: float, across: float) -> Floats:
        square = ((along[:, None] - along) / short) ** 2
        square += ((places.level[:, None] - places.level) / across) ** 2
        return np.exp(-0.5 * square)

    yield "the path", smooth(SHORT, EVERYWHERE)
    if levels > 1:
        yield "the path, drifting with degradation", smooth(SHORT, DRIFT)
        yield "the path, slowly", smooth(LONG, EVERYWHERE)
        yield "the path, slowly, drifting with degradation", smooth(LONG, DRIFT)
        yield "the path, for each degradation rate", smooth(LONG, EACH)
    for label, group in (("history of load", places.history), ("specimen", places.specimen)):
        if 1 < len(np.unique(group)) < len(places):
            same = (group[:, None] == group).astype(np.float64)
            yield f"the path, for each {label}", smooth(LONG, EVERYWHERE) * same


def _root(kernel: Floats) -> Floats:
    """Return a factor (n, r) of a covariance of low rank, by Cholesky with pivots."""
    factor, pivots, rank, _ = dpstrf(kernel, lower=1, tol=SMALLEST * float(np.diag(kernel).max()))
    lower = np.tril(factor)[:, :rank]
    root = np.empty_like(lower)
    root[pivots - 1] = lower
    return root
