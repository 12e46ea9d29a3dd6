r"""Whether the errors that a model assumes are plausible, apart from the model.

Noise and scatter are fitted, so they may take up any misfit. Two things are known of them without
the model. Reading noise is independent from reading to reading: second differences of the residuals
along a curve have the size of the noise, whatever smooth misfit there is,

.. math:: s = \sqrt{\overline{(r_{j-1} - 2 r_j + r_{j+1})^2}},

and in data simulated from the model they are about as large as in the measured ones. And a model
that predicts readings is better than their mean: with the scatter of specimens left out,

.. math:: R^2 = 1 - \frac{\sum (y - f)^2}{\sum (y - \bar y)^2} \ge 0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.fit.linear import Linear

Floats = NDArray[np.float64]

SEVERAL = 3.0
"""Ratio of the noise that the model assumes to that of the readings, above which a misfit has been
taken for noise."""
FEWEST = 12  # second differences: their rms is known to a fifth if they are independent


@dataclass(frozen=True)
class TakenForErrors:
    """The model needs errors that the readings do not have.

    Parameters
    ----------
    kind : str
        Kind of the readings.
    noise_ratio : float
        Noise that it assumes, over what neighbouring readings differ by [–].
    r_squared : float
        R² of its predictions without scatter [–].
    """

    kind: str
    noise_ratio: float
    r_squared: float


def implausible_errors(linear: Linear, simulated: Floats) -> TakenForErrors | None:
    """Return what is implausible of the errors of a fitted model; None if nothing is.

    Parameters
    ----------
    linear : Linear
        The fitted model; the first kind of the family that comes last is looked at.
    simulated : array, shape (k, n_readings)
        Data sets simulated from it.
    """
    places, observed = linear.subject.places, linear.subject.observed
    rows = places.family == places.family[-1]
    rows = rows & (places.kind == places.kind[rows][0])
    kind = str(places.kind[rows][0])
    residual = observed - linear.prediction
    spread = float(np.sum((observed[rows] - observed[rows].mean()) ** 2))
    r_squared = 1.0 - float(np.sum(residual[rows] ** 2)) / max(spread, 1e-300)
    ratio = 1.0
    first = _triples(np.flatnonzero(rows), places.specimen)
    if len(first) >= FEWEST and len(simulated):
        own = _roughness(residual[None], first)[0]
        assumed = float(np.median(_roughness(simulated - linear.prediction, first)))
        ratio = assumed / max(own, 1e-12 * assumed) if assumed > 0.0 else 1.0
    if ratio < SEVERAL and r_squared >= 0.0:
        return None
    return TakenForErrors(kind, ratio, r_squared)


def _triples(rows: NDArray[np.intp], specimen: NDArray[np.str_]) -> NDArray[np.intp]:
    """Return neighbouring readings of one specimen, three each, (n, 3)."""
    triples = np.column_stack([rows[:-2], rows[1:-1], rows[2:]])
    names = specimen[triples]
    kept: NDArray[np.intp] = triples[(names[:, 0] == names[:, 1]) & (names[:, 1] == names[:, 2])]
    return kept


def _roughness(residuals: Floats, triples: NDArray[np.intp]) -> Floats:
    """Return the rms of second differences of residuals (k, n), (k,)."""
    before, here, after = (residuals[:, triples[:, k]] for k in range(3))
    return np.sqrt(np.mean((before - 2.0 * here + after) ** 2, axis=1))
