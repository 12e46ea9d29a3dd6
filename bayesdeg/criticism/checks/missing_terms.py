r"""Search for the few terms in known quantities that would remove a misfit.

On the whitened scale of a linearised model, its parameters integrated out, data without a misfit
are z ~ N(0, I). A term of direction w [`known_terms`] gains the log-likelihood (wᵀz)²/(2|w|²), and
as there are many, those of each complexity share a prior alike (Scott and Berger 2010):

.. math:: s = \max_j \left( \frac{(w_j^T z)^2}{2 |w_j|^2} - \ln m_j \right),

m_j the number of terms as complex as j. The best is taken, then the best for the remainder, with
all directions made orthogonal to it (orthogonal matching pursuit; Pati et al. 1993), two at most.

Significance: the same maximum over the whole dictionary is computed for data simulated from the
fitted model, at each step with the same terms taken out. The share of simulated sets with as large
a maximum is the p-value of the step, adjusted for all terms that were tried (Westfall and Young
1993), and the search ends at the first above 5 %: so at most 5 % of studies without a misfit yield
a term. This accounts for the dependence between terms, which are similar by construction; knockoffs
(Barber and Candès 2015) would need more readings than twice the terms, or the law of the terms,
which here are fixed by the design.

The result is then validated: the whole search is repeated without some specimens, which are
predicted with as many terms as it found, and one more term is given only if it raises their log
predictive density by more than a standard error.

References
----------
Pati, Rezaiifar and Krishnaprasad (1993), doi:10.1109/ACSSC.1993.342465; Westfall and Young (1993),
Resampling-Based Multiple Testing; Romano and Wolf (2005), doi:10.1198/016214504000000539, for the
adjustment by the largest; G'Sell et al. (2016), doi:10.1111/rssb.12122, for stopping at the first;
Scott and Berger (2010), doi:10.1214/10-AOS792; Barber and Candès (2015), doi:10.1214/15-AOS1337.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from bayesdeg.criticism.chance import chance_of
from bayesdeg.criticism.checks.discrepancy import Misfit, discrepancies, largest_ratio
from bayesdeg.criticism.checks.known_terms import LEAST_LEFT, KnownTerm, KnownTerms, known_terms
from bayesdeg.criticism.fit.linear import Linear
from bayesdeg.criticism.holdout.held_out import standard_error

Floats = NDArray[np.float64]

FALSE_TERMS = 0.05
"""Share of data without a misfit in which a term may be given."""
MOST_TERMS = 2
"""Maximum number of terms; a longer description is hard to read."""
AS_GOOD = float(np.log(20.0))
"""Odds up to which a different term is as good, as for causes that cannot be told apart."""
BARELY = 1.0
"""Lead of the best over a simpler term below which the simpler one is taken [nats], "not worth more
than a bare mention" (Kass and Raftery 1995, doi:10.1080/01621459.1995.10476572)."""
MOST_ALIKE = 5  # most equivalent terms listed
FOLDS = 9
"""Most groups of specimens held out in turn: each fold searches the dictionary."""
QUANTILE = 1.645  # half-width of a 90 % interval of the normal law, in sd


@dataclass(frozen=True)
class AlikeTerm:
    """A term that fits as well as the one that was taken.

    `behind` is what it gains less than the best, the complexities weighed [nats], below ln 20; the
    size is in the unit of the term.
    """

    term: KnownTerm
    size: float
    behind: float


@dataclass(frozen=True)
class MissingTerm:
    """A term that removes part of a misfit.

    Parameters
    ----------
    term : KnownTerm
        Which.
    size, low, high : float
        Posterior mean and ends of the 90 % interval, beside the other terms, in the term's unit.
    gain : float
        In log-likelihood when it was taken [nats].
    p_value : float
        Share of simulated data in which the best of all terms gains as much, (1 + #)/(1 + n).
    share : float
        Of the misfit statistic that is removed with it and those before it.
    held_out, held_out_se : float or None
        Gain in log predictive density of held-out specimens by it, and its standard error; None
        where there are no specimens to hold out [nats].
    alike : tuple of AlikeTerm
        Those that fit as well, the best first.
    count_alike : int
        How many there are, with those that are not told.
    change : array, shape (n,)
        What it does to the readings at its size, in their units.
    largest : float
        The largest change of a reading, over the largest reading of its kind [–].
    """

    term: KnownTerm
    size: float
    low: float
    high: float
    gain: float
    p_value: float
    share: float
    held_out: float | None
    held_out_se: float | None
    alike: tuple[AlikeTerm, ...]
    count_alike: int
    change: Floats
    largest: float


@dataclass(frozen=True)
class MissingTerms:
    """The terms that would remove a misfit: none, one or two.

    Parameters
    ----------
    terms : tuple of MissingTerm
        In the order in which they were taken.
    tried : int
        Terms in the dictionary.
    replicates : int
        Simulated data sets.
    p_value : float
        Of the best of all terms, whether or not it is given.
    best : MissingTerm, optional
        That term, also where held-out specimens do not confirm it or chance gives as much.
    """

    terms: tuple[MissingTerm, ...]
    tried: int
    replicates: int
    p_value: float
    best: MissingTerm | None = None

    @property
    def is_chance(self) -> bool:
        """Whether the best of all terms gains no more than chance."""
        return self.p_value > FALSE_TERMS

    @property
    def share(self) -> float:
        """Share of the misfit statistic that all terms remove together; 0 without any."""
        return self.terms[-1].share if self.terms else 0.0


def missing_terms(
    linear: Linear,
    simulated: Floats,
    misfit: Misfit,
    *,
    batches: Mapping[str, str] | None = None,
    families: Collection[str] | None = None,
) -> MissingTerms:
    """Return the few terms that would remove the misfit of a linearised model.

    Data sets (k, n_readings) are simulated from its posterior, without a misfit; batches are by
    specimen, as far as known; terms of all families of readings, or of some.
    """
    offered = known_terms(linear, batches, families)
    null = linear.whiten(simulated) if len(simulated) else np.zeros((0, len(linear.mean)))
    if not len(offered) or not len(null):
        return MissingTerms((), len(offered), len(null), float("nan"))
    picks = search_terms(offered, linear.observed, null)
    p_value = picks[0].p_value if picks else 1.0
    given = len([one for one in picks if one.p_value <= FALSE_TERMS])
    held = _held_out(linear, offered, given)
    if held is not None:  # terms that held-out specimens confirm
        gains = (_gain_of(held, count) for count in range(given))
        unconfirmed = (count for count, (gain, error) in enumerate(gains) if not gain > error)
        given = next(unconfirmed, given)
    terms = _described(linear, offered, picks[:given], held, misfit)
    best = terms[:1] or _described(linear, offered, picks[:1], held, misfit)
    return MissingTerms(terms, len(offered), len(null), p_value, next(iter(best), None))


@dataclass(frozen=True)
class Pick:
    """One step of the search.

    `gains` (m,) are those of every term [nats], −inf of those made of the terms before; the p-value
    is that of the best, adjusted for all, nan without simulated data.
    """

    index: int
    gains: Floats
    p_value: float


def search_terms(
    offered: KnownTerms, observed: Floats, null: Floats, *, most: int = MOST_TERMS
) -> tuple[Pick, ...]:
    """Return the best term, then the best in addition, while they exceed chance.

    `observed` (n,) are the whitened data, `null` (k, n) such data without a misfit; without any,
    nothing is tested and all steps are made. The last pick is the first that is explained by
    chance.
    """
    found: list[Pick] = []
    directions = offered.whitened
    whole = np.sum(directions**2, axis=0)
    for _ in range(most):
        square = np.sum(directions**2, axis=0)
        open_ones = square > LEAST_LEFT * whole
        if not open_ones.any():
            break
        scale = np.where(open_ones, np.sqrt(np.maximum(square, 1e-300)), np.inf)
        less = np.where(open_ones, offered.penalty, np.inf)
        unit = directions / scale
        gains = 0.5 * (observed @ unit) ** 2 - less
        close = np.flatnonzero(gains > np.max(gains) - BARELY)
        best = int(min(close, key=lambda i: (*offered.terms[i].simplicity, -gains[i])))
        chance = np.max(0.5 * (null @ unit) ** 2 - less, axis=1) if len(null) else np.zeros(0)
        p_value = float(chance_of(float(np.max(gains)), chance)) if len(null) else float("nan")
        found.append(Pick(best, gains, p_value))
        if p_value > FALSE_TERMS:
            break
        along = unit[:, best]
        directions = directions - np.outer(along, along @ directions)
    return tuple(found)


def _gain_of(held: Floats, place: int) -> tuple[float, float]:
    """Return the gain of one more term in all folds, and its standard error [nats]."""
    own = held[:, place + 1] - held[:, place]
    return float(np.sum(own)), standard_error(own)


def _described(
    linear: Linear,
    offered: KnownTerms,
    picks: Sequence[Pick],
    held: Floats | None,
    misfit: Misfit,
) -> tuple[MissingTerm, ...]:
    """Return the given terms, with sizes fitted jointly."""
    if not picks:
        return ()
    chosen = [one.index for one in picks]
    whitened = offered.whitened[:, chosen]
    covariance = np.linalg.inv(whitened.T @ whitened)
    sizes, errors = covariance @ (whitened.T @ linear.observed), np.sqrt(np.diag(covariance))
    shares = _shares(linear, whitened, misfit)
    kind, found = linear.subject.places.kind, []
    for place, pick in enumerate(picks):
        term, mean, error = offered.terms[pick.index], float(sizes[place]), float(errors[place])
        gain, gain_error = (None, None) if held is None else _gain_of(held, place)
        behind, alike = pick.gains[pick.index] - pick.gains, []
        for i in np.argsort(behind):
            if behind[i] < AS_GOOD and i != pick.index:
                own = offered.whitened[:, i]
                size = float(own @ linear.observed / (own @ own)) * offered.terms[i].per_unit
                alike.append(AlikeTerm(offered.terms[i], size, float(behind[i])))
        change = mean * offered.directions[:, pick.index]
        relative = (np.max(np.abs(change[kind == k])) / term.scales[k][0] for k in term.kinds)
        found.append(
            MissingTerm(
                term=term,
                size=term.per_unit * mean,
                low=term.per_unit * (mean - QUANTILE * error),
                high=term.per_unit * (mean + QUANTILE * error),
                gain=float(pick.gains[pick.index] + offered.penalty[pick.index]),
                p_value=pick.p_value,
                share=shares[place],
                held_out=gain,
                held_out_se=gain_error,
                alike=tuple(alike[:MOST_ALIKE]),
                count_alike=len(alike),
                change=change,
                largest=float(max(relative)),
            )
        )
    return tuple(found)


def _shares(linear: Linear, whitened: Floats, misfit: Misfit) -> list[float]:
    """Return the share of the misfit statistic beyond chance removed by the first k terms."""
    kernels, data = discrepancies(linear), [linear.observed]
    for count in range(1, whitened.shape[1] + 1):
        basis = np.linalg.qr(whitened[:, :count])[0]
        data.append(linear.observed - basis @ (basis.T @ linear.observed))
    left = largest_ratio(np.array(data), kernels)[0] - misfit.by_chance
    if left[0] <= 0.0:
        return [1.0] * whitened.shape[1]
    return [float(np.clip(1.0 - max(one, 0.0) / left[0], 0.0, 1.0)) for one in left[1:]]


@dataclass(frozen=True)
class _Fold:
    """Held-out readings, the law of the others, and their law given the others."""

    linear: Linear
    held: NDArray[np.bool_]

    @cached_property
    def others(self) -> Floats:
        """Lower Cholesky factor of the covariance of all others."""
        rest = ~self.held
        return np.asarray(cholesky(self.linear.covariance[np.ix_(rest, rest)], lower=True))

    @cached_property
    def cross(self) -> Floats:
        """Covariance of the others, whitened, and the held-out readings."""
        between = self.linear.covariance[np.ix_(~self.held, self.held)]
        return np.asarray(solve_triangular(self.others, between, lower=True))

    def whitened(self, columns: Floats) -> Floats:
        """Return columns (n, k), of all others, on their whitened scale."""
        rest = columns[~self.held]
        return np.asarray(solve_triangular(self.others, rest, lower=True))

    def conditional(self, columns: Floats) -> Floats:
        """Return columns (n, k) of the held-out readings, less their prediction from the others."""
        return np.asarray(columns[self.held] - self.cross.T @ self.whitened(columns))

    @cached_property
    def own(self) -> Floats:
        """Covariance of the held-out readings given the others."""
        covariance = self.linear.covariance[np.ix_(self.held, self.held)]
        return np.asarray(covariance - self.cross.T @ self.cross)


def _held_out(linear: Linear, offered: KnownTerms, most: int) -> Floats | None:
    """Return log densities of held-out readings with 0, 1 … terms found without them, (folds, k).

    None with fewer than two groups to hold out, or nothing to try.
    """
    group = linear.subject.group
    names = [name for name in dict.fromkeys(group.tolist()) if name]
    if len(names) < 2 or most == 0:
        return None
    member = {name: i % min(FOLDS, len(names)) for i, name in enumerate(names)}
    numbers = np.array([member.get(name, -1) for name in group.tolist()])
    residual = (linear.subject.observed - linear.mean)[:, None]
    found = []
    for k in range(min(FOLDS, len(names))):
        fold, densities = _Fold(linear, numbers == k), []
        data, whitened = fold.whitened(residual)[:, 0], fold.whitened(offered.directions)
        inside = replace(offered, whitened=whitened)
        picks = search_terms(inside, data, np.zeros((0, len(data))), most=most)
        for count in range(most + 1):
            chosen = [one.index for one in picks[:count]]
            mean, covariance = fold.conditional(residual)[:, 0], fold.own
            if chosen:
                seen = whitened[:, chosen]
                uncertain = np.linalg.inv(seen.T @ seen)
                acts = fold.conditional(offered.directions[:, chosen])
                mean = mean - acts @ (uncertain @ (seen.T @ data))
                covariance = covariance + acts @ uncertain @ acts.T
            factor = cho_factor(covariance, lower=True)
            logs = 2.0 * np.sum(np.log(np.diag(factor[0])))
            densities.append(float(-0.5 * (mean @ cho_solve(factor, mean) + logs)))
        found.append(densities)
    return np.array(found)
