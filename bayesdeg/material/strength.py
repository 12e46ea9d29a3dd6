"""Rupture: the elongation limit against D_R, its scatter between specimens, and the size effect.

Elongation means λ − 1.  The scatter s is the standard deviation of the log elongation.  Both laws
have the same median, so they can be compared at equal parameters.

Break tests are uniaxial, walls are stretched along two axes, and no criterion is established for
this material: those here coincide in uniaxial tension and differ elsewhere, the principal stretch
being the mildest.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt
import scipy
from numpy.typing import NDArray

from bayesdeg.material.degradation import Nodes, polynomial
from bayesdeg.material.hyperelastic import FloatArray, Yeoh

type ScatterLaw = Literal["lognormal", "weibull"]

SCATTER_LAWS: tuple[ScatterLaw, ...] = ("lognormal", "weibull")
GUMBEL = math.pi / math.sqrt(6.0)
"""Standard deviation of ln E, E exponential: Weibull's modulus times the scatter."""
_LN_2 = math.log(2.0)
_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


def limit_stretch(
    log_elongation_at_nodes: npt.ArrayLike, degradation: npt.ArrayLike, nodes: Nodes
) -> FloatArray:
    r"""Return the median stretch at which a specimen breaks in uniaxial tension.

    .. math:: \lambda_b(D_R) = 1 + \exp \sum_i w_i(D_R) \ln \varepsilon_i

    with ln ε the logarithm of the median elongation at the nodes. Above 1 always; shapes and errors
    are those of `polynomial`.

    Examples
    --------
    >>> limit_stretch(np.log([2.1, 0.525]), [0.0, 12.5, 25.0], (0.0, 25.0)).round(3)
    array([3.1  , 2.05 , 1.525])
    """
    return 1.0 + np.exp(polynomial(log_elongation_at_nodes, degradation, nodes))


def weibull_modulus(limit_scatter: npt.ArrayLike) -> FloatArray:
    r"""Return Weibull's modulus with the given standard deviation of the log elongation.

    .. math:: m = \frac{\pi}{\sqrt 6 \, s}

    Examples
    --------
    >>> round(float(weibull_modulus(0.1)), 2)
    12.83
    """
    return GUMBEL / np.asarray(limit_scatter, dtype=np.float64)


def log_survival(
    stretch: npt.ArrayLike,
    limit_median: npt.ArrayLike,
    limit_scatter: npt.ArrayLike,
    law: ScatterLaw = "lognormal",
) -> FloatArray:
    r"""Return the log probability that a specimen survives a stretch.

    With the elongation relative to its median, :math:`r = (\lambda - 1) / (\lambda_b - 1)`:

    .. math:: S = \Phi\!\left(-\frac{\ln r}{s}\right), \quad
        S = \exp(-r^m \ln 2), \; m = \frac{\pi}{\sqrt 6 \, s}

    for the log-normal and Weibull laws.

    Parameters
    ----------
    stretch : array_like
        Uniaxial stretch, or its equivalent by a criterion [–].
    limit_median : array_like
        Median stretch at break λ_b [–], above 1.
    limit_scatter : array_like
        Relative scatter s of the elongation at break [–], above 0.
    law : str
        ``lognormal`` or ``weibull``.

    Returns
    -------
    ndarray
        In the shape of the arguments, broadcast.

    Raises
    ------
    ValueError
        If the law is unknown, a median is not above 1 or a scatter not above 0.

    References
    ----------
    Weibull (1951), J. Appl. Mech. 18, 293; doi:10.1115/1.4010337.

    Examples
    --------
    >>> round(float(np.exp(log_survival(3.1, 3.1, 0.05, "weibull"))), 3)
    0.5
    """
    if law not in SCATTER_LAWS:
        raise ValueError(f"unknown scatter law {law!r}; one of {', '.join(SCATTER_LAWS)}")
    elongation = np.asarray(limit_median, dtype=np.float64) - 1.0
    scatter = np.asarray(limit_scatter, dtype=np.float64)
    if np.any(elongation <= 0.0) or np.any(scatter <= 0.0):
        raise ValueError("the limit stretch must be above 1 and its scatter above 0")
    ratio = (np.asarray(stretch, dtype=np.float64) - 1.0) / elongation
    with np.errstate(divide="ignore"):
        return log_whole(np.log(np.maximum(ratio, 0.0)) / scatter, law)


def log_whole(score: npt.ArrayLike, law: ScatterLaw = "lognormal") -> FloatArray:
    r"""Return the log probability that a specimen survives a score.

    .. math:: \ln S = \ln \Phi(-z), \quad \ln S = -\ln 2 \, e^{\pi z / \sqrt 6}

    for the log-normal and for Weibull's law; both have their median at z = 0 and
    standard deviation 1 of the score at break.

    Parameters
    ----------
    score : array_like
        z, ln strain over the median at break, in standard deviations of the logarithm.
    law : str
        One of `SCATTER_LAWS`.

    Examples
    --------
    >>> np.exp(log_whole([0.0, 1.0], "weibull")).round(3)
    array([0.5  , 0.082])
    """
    z = np.asarray(score, dtype=np.float64)
    if law != "weibull":
        return np.asarray(scipy.special.log_ndtr(-z))
    with np.errstate(over="ignore", under="ignore"):
        return np.asarray(-_LN_2 * np.exp(GUMBEL * z))


def log_broken(score: npt.ArrayLike, law: ScatterLaw = "lognormal") -> FloatArray:
    """Return the log probability that a specimen has broken at a score, see `log_whole`.

    Examples
    --------
    >>> float(np.exp(log_broken(0.0, "weibull")).round(12))
    0.5
    """
    if law != "weibull":
        return np.asarray(scipy.special.log_ndtr(np.asarray(score, dtype=np.float64)))
    return _log_complement(log_whole(score, law))


def log_broken_between(
    low: npt.ArrayLike, high: npt.ArrayLike, law: ScatterLaw = "lognormal"
) -> FloatArray:
    """Return the log probability of breaking between scores low < high, which may be infinite.

    Examples
    --------
    >>> round(float(log_broken_between(-np.inf, 0.0)), 4)  # ln ½
    -0.6931
    """
    low, high = (np.asarray(score, dtype=np.float64) for score in (low, high))
    if law == "weibull":
        before = log_whole(low, law)
        with np.errstate(invalid="ignore"):  # infinite on both sides: probability 0
            change = np.where(np.isinf(before), -np.inf, log_whole(high, law) - before)
        return before + _log_complement(change)
    # use the left tail, where the difference of two logarithms is exact
    swap = low > 0.0
    low, high = np.where(swap, -high, low), np.where(swap, -low, high)
    upper = scipy.special.log_ndtr(high)
    with np.errstate(divide="ignore"):
        return np.asarray(upper + np.log1p(-np.exp(scipy.special.log_ndtr(low) - upper)))


def score_density(score: npt.ArrayLike, law: ScatterLaw = "lognormal") -> FloatArray:
    """Return the log density of scores at break, see `log_whole`.

    Examples
    --------
    >>> round(float(score_density(0.0, "weibull")), 4)
    -0.8108
    """
    z = np.asarray(score, dtype=np.float64)
    if law != "weibull":
        return -0.5 * np.square(z) - _LOG_ROOT_TWO_PI
    return math.log(GUMBEL * _LN_2) + GUMBEL * z + log_whole(z, law)


def scores_from_normal(normal: npt.ArrayLike, law: ScatterLaw = "lognormal") -> FloatArray:
    """Map standard normal scores to scores at break of the same quantile.

    Examples
    --------
    >>> scores_from_normal([0.0, -2.0], "weibull").round(3) + 0.0
    array([ 0.   , -2.655])
    """
    z = np.asarray(normal, dtype=np.float64)
    if law != "weibull":
        return z
    return np.asarray(np.log(-scipy.special.log_ndtr(-z) / _LN_2) / GUMBEL)


def draw_scores(
    shape: tuple[int, ...], generator: np.random.Generator, law: ScatterLaw = "lognormal"
) -> FloatArray:
    """Draw scores at break.

    Examples
    --------
    >>> scores = draw_scores((20000,), np.random.default_rng(1), "weibull")
    >>> round(float(np.std(scores)), 1), round(abs(float(np.median(scores))), 1)
    (1.0, 0.0)
    """
    return scores_from_normal(generator.standard_normal(shape), law)


def _log_complement(logarithm: FloatArray) -> FloatArray:
    """Return ln(1 − e^x) for x ≤ 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(-np.expm1(logarithm)))


def rupture_probability(
    demand_stretch: npt.ArrayLike,
    limit_median: npt.ArrayLike,
    limit_scatter: npt.ArrayLike,
    law: ScatterLaw = "lognormal",
) -> FloatArray:
    """Return the probability that the limit stretch lies below the stretch demanded.

    Arguments and errors as `log_survival`.

    Examples
    --------
    >>> round(float(rupture_probability(1.52, 1.52, 0.1)), 3)
    0.5
    """
    return -np.expm1(log_survival(demand_stretch, limit_median, limit_scatter, law))


@dataclass(frozen=True)
class Strength:
    r"""Elongation limit of actuators: ordinary defects, and flaws besides.

    Without flaws a wall survives a strain ε with the probability that `log_whole` gives for the
    score z = ln(ε/ε̃)/s. Flaws are separate weak places. Their number grows with the share ρ, and a
    wall holds if neither a flaw nor an ordinary defect tears:

    .. math::
        \ln S = \ln S_0(z) + \rho \min_{\varepsilon' \le \varepsilon}
        (\ln S_0(z_f') - \ln S_0(z')), \qquad
        z_f = \frac{\ln(\varepsilon/\tilde\varepsilon) + b}{\sqrt{s^2 + w^2}}

    so at ρ = 1 the limit is ε̃ exp(−b) where flaws are weaker, and at small ρ few walls break early
    and the rest as if there were no flaws. What has torn stays torn: beyond the strain at which
    ordinary defects become the greater hazard, flaws neither add nor return probability.

    Parameters
    ----------
    median : array, shape (walkers, n_specimens)
        Median elongation at break ε̃ as a strain, λ − 1 [–].
    scatter : array, shape (walkers, n_specimens)
        s, standard deviation of its logarithm [–].
    law : str
        Scatter law of the elongation between specimens.
    flaw_share, flaw_cut, flaw_widening : array, broadcast to the others
        ρ, b and w [–], not negative; ρ exceeds 1 beyond the reference rate.

    References
    ----------
    Weibull (1951), J. Appl. Mech. 18, 293, doi:10.1115/1.4010337; competing failure modes:
    Johnson (1964), The Statistical Treatment of Fatigue Experiments.
    """

    median: FloatArray
    scatter: FloatArray
    law: ScatterLaw = "lognormal"
    flaw_share: FloatArray = field(default_factory=lambda: np.zeros(()))
    flaw_cut: FloatArray = field(default_factory=lambda: np.zeros(()))
    flaw_widening: FloatArray = field(default_factory=lambda: np.zeros(()))

    def weakened(self, cut: FloatArray, widening: FloatArray) -> "Strength":
        """Return it with the median lowered by ``cut`` in logarithms and widened by ``widening``.

        Examples
        --------
        >>> films = Strength(np.array([2.0]), np.array([0.3]))
        >>> weak = films.weakened(np.log([4.0]), np.array([0.4]))
        >>> weak.median, weak.scatter
        (array([0.5]), array([0.5]))
        """
        return replace(
            self, median=self.median * np.exp(-cut), scatter=np.hypot(self.scatter, widening)
        )

    def flawed(self, share: FloatArray, cut: FloatArray, widening: FloatArray) -> "Strength":
        """Return it with flaws; zero cut and widening mean none.

        Examples
        --------
        >>> films = Strength(np.array([2.0]), np.array([0.1]))
        >>> some = films.flawed(np.array([0.1]), np.log([4.0]), np.array([0.1]))
        >>> np.exp(some.log_whole(np.log([0.4, 0.5, 0.8]))).round(3)
        array([0.994, 0.933, 0.462])
        """
        some = (cut > 0.0) | (widening > 0.0)
        arrays = (self.median, self.scatter, np.where(some, share, 0.0), cut, widening)
        median, scatter, share, cut, widening = np.broadcast_arrays(*arrays)
        return Strength(median, scatter, self.law, share, cut, widening)

    @property
    def has_flaws(self) -> bool:
        """Whether any specimen may have flaws."""
        return bool(np.any(self.flaw_share > 0.0))

    def mapped(self, change: Callable[[FloatArray], FloatArray]) -> "Strength":
        """Return it with one change applied to all arrays, such as an added axis."""
        shape = np.shape(self.median)
        flaws = (self.flaw_share, self.flaw_cut, self.flaw_widening)
        arrays = (np.broadcast_to(array, shape) for array in (self.median, self.scatter, *flaws))
        median, scatter, share, cut, widening = map(change, arrays)
        return Strength(median, scatter, self.law, share, cut, widening)

    def log_whole(self, log_strain: FloatArray, error: npt.ArrayLike = 0.0) -> FloatArray:
        """Return the log probability that a specimen survives a strain.

        Parameters
        ----------
        log_strain : array, broadcasts with the others
            ln ε [–], which may be infinite.
        error : array_like
            Standard error of ln ε [–], added to the scatter.
        """
        plain = log_whole(self._score(log_strain, error), self.law)
        if not self.has_flaws:
            return plain
        return plain + self._lost_to_flaws(log_strain, error)

    def log_broken(self, log_strain: FloatArray, error: npt.ArrayLike = 0.0) -> FloatArray:
        """Return the log probability that a specimen has broken at a strain, see `log_whole`."""
        score = self._score(log_strain, error)
        plain = log_broken(score, self.law)
        if not self.has_flaws:
            return plain
        lost = self._lost_to_flaws(log_strain, error)
        return np.logaddexp(plain, log_whole(score, self.law) + _log_complement(lost))

    def log_broken_between(
        self, low: tuple[FloatArray, FloatArray], high: tuple[FloatArray, FloatArray]
    ) -> FloatArray:
        """Return the log probability of breaking between two strains, each ln ε with its error.

        −∞ where surviving the first implies surviving the second.
        """
        begun, ended = self._score(*low), self._score(*high)
        begun = np.minimum(begun, ended)
        with np.errstate(invalid="ignore"):  # both may be infinite
            found = log_broken_between(begun, ended, self.law)
        plain = np.where(ended > begun, found, -math.inf)
        if not self.has_flaws:
            return plain
        before, after = log_whole(begun, self.law), log_whole(ended, self.law)
        lost, later = self._lost_to_flaws(*low), self._lost_to_flaws(*high)
        torn = after + lost + _log_complement(np.minimum(later - lost, 0.0))
        with np.errstate(invalid="ignore"):  # nothing survives either
            change = np.minimum(after + later - before - lost, 0.0)
        # the lower strain may have the larger error
        apart = before + lost + _log_complement(change)
        found = np.where(later > lost, apart, np.logaddexp(lost + plain, torn))
        return np.where(ended > begun, found, -math.inf)

    def limit(self, score: FloatArray) -> FloatArray:
        """Return the strain ε at which specimens of given scores break [–].

        Parameters
        ----------
        score : array, broadcasts with the others
            Of the law without flaws: 0 is the median; draw them with `draw_scores`.

        Examples
        --------
        >>> films = Strength(np.array([2.0]), np.array([0.1]))
        >>> torn = films.flawed(np.ones(1), np.log([4.0]), np.zeros(1))
        >>> films.limit(np.zeros(1)).round(9), torn.limit(np.zeros(1)).round(9)
        (array([2.]), array([0.5]))
        """
        plain = np.log(self.median) + self.scatter * score
        if not self.has_flaws:
            return np.asarray(np.exp(plain))
        wanted, until = log_whole(score, self.law), self._flaws_until(0.0)

        def holds(log_strain: FloatArray) -> NDArray[np.bool_]:
            lost = self._lost(np.minimum(log_strain, until), 0.0)
            return log_whole(self._score(log_strain, 0.0), self.law) + lost > wanted

        return np.asarray(np.exp(_last_held(holds, plain - _WIDEST, plain)))

    def _score(self, log_strain: FloatArray, error: npt.ArrayLike) -> FloatArray:
        spread = np.hypot(self.scatter, error)
        return np.asarray((log_strain - np.log(self.median)) / spread)

    def _flaw_score(self, log_strain: FloatArray, error: npt.ArrayLike) -> FloatArray:
        spread = np.hypot(np.hypot(self.scatter, self.flaw_widening), error)
        return np.asarray((log_strain - np.log(self.median) + self.flaw_cut) / spread)

    def _lost_to_flaws(self, log_strain: FloatArray, error: npt.ArrayLike) -> FloatArray:
        """Return ln S with flaws minus that without."""
        held = np.minimum(log_strain, np.log(self.median) + _WIDEST)
        # nothing survives an infinite strain, and past the crossover no search is needed
        past = self._is_past_flaws(held, error) & np.isfinite(log_strain)
        if past.any():
            held = np.where(past, self._flaws_until(error), held)
        return self._lost(held, error)

    def _lost(self, held: FloatArray, error: npt.ArrayLike) -> FloatArray:
        """Return the loss of ln S to flaws up to a strain at which they still dominate."""
        with np.errstate(invalid="ignore"):  # broken by either: nothing is left to lose
            alone = log_whole(self._flaw_score(held, error), self.law)
            less = np.minimum(alone - log_whole(self._score(held, error), self.law), 0.0)
        return self.flaw_share * np.nan_to_num(less, nan=0.0, neginf=_NEVER)

    def _flaws_until(self, error: npt.ArrayLike) -> FloatArray:
        """Return the ln strain beyond which ordinary defects are the greater hazard.

        There the hazards of both, −d ln S/d ln ε, are equal: found by bisection, or in closed form
        for Weibull's law, h = m ln 2 (ε/ε̃)^m. Infinite where flaws are always the greater hazard.
        """
        own = np.hypot(self.scatter, error)
        wide = np.hypot(own, self.flaw_widening)
        middle = np.log(self.median)
        if self.law == "weibull":
            m, of_flaws = GUMBEL / own, GUMBEL / wide
            with np.errstate(divide="ignore", invalid="ignore"):
                beyond = (of_flaws * self.flaw_cut - np.log(m / of_flaws)) / (m - of_flaws)
            return np.where(m > of_flaws, middle + beyond, math.inf)
        low, high = middle - self.flaw_cut - _WIDEST, middle + _WIDEST
        ever = self._is_past_flaws(high, error)
        last = _last_held(lambda at: ~self._is_past_flaws(at, error), low, high)
        return np.where(ever, last, math.inf)

    def _is_past_flaws(self, log_strain: FloatArray, error: npt.ArrayLike) -> NDArray[np.bool_]:
        own = np.hypot(self.scatter, error)
        wide = np.hypot(own, self.flaw_widening)
        of_flaws = _log_hazard(self._flaw_score(log_strain, error), self.law) - np.log(wide)
        of_others = _log_hazard(self._score(log_strain, error), self.law) - np.log(own)
        return np.asarray(of_flaws < of_others)


def _last_held(
    holds: Callable[[FloatArray], NDArray[np.bool_]], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return by bisection where a condition that holds at ``low`` ceases to hold."""
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        held = holds(middle)
        low, high = np.where(held, middle, low), np.where(held, high, middle)
    return 0.5 * (low + high)


def _log_hazard(score: FloatArray, law: ScatterLaw) -> FloatArray:
    """Return ln of −d ln S/dz, up to a common constant."""
    if law == "weibull":
        return GUMBEL * score
    with np.errstate(invalid="ignore"):  # at an infinite score, whose value is not used
        return score_density(score, law) - log_whole(score, law)


_NEVER = -1e300
"""Log probability of an impossible event; finite, so that times a share of 0 it is still 0."""
_WIDEST, _HALVINGS = 12.0, 45
"""Range of ln strain about the limits searched for the break, and the number of bisections: to
3e-13."""


type Criterion = Literal["principal_stretch", "cauchy_stress", "equivalent_strain", "strain_energy"]

CRITERIA: tuple[Criterion, ...] = ("principal_stretch", "cauchy_stress", "equivalent_strain")


def wall_state(stretch: npt.ArrayLike, biaxiality: npt.ArrayLike) -> FloatArray:
    r"""Return the principal stretches of an incompressible wall.

    .. math:: (\lambda, \lambda^b, \lambda^{-1-b})

    From the largest principal stretch λ and b: −1/2 of uniaxial, 0 of planar, 1 of equibiaxial
    tension [–]; the three are on a new last axis.

    Examples
    --------
    >>> wall_state(2.0, 1.0)
    array([2.  , 2.  , 0.25])
    """
    largest, b = np.broadcast_arrays(
        np.asarray(stretch, dtype=np.float64), np.asarray(biaxiality, dtype=np.float64)
    )
    return np.stack([largest, largest**b, largest ** (-1.0 - b)], axis=-1)


def energy_equivalent_stretch(stretches: npt.ArrayLike) -> FloatArray:
    r"""Return the uniaxial stretch of the same strain energy for any law in I₁ alone.

    Such an energy rises with I₁, so the law does not matter: λ is the root above 1 of

    .. math:: \lambda^2 + 2/\lambda = I_1

    by the trigonometric formula for three real roots of :math:`\lambda^3 - I_1 \lambda + 2`.

    ``stretches`` (..., 3) are principal stretches [–] whose product is 1.

    Examples
    --------
    >>> energy_equivalent_stretch([2.0, 2.0**-0.5, 2.0**-0.5]).round(12)
    np.float64(2.0)
    """
    first = np.square(np.asarray(stretches, dtype=np.float64)).sum(axis=-1)
    third = np.maximum(first, 3.0) / 3.0
    angle = np.arccos(np.clip(-(third**-1.5), -1.0, 1.0))
    return np.asarray(2.0 * np.sqrt(third) * np.cos(angle / 3.0))


def hencky_equivalent_strain(stretches: npt.ArrayLike) -> FloatArray:
    r"""Return the von Mises equivalent logarithmic strain.

    .. math:: \varepsilon_{eq} = \sqrt{\tfrac23 \sum_i (\ln \lambda_i)^2}

    It is ln λ in uniaxial tension [–]; ``stretches`` (..., 3) have a product of 1.

    Examples
    --------
    >>> round(float(hencky_equivalent_strain([2.0, 2.0, 0.25]) / np.log(2.0)), 12)
    2.0
    """
    strains = np.log(np.asarray(stretches, dtype=np.float64))
    return np.asarray(np.sqrt(2.0 / 3.0 * np.square(strains).sum(axis=-1)))


def largest_cauchy_stress(law: Yeoh, stretches: npt.ArrayLike) -> FloatArray:
    r"""Return the largest principal Cauchy stress [MPa] of a wall whose thinnest axis is free.

    .. math:: \sigma_1 = 2 \frac{dW}{dI_1} (\lambda_{max}^2 - \lambda_{min}^2)

    Gas pressure on the inner face is neglected, being small relative to the wall's stress.

    Parameters
    ----------
    law : Yeoh
        Constants [MPa], which broadcast against the states.
    stretches : array_like, shape (..., 3)
        Principal stretches [–] whose product is 1.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> float(largest_cauchy_stress(Yeoh(0.25, 0.0, 0.0), [2.0, 1.0, 0.5]))
    1.875
    """
    squares = np.square(np.asarray(stretches, dtype=np.float64))
    c1, c2, c3 = (np.asarray(c, dtype=np.float64) for c in (law.c1, law.c2, law.c3))
    x = squares.sum(axis=-1) - 3.0
    first = c1 + x * (2.0 * c2 + 3.0 * c3 * x)
    return np.asarray(2.0 * first * (squares.max(axis=-1) - squares.min(axis=-1)))


def equivalent_uniaxial_stretch(
    stretches: npt.ArrayLike, criterion: Criterion = "principal_stretch", law: Yeoh | None = None
) -> FloatArray:
    """Return the stretch in uniaxial tension that the criterion considers equivalent.

    Parameters
    ----------
    stretches : array_like, shape (..., 3)
        Principal stretches [–] whose product is 1.
    criterion : str
        ``principal_stretch``, ``cauchy_stress`` (`largest_cauchy_stress`), ``equivalent_strain``
        (`hencky_equivalent_strain`) or ``strain_energy`` (`energy_equivalent_stretch`).
    law : Yeoh, optional
        Needed for ``cauchy_stress`` only; nominal stress must rise with uniaxial stretch.

    Returns
    -------
    ndarray, shape (...)
        nan where no uniaxial stretch has that stress.

    Raises
    ------
    ValueError
        If the criterion is unknown, or is ``cauchy_stress`` without a law.

    Examples
    --------
    >>> float(equivalent_uniaxial_stretch([1.5, 1.5, 1 / 2.25], "equivalent_strain").round(12))
    2.25
    """
    if criterion == "principal_stretch":
        return np.asarray(stretches, dtype=np.float64).max(axis=-1)
    if criterion == "equivalent_strain":
        return np.exp(hencky_equivalent_strain(stretches))
    if criterion == "strain_energy":
        return energy_equivalent_stretch(stretches)
    if criterion != "cauchy_stress":
        known = (*CRITERIA, "strain_energy")
        raise ValueError(f"unknown criterion {criterion!r}; use one of {', '.join(known)}")
    if law is None:
        raise ValueError("the criterion 'cauchy_stress' needs the material law")
    return uniaxial_stretch(law, largest_cauchy_stress(law, stretches))


STEPS, LARGEST_STEP, CLOSE = 60, 0.3, 1e-9
"""Of Newton's method, in ln stretch: maximum number of steps, largest step, and step size at
convergence; five or six steps suffice from a nearby start."""
_NUDGE = 1e-6  # relative stretch increment for the stress derivative


def uniaxial_stretch(law: Yeoh, stress: npt.ArrayLike, *, start: npt.ArrayLike = 1.5) -> FloatArray:
    """Return the uniaxial stretch for a Cauchy stress, by Newton's method in its logarithm.

    Parameters
    ----------
    law : Yeoh
        Constants [MPa]; nominal stress must rise with stretch.
    stress : array_like
        [MPa], not negative.
    start : array_like
        Initial guess [–].

    Returns
    -------
    ndarray
        nan where no stretch is found.

    Examples
    --------
    >>> float(uniaxial_stretch(Yeoh(0.25, 0.0, 0.0), 1.75).round(9))
    2.0
    """
    wanted, found = np.broadcast_arrays(np.asarray(stress, dtype=np.float64), start)
    found, step = np.maximum(found, 1.0), np.array(np.inf)
    for _ in range(STEPS):
        value = _uniaxial_stress(law, found)
        slope = (_uniaxial_stress(law, found * (1.0 + _NUDGE)) - value) / _NUDGE
        with np.errstate(invalid="ignore", divide="ignore"):
            step = np.clip((wanted - value) / slope, -LARGEST_STEP, LARGEST_STEP)
        found = np.maximum(found * np.exp(np.nan_to_num(step)), 1.0)
        if np.all(np.abs(np.nan_to_num(step)) < CLOSE):
            break
    return np.where(np.isfinite(step) & (np.abs(step) < _SETTLED), found, np.nan)


_SETTLED = 1e-6  # a larger last step has not converged


def _uniaxial_stress(law: Yeoh, stretch: FloatArray) -> FloatArray:
    return largest_cauchy_stress(law, wall_state(stretch, -0.5))
