r"""Specimens of one level that deviate together, which a fit takes for scatter of each.

Where a cause goes with what was set for whole specimens, as the degradation rate, all specimens of
a level deviate alike. A fit without that cause can only let specimens scatter more, and then finds
nothing wrong: everything is within a scatter that no two specimens of a level show. So the readings
are asked whether they deviate together. With :math:`J_k` what the deviation of specimen k does to
its readings, and scatter s from specimen to specimen, they are N(m, Σ) with

.. math:: \Sigma(s, t) = V(s) + X \Lambda^{-1} X^T + t^2 \sum_l B_l B_l^T,
          \qquad B_l = \sum_{k \in l} J_k,

the sum over levels of several specimens. Batches, and warmth with :math:`J_k` times its departure
from the mean, are looked at alike where they were recorded of specimens, alone and with the levels.
What t > 0 gains over t = 0, each at its best s, is the log-likelihood ratio of a scatter that is
shared (Searle, Casella and McCulloch 1992, Variance components, doi:10.1002/9780470316856). Where
it is clear, the model is criticised at the scatter that specimens have beside it, and what they
share is misfit.
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
"""Log-likelihood ratio from which specimens of a level deviate together. Twice the ratio is 0 or χ²
of one degree of freedom, each half of the time (Self and Liang 1987, doi:10.2307/2289471), so that
chance gives it in one study of 1,300; with as few specimens as are tested in one of 600 to 1,300,
and up to three times as often where batches and warmth are looked at too."""
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
        The same where specimens of a level, of a batch or of like warmth do not clearly deviate
        together, and where there is not one parameter that is their scatter, on a logarithmic
        scale to the sampler.
    """
    if not linear.is_known:
        return linear
    own = linear.subject.deviations(linear.mode)
    scatters, together = _scatters(linear, own), _together(linear, own)
    if len(scatters) != 1 or not together:
        return linear
    place = scatters[0]
    law = _Law(linear, place, linear.jacobian @ rooted(uncertain), uncertain, centre, own)
    gain, at = max(_gain(law, shared) for shared in together)
    if gain < CLEAR:
        return linear
    mode = linear.mode.copy()
    mode[place] = at
    return linearise(linear.subject, mode, uncertain=uncertain)


def _gain(law: "_Law", shared: Floats) -> tuple[float, float]:
    """Return the log-likelihood ratio of what is shared, and the scatter that it leaves."""
    fitted = float(law.linear.mode[law.place])
    [alone] = law.log_densities(fitted, shared, (0.0,))
    if max(law.log_densities(fitted + np.log(FIRST), shared, SHARED)) < alone:
        return 0.0, fitted
    tried = fitted + np.linspace(np.log(SMALLEST), 0.0, STEPS)
    found = np.array([law.log_densities(at, shared, (0.0, *SHARED)) for at in tried])
    best = found[:, 1:].max(axis=1)
    return float(best.max() - found[:, 0].max()), float(tried[int(np.argmax(best))])


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
        whitening = Whitening.of(scatter, self.known)
        laws = (whitening.sharing(np.hstack([self.known, k * shared])) for k in sizes)
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


def _together(linear: Linear, own: Deviations) -> list[Floats]:
    """Return what groups of specimens may share, each (n, number of groups).

    Levels of what was set, what was recorded of each specimen (batch and warmth), and both.
    """
    read = own.slope * np.sqrt(own.spread)
    of_levels, recorded = _of_levels(linear, own, read), _of_conditions(linear, read)
    found = [of_levels] if of_levels.shape[1] else []
    if recorded.shape[1]:
        found += [recorded, np.hstack([of_levels, recorded])]
    return found


def _of_levels(linear: Linear, own: Deviations, read: Floats) -> Floats:
    """Return what a deviation of each level that has several specimens does.

    Specimens of other families, as films beside actuators, are other levels.
    """
    if not len(own.spread):
        return np.zeros((len(linear.mean), 0))
    family = linear.subject.places.family[np.argmax(np.abs(read), axis=0)]
    level = levels(own.level)[1]
    keys = dict.fromkeys(zip(family.tolist(), level.tolist(), strict=True))
    return _sums(read, [(family == of) & (level == at) for of, at in keys])


def _of_conditions(linear: Linear, read: Floats) -> Floats:
    """Return what a deviation of each batch does, and one that goes with warmth."""
    actuator = linear.subject.actuator
    if actuator is None or read.shape[1] != len(actuator.specimens):
        return np.zeros((len(read), 0))
    tests = actuator.conditions
    batch = np.broadcast_to(tests.batch, tests.pressure.shape)[:, 0]
    names = np.unique(batch)
    batches = [batch == one for one in names] if len(names) > 1 else []
    return np.hstack([_sums(read, batches), read @ _warmth(tests.room_temperature, len(batch))])


def _warmth(temperature: Floats, count: int) -> Floats:
    """Return how much warmer than the mean each test was, of a spread of 1, (count, 0 or 1)."""
    warmth = np.broadcast_to(temperature, count)
    known = np.isfinite(warmth)
    if not known.any() or np.ptp(warmth[known]) == 0.0:
        return np.zeros((count, 0))
    above = np.where(known, warmth - np.mean(warmth[known]), 0.0)
    return (above / np.std(above))[:, None]


def _sums(read: Floats, groups: Iterable[NDArray[np.bool_]]) -> Floats:
    """Return the sums over groups of several specimens, (n, number of these)."""
    columns = [read[:, group].sum(axis=1) for group in groups if np.sum(group) > 1]
    return np.array(columns).reshape(len(columns), len(read)).T
