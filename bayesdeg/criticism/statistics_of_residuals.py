r"""Numbers with a physical reading, as projections of residuals that know of the refit.

With e the errors and scatter left after the parameters are fitted again
(`bayesdeg.criticism.linear.Linear.unexplained`), every statistic is a projection of e, scaled so
that the effect it is named after has the size it states. Since e = V C⁻¹ (y − mean) is linear in
the whitened data z, so is the projection:

.. math:: T = \omega^T z .

Two ways lead to ω: generalised least squares with further directions fitted beside, which has the
smallest variance, and a plain functional of e such as an area.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.discrepancy import Misfit
from bayesdeg.criticism.linear import Linear
from bayesdeg.criticism.residuals import levels
from bayesdeg.criticism.subject import Labels

Floats = NDArray[np.float64]

INSEPARABLE = 1e-6
"""Share of a direction's square left beside others, below which it is none of its own."""


@dataclass(frozen=True)
class Statistic:
    """What is computed of whitened data, and what it means.

    Parameters
    ----------
    name, unit : str
        As in the report.
    more, less : str
        What a value above, or below, that of a right model means physically.
    projections : array, shape (n, r), optional
        Directions in whitened data: one for a size, several for the mean of their squares. None
        where the readings do not have it.
    why : str
        What is missing where there are none.
    neutral : float
        Size where the model is right.
    squares : bool
        Whether it is the mean square of the projections or the size along the only one.
    """

    name: str
    unit: str
    more: str
    less: str
    projections: Floats | None
    why: str = ""
    neutral: float = 0.0
    squares: bool = False

    def of(self, whitened: Floats) -> Floats:
        """Return the statistic of whitened data sets (..., n), shape (...)."""
        assert self.projections is not None
        projected = whitened @ self.projections
        if self.squares:
            return np.asarray(np.mean(projected**2, axis=-1))
        return np.asarray(self.neutral + projected[..., 0])


def regression(linear: Linear, direction: Floats, *beside: Floats) -> Floats | None:
    r"""Return the projection that gives the size of an effect by generalised least squares.

    .. math:: \omega = w_\perp / |w_\perp|^2, \qquad w_\perp = (I - P_B)\, L^{-1} d

    with d the direction, L the Cholesky factor of the readings' covariance with the parameters
    integrated out, and P_B the projection on the directions fitted beside.

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    direction : array, shape (n,)
        Change of the readings by one unit of the effect.
    *beside : array, shape (n,)
        Directions whose sizes are free, so that the statistic does not answer to them.

    Returns
    -------
    array, shape (n, 1), or None
        None where the direction is made of those beside it.
    """
    columns = linear.whiten_columns(np.column_stack([direction, *beside]))
    own, others = columns[:, 0], columns[:, 1:]
    others = others[:, np.any(others != 0.0, axis=0)]
    if others.shape[1]:
        basis = np.linalg.qr(others / np.linalg.norm(others, axis=0))[0]
        left = own - basis @ (basis.T @ own)
    else:
        left = own
    square = float(left @ left)
    if square <= INSEPARABLE * float(own @ own):
        return None
    return np.asarray(left / square)[:, None]


def functional(linear: Linear, weights: Floats, reference: Floats) -> Floats:
    """Return the projection that gives a weighted sum of the residuals, (n, 1).

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    weights : array, shape (n,)
        Of the residuals.
    reference : array, shape (n,)
        Change of the readings whose weighted sum is 1: what the refit takes of it is given back.
    """
    projection = linear.whiten_columns((linear.scatter @ weights)[:, None])
    seen = float(linear.whiten_columns(reference[:, None])[:, 0] @ projection[:, 0])
    return np.asarray(projection / seen)


def between_specimens(
    linear: Linear, size: Floats, *, alike: Labels | None = None
) -> Floats | None:
    """Return directions in which specimens of the same level differ, (n, r), orthonormal.

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    size : array, shape (n,)
        Change of the readings by one unit; 0 where a reading is of another family.
    alike : array of str, shape (n,), optional
        What else must be the same for specimens to be compared: mount, mode of tension.

    Returns
    -------
    array or None
        r is the number of specimens less that of groups in which they are alike; None where it
        is zero.
    """
    places, rows = linear.subject.places, size != 0.0
    names, first = np.unique(places.specimen[rows], return_index=True)
    if len(names) < 2:
        return None
    member = levels(places.level[rows][first])[1]
    alike = places.family if alike is None else alike
    label = alike[rows][first]
    same = ((member[:, None] == member) & (label[:, None] == label)).astype(np.float64)
    same /= np.sum(same, axis=1, keepdims=True)
    values, turned = np.linalg.eigh(np.eye(len(names)) - same)
    contrasts = turned[:, values > 0.5]
    if contrasts.shape[1] == 0:
        return None
    each = linear.whiten_columns(size[:, None] * (places.specimen[:, None] == names))
    return np.linalg.qr(np.linalg.pinv(each).T @ contrasts)[0]


def misfit_frame(linear: Linear, misfit: Misfit, model: str) -> pd.DataFrame:
    """Return what the measured discrepancy is at each reading, and what scatters about it.

    The residual is that of a fit which has the discrepancy beside the parameters, so that points
    scatter about the curve by error and specimens alone.

    Parameters
    ----------
    linear : Linear
        The model linearised at its mode.
    misfit : Misfit
        What was measured with it.
    model : str
        Its name, such as ``base``.

    Returns
    -------
    pandas.DataFrame
        Columns ``model``, ``kind``, ``history``, ``specimen_id``, ``degradation_pct``, ``along``
        (pressure [kPa] or stretch), ``discrepancy`` and ``residual`` in the readings' units.
    """
    places = linear.subject.places
    smooth = misfit.discrepancy
    left = linear.observed - linear.whiten_columns(smooth[:, None])[:, 0]
    return pd.DataFrame(
        {
            "model": model,
            "kind": places.kind,
            "history": places.history,
            "specimen_id": places.specimen,
            "degradation_pct": places.level,
            "along": places.along,
            "discrepancy": smooth,
            "residual": smooth + linear.unexplained(left),
        }
    )
