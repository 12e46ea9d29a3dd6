r"""Specimens of one level that deviate together, which a fit mistakes for independent scatter.

If a cause depends on a setting of whole specimens, such as the degradation rate, all specimens of a
level deviate equally. A fit without that cause can only increase the specimen scatter, and then
finds no misfit, although specimens within a level do not scatter that much. So the readings are
tested for common deviations. With :math:`J_k` the effect of the deviation of specimen k on its
readings, and scatter s between specimens, they are N(m, Σ) with

.. math:: \Sigma(s, t) = V(s) + X \Lambda^{-1} X^T + t^2 \sum_l B_l B_l^T,
          \qquad B_l = \sum_{k \in l} J_k,

the sum over levels with several specimens. Batches, and temperature with :math:`J_k` times its
departure from the mean, are treated in the same way if they were recorded, alone and with the
levels. The gain of t > 0 over t = 0, each at its best s, is the log-likelihood ratio of a shared
scatter (Searle, Casella and McCulloch 1992, Variance components, doi:10.1002/9780470316856). If it
is clear, the model is criticised at the remaining specimen scatter, and the shared part counts as
misfit.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.fit.linear import Linear, Whitening, columns_of, is_seen, linearise, rooted
from bayesdeg.data.levels import levels
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.kinds import Deviations

Floats = NDArray[np.float64]

CLEAR = 5.0
"""Log-likelihood ratio from which specimens of a level deviate together. Twice the ratio is 0 or χ²
of one degree of freedom, each half of the time (Self and Liang 1987, doi:10.2307/2289471), so that
chance gives it in one study of 1,300; with as few specimens as are tested in one of 600 to 1,300,
and up to three times as often where batches and warmth are looked at too."""
SHARED = (0.5, 1.0, 2.0)
"""Tried standard deviations of the shared part, over the fitted scatter."""
SMALLEST, STEPS = 0.05, 10
"""Lowest within-level scatter tried, relative to the fitted one, and number of values tried."""
FIRST = 0.25
"""Scatter over the fitted one at which three densities show whether more are worthwhile."""


def within_levels(linear: Linear, uncertain: Floats, centre: Floats) -> Linear:
    """Return the model at the scatter within levels, if specimens of levels deviate together.

    Covariance and centre are those of the parameters given all but the readings. The model is
    returned as it is where specimens of a level, of a batch or of like warmth do not clearly
    deviate together, and where there is not one parameter that is their scatter, on a logarithmic
    scale to the sampler.
    """
    if not linear.is_known:
        return linear
    subject, own = linear.subject, linear.subject.deviations(linear.mode)
    of_causes = {k for cause in subject.causes for k in columns_of(subject, cause)}
    scatters = []  # parameters that only widen specimen scatter
    for k in np.flatnonzero(~is_seen(linear.whiten_columns(linear.jacobian))):
        moved = linear.mode.copy()
        moved[k] += 0.5
        if k not in of_causes and np.any(subject.deviations(moved).spread > own.spread):
            scatters.append(int(k))
    # what levels, what was recorded of each specimen (batch and warmth), and both have in common
    read = own.slope * np.sqrt(own.spread)
    of_levels, recorded = _of_levels(linear, own, read), _of_conditions(linear, read)
    together = [of_levels] if of_levels.shape[1] else []
    if recorded.shape[1]:
        together += [recorded, np.hstack([of_levels, recorded])]
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
    """Return the log-likelihood ratio of a shared part, and the remaining scatter."""
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
        # V(s): the fitted covariance, less the reduction of specimen scatter
        scatter = self.linear.subject.scatter(mode)
        slope, rows = self.own.slope, np.any(self.own.slope, axis=1)
        lost = self.own.spread - self.linear.subject.deviations(mode).spread
        fitted = self.linear.scatter - slope * lost @ slope.T
        scatter[np.ix_(rows, rows)] = fitted[np.ix_(rows, rows)]
        residual = self.linear.subject.observed - self.linear.mean
        off = at - self.centre[self.place]
        prior = 0.5 * float(off**2 / self.uncertain[self.place, self.place])
        whitening = Whitening.of(scatter, self.known)
        laws = (whitening.sharing(np.hstack([self.known, k * shared])) for k in sizes)
        return [law.log_density(residual) - prior for law in laws]


def _of_levels(linear: Linear, own: Deviations, read: Floats) -> Floats:
    """Return the effect of a common deviation of each level with several specimens.

    Specimens of different families, such as films and actuators, form different levels.
    """
    if not len(own.spread):
        return np.zeros((len(linear.mean), 0))
    family = linear.subject.places.family[np.argmax(np.abs(read), axis=0)]
    level = levels(own.level)[1]
    keys = dict.fromkeys(zip(family.tolist(), level.tolist(), strict=True))
    return _sums(read, [(family == of) & (level == at) for of, at in keys])


def _of_conditions(linear: Linear, read: Floats) -> Floats:
    """Return the effects of a deviation of each batch, and of one with temperature."""
    actuator = linear.subject.data_of(Curvature).tests
    if not len(actuator.specimens) or read.shape[1] != len(actuator.specimens):
        return np.zeros((len(read), 0))
    tests = actuator.conditions
    batch = np.broadcast_to(tests.batch, tests.pressure.shape)[:, 0]
    names = np.unique(batch)
    found = [_sums(read, [batch == one for one in names] if len(names) > 1 else [])]
    warmth = np.broadcast_to(tests.room_temperature, len(batch))
    known = np.isfinite(warmth)
    if known.any() and np.ptp(warmth[known]) != 0.0:
        above = np.where(known, warmth - np.mean(warmth[known]), 0.0)
        found.append(read @ (above / np.std(above))[:, None])
    return np.hstack(found)


def _sums(read: Floats, groups: Iterable[NDArray[np.bool_]]) -> Floats:
    """Return the sums over groups of several specimens, (n, number of these)."""
    columns = [read[:, group].sum(axis=1) for group in groups if np.sum(group) > 1]
    return np.array(columns).reshape(len(columns), len(read)).T
