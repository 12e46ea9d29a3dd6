r"""Specimens of one level that deviate together, which a fit takes for scatter of each.

Where a cause goes with what was set for whole specimens, as the degradation rate, all specimens of
a level deviate alike. A fit without that cause can only let specimens scatter more, and then finds
nothing wrong: everything is within a scatter that no two specimens of a level show. So the readings
are asked whether they deviate together. With :math:`J_k` what the deviation of specimen k does to
its readings, and scatter s from specimen to specimen, they are N(m, Σ) with

.. math:: \Sigma(s, t) = V(s) + X \Lambda^{-1} X^T + t^2 \sum_l B_l B_l^T,
          \qquad B_l = \sum_{k \in l} J_k,

the sum over levels of several specimens. What t > 0 gains over t = 0, each at its best s, is the
log-likelihood ratio of a scatter that a level shares (Searle, Casella and McCulloch 1992, Variance
components, doi:10.1002/9780470316856). Where it is clear, the model is criticised at the scatter
that the specimens of a level have among each other, and what they share is misfit.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.fit.linear import Linear, Whitening, is_seen, linearise, rooted
from bayesdeg.criticism.subject import columns_of
from bayesdeg.material.degradation import levels
from bayesdeg.observations.kinds import Deviations

Floats = NDArray[np.float64]

CLEAR = 5.0
"""Log-likelihood ratio from which specimens of a level deviate together: by chance in one study of
1,300, half of twice the ratio being χ² of one degree of freedom (Self and Liang 1987)."""
SHARED = (0.5, 1.0, 2.0)
"""Standard deviations of what a level shares that are tried, over the fitted scatter."""
SMALLEST, STEPS = 0.05, 10
"""Smallest scatter within levels that is tried, over the fitted one, and how many."""
FIRST = 0.25
"""Scatter over the fitted one at which it is seen in three densities whether more are worth it."""


def within_levels(linear: Linear, uncertain: Floats, centre: Floats) -> Linear:
    """Return the model at the scatter of specimens within levels, where levels deviate together.

    Parameters
    ----------
    linear : Linear
        At the mode of a fitted model.
    uncertain : array, shape (n_parameters, n_parameters)
        Covariance of the parameters given all but the readings.
    centre : array, shape (n_parameters,)
        Their mean given all but the readings.

    Returns
    -------
    Linear
        The same where specimens of a level do not clearly deviate together.
    """
    if not linear.is_known:
        return linear
    own = linear.subject.deviations(linear.mode)
    scatters, shared = _scatters(linear, own), _shared(linear, own)
    if len(scatters) != 1 or not shared.shape[1]:
        return linear
    place = scatters[0]
    law = _Law(linear, place, linear.jacobian @ rooted(uncertain), uncertain, centre, own)
    fitted = float(linear.mode[place])
    [alone] = law.log_densities(fitted, shared, (0.0,))
    if max(law.log_densities(fitted + np.log(FIRST), shared, SHARED)) < alone:
        return linear
    tried = fitted + np.linspace(np.log(SMALLEST), 0.0, STEPS)
    found = np.array([law.log_densities(at, shared, (0.0, *SHARED)) for at in tried])
    together = found[:, 1:].max(axis=1)
    if together.max() < found[:, 0].max() + CLEAR:
        return linear
    mode = linear.mode.copy()
    mode[place] = tried[int(np.argmax(together))]
    return linearise(linear.subject, mode, uncertain=uncertain)


@dataclass(frozen=True)
class _Law:
    """Readings at any scatter of specimens, with a prior of the scatter.

    Curves stay linearised about the deviations that specimens have at the fitted scatter.
    """

    linear: Linear
    place: int
    known: Floats
    uncertain: Floats
    centre: Floats
    own: Deviations

    def log_densities(self, at: float, shared: Floats, sizes: Iterable[float]) -> list[float]:
        """Return ln N(y; m, Σ) and ln of the prior for sizes of what levels share.

        At one scatter, less a constant.
        """
        mode = self.linear.mode.copy()
        mode[self.place] = at
        scatter, residual = self._scatter(mode), self.linear.subject.observed - self.linear.mean
        off = at - self.centre[self.place]
        prior = 0.5 * float(off**2 / self.uncertain[self.place, self.place])
        laws = (Whitening.of(scatter, np.hstack([self.known, k * shared])) for k in sizes)
        return [law.log_density(residual) - prior for law in laws]

    def _scatter(self, mode: Floats) -> Floats:
        """Return V(s): of specimens with deviations the fitted one, less what they lose."""
        total = self.linear.subject.scatter(mode)
        slope, rows = self.own.slope, np.any(self.own.slope, axis=1)
        lost = self.own.spread - self.linear.subject.deviations(mode).spread
        fitted = self.linear.scatter - slope * lost @ slope.T
        total[np.ix_(rows, rows)] = fitted[np.ix_(rows, rows)]
        return total


def _scatters(linear: Linear, own: Deviations) -> list[int]:
    """Return parameters that widen the scatter of specimens and nothing else, none of a cause."""
    subject = linear.subject
    of_causes = {k for cause in subject.causes for k in columns_of(subject, cause)}
    still = ~is_seen(linear.whiten_columns(linear.jacobian))
    found = []
    for k in np.flatnonzero(still):
        moved = linear.mode.copy()
        moved[k] += 0.5
        if k not in of_causes and np.any(subject.deviations(moved).spread > own.spread):
            found.append(int(k))
    return found


def _shared(linear: Linear, own: Deviations) -> Floats:
    """Return what a standard deviation of each level that has several specimens does, (n, l).

    Specimens of other families, as films beside actuators, are other levels.
    """
    if not len(own.spread):
        return np.zeros((len(linear.mean), 0))
    read, places = own.slope * np.sqrt(own.spread), linear.subject.places
    family = places.family[np.argmax(np.abs(read), axis=0)]
    level = levels(own.level)[1]
    columns = []
    for key in dict.fromkeys(zip(family.tolist(), level.tolist(), strict=True)):
        same = (family == key[0]) & (level == key[1])
        if np.sum(same) > 1:
            columns.append(read[:, same].sum(axis=1))
    return np.array(columns).reshape(len(columns), len(linear.mean)).T
