r"""Comparison of material laws by their predictions of held-out films.

At each degradation rate the films are of one material with its own constants, so no law has to
follow a polynomial in the degradation rate. The reading of film s at stretch λ is

.. math:: y_s(\lambda) = (1 + m_s) f(\lambda; u) + \varepsilon, \qquad
    m_s \sim N(0, \tau^2), \qquad u \sim N(0, I)

with f the law in its coordinates u (`bayesdeg.material.laws`), τ the scatter of stiffness and ε the
reading error of `bayesdeg.observations.noise`, which is partly correlated along the curve. The four
noise parameters are the same for all levels and have the priors of the study; they are fitted for
each law, so a law that misses the curves has larger errors.

f is linearised about its most probable u, which gives the density of all films in closed form, and
of one film given the others; the noise is where the density with its prior is largest.  For a film
that is held out, u and noise are found again with the weight of that film at 0.
"""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.criticism.holdout.held_out import standard_error
from bayesdeg.data.levels import levels as levels_of
from bayesdeg.material.laws import (
    CONSTANTS,
    FORMS,
    LawForm,
    StressBasis,
    film_tests,
    largest_excess,
)
from bayesdeg.observations.noise import path_grams
from bayesdeg.observations.tensile import TensileCurves
from bayesdeg.priors import Distribution

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

NOISE = ("tensile_noise_floor", "tensile_noise", "stiffness_scatter", "tensile_noise_length")
"""Constant [MPa] and proportional [–] reading error, scatter of stiffness [–], and ℓ [–]."""
FEWEST = 2
"""Fewest films of a level for holding one out."""
MOST = 40
"""Most films held out, evenly among those that can be."""
CLEARLY = 2.0
"""Standard errors by which a held-out difference must exceed zero to count."""
RESOLUTION, LEAST = 1e-5, 1e-12  # of the largest stress, and of films without stress [MPa]
LONGEST_STEP = 1.0  # step of a coordinate, in prior standard deviations
SURE_STEP, SHORTENED = 0.1, 6  # first factor on a step, and how often it is shortened
UNDAMPED = 6  # steps of one length before they are halved
STEPS, CLOSE = 40, 1e-4  # tolerance of Gauss–Newton: twice the gain in nats
ROUNDS = 3  # rounds of alternating between coordinates and noise
VARIANCES = 1e-4, 10.0  # bounds of the noise's logarithms in the search
STILL = 0.01  # tolerance of the noise's logarithms
FLAT = 0.005  # nats per unit of a logarithm, at which a search for the noise ends
STEP = 1e-6  # its step for slopes


class NoiseLevels(NamedTuple):
    """Noise of readings; the fields are in the order of `NOISE`."""

    floor: float
    share: float
    scatter: float
    length: float


@dataclass(frozen=True)
class LevelFilms:
    """The films of a study, each with its level.

    `priors` are those of `NOISE`.
    """

    curves: TensileCurves
    priors: Mapping[str, Distribution]

    @cached_property
    def centres(self) -> Floats:
        """Degradation rate of each level [%]."""
        return levels_of(self.curves.degradation)[0]

    @cached_property
    def member(self) -> Numbers:
        """Level of each film, (n_films,)."""
        return levels_of(self.curves.degradation)[1]

    @property
    def count(self) -> int:
        """Number of levels."""
        return len(self.centres)

    @cached_property
    def largest(self) -> Floats:
        """Scale X of each level: the largest I₁ − 3 that was reached [–]."""
        data = self.curves
        each = largest_excess(data.stretch, data.modes, data.mask)
        return np.array([each[self.member == k].max() for k in range(self.count)])

    @cached_property
    def tests(self) -> StressBasis:
        """Data for the stresses."""
        data = self.curves
        return film_tests(data.stretch, data.modes, self.largest[self.member], cauchy=data.cauchy)

    @cached_property
    def scale(self) -> Floats:
        """G₀ of each level, by least squares of a neo-Hookean solid [MPa].

        Includes held-out films, without effect: the prior around it spans a factor of 20.
        """
        base = np.where(self.curves.mask, 0.5 * self.tests.first, 0.0)
        stress = np.where(self.curves.mask, self.curves.stress, 0.0)
        both = np.sum(base * stress, axis=-1), np.sum(base * base, axis=-1)
        top, bottom = (np.bincount(self.member, one, self.count) for one in both)
        return np.maximum(top / bottom, np.finfo(float).tiny)

    @cached_property
    def resolution(self) -> float:
        """Least reading error of any curve, for synthetic films without noise [MPa]."""
        return RESOLUTION * float(np.abs(self.curves.stress[self.curves.mask]).max()) + LEAST

    @property
    def held_out(self) -> Numbers:
        """The held-out films: at most `MOST` of those that share their level."""
        sizes = np.bincount(self.member, minlength=self.count)
        found = np.flatnonzero(sizes[self.member] >= FEWEST)
        kept = np.linspace(0, len(found) - 1, min(len(found), MOST)).round().astype(int)
        chosen: Numbers = found[kept]
        return chosen


class LawPoint(NamedTuple):
    """A law at coordinates: stresses [MPa] and their slopes.

    u (n_levels, size), f (n_films, n_points) and J (n_films, n_points, size).
    """

    u: Floats
    stress: Floats
    slope: Floats


class Products(NamedTuple):
    """Information of films on the coordinates at one noise, by film, with τ integrated out.

    Parameters
    ----------
    matrix : array, shape (n_films, size, size)
        J' S⁻¹ J with S the covariance of a film's readings.
    vector : array, shape (n_films, size)
        J' S⁻¹ e, e what is read less f.
    square : array, shape (n_films,)
        e' S⁻¹ e.
    log_det : array, shape (n_films,)
        ln det(2π S).
    """

    matrix: Floats
    vector: Floats
    square: Floats
    log_det: Floats


class FitStart(NamedTuple):
    """Start of a calibration.

    Coordinates (n_levels, size), noise z (4,), unconstrained, and the inverse of the Hessian of the
    noise's log density, with its sign changed, (4, 4).
    """

    u: Floats
    z: Floats
    inverse: Floats


class Calibrated(NamedTuple):
    """A law calibrated to weighted films: its coordinates, their precision and the noise."""

    point: LawPoint
    precision: Floats
    noise: NoiseLevels
    end: FitStart


def _at(form: LawForm, films: LevelFilms, u: Floats) -> LawPoint:
    stress, slope = form.response(u[films.member], films.tests)
    scale = films.scale[films.member][:, None]
    return LawPoint(u, scale * stress, scale[..., None] * slope)


def _products(
    films: LevelFilms, point: LawPoint, noise: NoiseLevels, expected: Floats | None = None
) -> Products:
    """Return the information of films at a point, with errors for the expected stresses."""
    data, size = films.curves, point.slope.shape[-1]
    expected = point.stress if expected is None else expected
    columns = np.concatenate(
        [(data.stress - point.stress)[..., None], point.slope, expected[..., None]], axis=-1
    )
    columns[~data.mask] = 0.0
    variance = films.resolution**2 + noise.floor**2 + np.square(noise.share * expected)
    gram = np.empty((len(data.stress), size + 2, size + 2))
    log_det = np.empty(len(data.stress))
    gap = data.paths.gap
    path_grams(columns, variance, data.paths.mask, gap, noise.length, gram, log_det)
    # Woodbury: the covariance has τ² f f' more
    with_stress, own = gram[:, :-1, -1], gram[:, -1, -1]
    share = noise.scatter**2 / (1.0 + noise.scatter**2 * own)
    gram = gram[:, :-1, :-1] - share[:, None, None] * with_stress[:, :, None] * with_stress[:, None]
    log_det += np.log1p(noise.scatter**2 * own)
    return Products(gram[:, 1:, 1:], gram[:, 1:, 0], gram[:, 0, 0], log_det)


def _by_level(films: LevelFilms, each: Floats, weights: Floats) -> Floats:
    """Return weighted sums over the films of each level."""
    found = np.zeros((films.count, *each.shape[1:]))
    np.add.at(found, films.member, each * weights.reshape(-1, *([1] * (each.ndim - 1))))
    return found


def _normal_equations(
    films: LevelFilms, point: LawPoint, products: Products, weights: Floats
) -> tuple[Floats, Floats]:
    """Return the precision of the coordinates, and the right-hand side of their mean."""
    matrix = _by_level(films, products.matrix, weights)
    # linear about the point: e + J u is to be explained
    vector = _by_level(films, products.vector, weights) + np.einsum("lij,lj->li", matrix, point.u)
    return matrix + np.eye(matrix.shape[-1]), vector


def _log_evidence(films: LevelFilms, point: LawPoint, noise: NoiseLevels, weights: Floats) -> float:
    """Return the log density of weighted films, with the law linear about a point."""
    found = _products(films, point, noise)
    u = point.u[films.member]
    turned = np.einsum("fij,fj->fi", found.matrix, u)
    square = found.square + np.sum(u * (2.0 * found.vector + turned), axis=-1)
    precision, vector = _normal_equations(films, point, found, weights)
    mean = np.linalg.solve(precision, vector[..., None])[..., 0]
    explained = np.sum(vector * mean)
    left = np.sum(weights * (found.log_det + square)) - explained
    return -0.5 * float(left + np.sum(np.linalg.slogdet(precision)[1]))


def _noise_of(films: LevelFilms, z: Floats) -> NoiseLevels:
    laws = (films.priors[name] for name in NOISE)
    return NoiseLevels(*(float(law.from_unconstrained(x)) for law, x in zip(laws, z, strict=True)))


def _log_density(films: LevelFilms, point: LawPoint, z: Floats, weights: Floats) -> float:
    """Return the log density of weighted films and of the noise, unconstrained, a priori."""
    noise = _noise_of(films, z)
    found = _log_evidence(films, point, noise, weights)
    for name, x, value in zip(NOISE, z, noise, strict=True):
        law = films.priors[name]
        found += float(law.log_density(value) + law.log_jacobian(x))
    return found


def _find_noise(
    films: LevelFilms, point: LawPoint, z: Floats, weights: Floats, inverse: Floats
) -> tuple[Floats, Floats]:
    """Return the most probable noise, unconstrained, with the law linear about a point.

    The inverse Hessian, which the search starts with and improves, is returned too.
    """

    def loss(at: Floats) -> float:
        found = _log_density(films, point, at, weights)
        return -found if np.isfinite(found) else 1e300

    # takes a second to import, and reading data does not need it
    optimize = importlib.import_module("scipy.optimize")
    options = {"gtol": FLAT, "eps": STEP, "hess_inv0": inverse}
    found = optimize.minimize(loss, z, method="BFGS", options=options)
    values, vectors = np.linalg.eigh(0.5 * (found.hess_inv + found.hess_inv.T))
    kept: Floats = (vectors * np.clip(values, *VARIANCES)) @ vectors.T
    return np.asarray(found.x, dtype=np.float64), 0.5 * (kept + kept.T)


def _find_coordinates(
    form: LawForm, films: LevelFilms, u: Floats, noise: NoiseLevels, weights: Floats
) -> tuple[LawPoint, Floats]:
    """Return the law at its most probable coordinates and their precision (Gauss and Newton)."""
    point = _at(form, films, u)
    for number in range(STEPS):
        products = _products(films, point, noise)
        precision, vector = _normal_equations(films, point, products, weights)
        step = np.linalg.solve(precision, vector[..., None])[..., 0] - point.u
        gained = np.einsum("li,lij,lj->l", step, precision, step)
        longest = np.abs(step).max(axis=-1, keepdims=True)
        # errors proportional to the stress change with it, so full steps may oscillate
        step *= 0.5 ** (number // UNDAMPED) / np.maximum(longest / LONGEST_STEP, 1.0)
        if longest.max() > SURE_STEP:
            before = _cost(films, products, point.u, weights)
            point = _downhill(form, films, point, step, noise, weights, before)
        else:
            point = _at(form, films, point.u + step)
        if gained.max() < CLOSE:
            break
    products = _products(films, point, noise)
    return point, _normal_equations(films, point, products, weights)[0]


def _cost(films: LevelFilms, products: Products, u: Floats, weights: Floats) -> Floats:
    """Return the objective of a step at each level: misfit and distance from the prior."""
    cost: Floats = _by_level(films, products.square, weights) + np.sum(u * u, axis=-1)
    return cost


def _downhill(
    form: LawForm,
    films: LevelFilms,
    point: LawPoint,
    step: Floats,
    noise: NoiseLevels,
    weights: Floats,
    before: Floats,
) -> LawPoint:
    """Return the point after a step, shortened at levels where it is uphill."""
    factor = np.ones(films.count)
    for _ in range(SHORTENED):
        after = _at(form, films, point.u + factor[:, None] * step)
        found = _products(films, after, noise, point.stress)
        uphill = ~(_cost(films, found, after.u, weights) <= before)
        if not uphill.any():
            break
        factor[uphill] *= 0.3
    return after


def _calibrate(
    form: LawForm, films: LevelFilms, weights: Floats, start: FitStart, rounds: int = ROUNDS
) -> Calibrated:
    """Find coordinates and noise in turn."""
    u, z, inverse = start
    for _ in range(rounds):
        point, _ = _find_coordinates(form, films, u, _noise_of(films, z), weights)
        u, before = point.u, z
        z, inverse = _find_noise(films, point, z, weights, inverse)
        if np.max(np.abs(z - before)) < STILL:
            break
    noise = _noise_of(films, z)
    point, precision = _find_coordinates(form, films, u, noise, weights)
    return Calibrated(point, precision, noise, FitStart(point.u, z, inverse))


def _from_all_starts(form: LawForm, films: LevelFilms) -> Calibrated:
    """Calibrate a law to all films, from each of its starts; return the most probable."""
    laws = (films.priors[name] for name in NOISE)
    weights = np.ones(len(films.member))
    z = np.array([float(law.to_unconstrained(law.quantile(0.5))) for law in laws])
    found = [
        _calibrate(
            form,
            films,
            weights,
            FitStart(np.tile(np.array(u), (films.count, 1)), z, np.eye(len(z))),
        )
        for u in form.all_starts
    ]
    densities = [_log_density(films, one.point, one.end.z, weights) for one in found]
    return found[int(np.argmax(densities))]


def _predict(films: LevelFilms, fit: Calibrated, film: int) -> float:
    """Return the log density of a held-out film."""
    one = Products(*(part[film] for part in _products(films, fit.point, fit.noise)))
    before = fit.precision[films.member[film]]
    after = before + one.matrix
    explained = one.vector @ np.linalg.solve(after, one.vector)
    spread = np.linalg.slogdet(after)[1] - np.linalg.slogdet(before)[1]
    return -0.5 * float(one.log_det + one.square - explained + spread)


@dataclass(frozen=True)
class FittedLaw:
    """A law fitted to the films of each level, and its predictions of held-out films.

    Parameters
    ----------
    name : str
        Of the law.
    size : int
        Number of its constants at a level.
    constants : tuple of dict
        By level.
    modulus : array, shape (n_levels,)
        Shear modulus at zero strain [MPa].
    noise : NoiseLevels
        That the law leaves, with all films.
    error, held_out_error : array, shape (n_films,)
        Root mean square of what is read less the law, fitted with and without the film [MPa]; nan
        of films that cannot be held out.
    elpd : array, shape (n_films,)
        Log density of the film's readings given the other films; nan of such films.
    """

    name: str
    size: int
    constants: tuple[dict[str, float], ...]
    modulus: Floats
    noise: NoiseLevels
    error: Floats
    held_out_error: Floats
    elpd: Floats


def fit_law(form: LawForm, films: LevelFilms) -> FittedLaw:
    """Fit a law to all films, and to all but one in turn."""
    whole = _from_all_starts(form, films)
    elpd, error = np.full((2, len(films.member)), np.nan)
    for film in films.held_out:
        weights = np.ones(len(films.member))
        weights[film] = 0.0
        fold = _calibrate(form, films, weights, whole.end)
        elpd[film] = _predict(films, fold, int(film))
        error[film] = _errors(films, fold.point)[film]
    pairs = zip(whole.point.u, films.scale.tolist(), films.largest.tolist(), strict=True)
    constants = tuple(form.constants(*one) for one in pairs)
    return FittedLaw(
        form.name,
        form.size,
        constants,
        np.array([float(form.solid(one).shear_modulus) for one in constants]),
        whole.noise,
        _errors(films, whole.point),
        error,
        elpd,
    )


def _errors(films: LevelFilms, point: LawPoint) -> Floats:
    """Return the root mean square error of each film [MPa]."""
    read = films.curves.mask
    square = np.where(read, np.square(films.curves.stress - point.stress), 0.0)
    found: Floats = np.sqrt(square.sum(axis=-1) / read.sum(axis=-1))
    return found


@dataclass(frozen=True)
class LawComparison:
    """Comparison of laws.

    `used` is the law of the study's model; `level` [%] and `readings` (n_films,) are the
    degradation rate of each film's level and its number of readings.
    """

    fits: tuple[FittedLaw, ...]
    used: str
    level: Floats
    readings: Numbers
    modes: tuple[str, ...]

    @property
    def by_name(self) -> dict[str, FittedLaw]:
        """The laws by name."""
        return {fit.name: fit for fit in self.fits}

    @property
    def is_judged(self) -> bool:
        """Whether any film could be held out."""
        return bool(np.isfinite(self.by_name[self.used].elpd).any())

    @property
    def held_out(self) -> int:
        """Number of films that were held out."""
        return int(np.isfinite(self.by_name[self.used].elpd).sum())

    @property
    def ranked(self) -> tuple[FittedLaw, ...]:
        """The laws, the one that predicts held-out films best first."""
        return tuple(sorted(self.fits, key=lambda fit: -float(np.nansum(fit.elpd))))

    @property
    def best(self) -> FittedLaw:
        """The law that predicts held-out films best."""
        return self.ranked[0]

    @property
    def rival(self) -> FittedLaw:
        """The law that the best is compared with: the law used, or the second best."""
        return self.ranked[1] if self.best.name == self.used else self.by_name[self.used]

    def difference(
        self, fit: FittedLaw, other: FittedLaw, rows: NDArray[np.bool_] | slice = slice(None)
    ) -> tuple[float, float]:
        """Return the gain in elpd of a law over another, and its standard error over films."""
        gap = (fit.elpd - other.elpd)[rows]
        gap = gap[np.isfinite(gap)]
        return float(np.sum(gap)) if len(gap) else float("nan"), standard_error(gap)

    @property
    def gain(self) -> tuple[float, float]:
        """The gain of the best law over its rival, and its standard error."""
        return self.difference(self.best, self.rival)

    @property
    def is_clear(self) -> bool:
        """Whether the best law predicts better than its rival by more than chance."""
        gain, error = self.gain
        return bool(gain > CLEARLY * error)

    @property
    def errors(self) -> tuple[float, float]:
        """Root mean square errors of held-out films, of the best law and its rival [MPa]."""
        every = np.ones(len(self.level), bool)
        first, second = (self._rms(fit.held_out_error, every) for fit in (self.best, self.rival))
        return first, second

    def table(self) -> pd.DataFrame:
        """Return the columns of ``material_laws.csv``: one row per law and level, and for all."""
        rows = []
        for fit in self.fits:
            for k, level in enumerate(np.unique(self.level)):
                named = {name: fit.constants[k].get(name, np.nan) for name in CONSTANTS}
                scores = self._scores(fit, self.level == level)
                rows.append(
                    {"law": fit.name, "degradation_pct": f"{level:g}"}
                    | scores
                    | {"shear_modulus_MPa": float(fit.modulus[k])}
                    | named
                )
            every = self._scores(fit, np.ones(len(self.level), bool))
            noise = dict(zip(NOISE, fit.noise, strict=True))
            named = dict.fromkeys(("shear_modulus_MPa", *CONSTANTS), np.nan)
            rows.append({"law": fit.name, "degradation_pct": "all"} | every | named | noise)
        return pd.DataFrame(rows)

    def _scores(self, fit: FittedLaw, rows: NDArray[np.bool_]) -> dict[str, object]:
        used = self.by_name[self.used]
        found = fit.elpd[rows][np.isfinite(fit.elpd[rows])]
        gain, error = self.difference(fit, used, rows)
        return {
            "used": int(fit.name == self.used),
            "parameters": fit.size,
            "films": int(rows.sum()),
            "held_out": len(found),
            "elpd": float(np.sum(found)) if len(found) else np.nan,
            "elpd_diff": gain,
            "elpd_diff_se": error,
            "rmse_MPa": self._rms(fit.error, rows),
            "held_out_rmse_MPa": self._rms(fit.held_out_error, rows),
        }

    def _rms(self, error: Floats, rows: NDArray[np.bool_]) -> float:
        known = rows & np.isfinite(error)
        count = self.readings[known]
        total = float(np.sum(count))
        return float(np.sqrt(np.sum(count * error[known] ** 2) / total)) if total else np.nan


def compare_laws(
    curves: TensileCurves,
    priors: Mapping[str, Distribution],
    *,
    used: str = "yeoh",
    names: Sequence[str] = tuple(FORMS),
) -> LawComparison:
    """Fit each law to the films, and predict each film from the others of its level.

    `priors` are those of the parameters in `NOISE`; `names` are laws, with the one of the study's
    model, `used`.

    References
    ----------
    Vehtari, Gelman, Gabry (2017), Stat. Comput. 27, 1413; doi:10.1007/s11222-016-9696-4 (log
    predictive densities of what was left out, and standard errors of their differences).

    Examples
    --------
    Three films of Yeoh's solid, of which one is 5 % stiffer:

    >>> from bayesdeg.material.hyperelastic import yeoh_basis
    >>> from bayesdeg.observations.specimens import STIFFNESS_SCATTER
    >>> from bayesdeg.observations.tensile import TENSILE
    >>> stretch = np.tile(np.linspace(1.1, 2.0, 8), (3, 1))
    >>> basis = yeoh_basis(stretch, "uniaxial")
    >>> curves = TensileCurves(
    ...     specimens=("a", "b", "c"),
    ...     modes=("uniaxial",) * 3,
    ...     degradation=np.zeros(3),
    ...     degradation_sd=np.zeros(3),
    ...     basis=basis,
    ...     stretch=stretch,
    ...     stress=basis @ [0.3, -0.02, 0.004] * np.array([[1.0], [1.05], [1.0]]),
    ...     cauchy=np.zeros(stretch.shape, bool),
    ...     mask=np.ones(stretch.shape, bool),
    ... )
    >>> priors = {p.name: p.law for p in (*TENSILE, STIFFNESS_SCATTER)}
    >>> found = compare_laws(curves, priors, names=("yeoh", "neo_hookean"))
    >>> found.best.name, round(float(found.best.constants[0]["c1_MPa"]), 1)
    ('yeoh', 0.3)
    """
    films = LevelFilms(curves, {name: priors[name] for name in NOISE})
    return LawComparison(
        tuple(fit_law(FORMS[name], films) for name in names),
        used,
        films.centres[films.member].round(3),
        curves.mask.sum(axis=-1).astype(np.int64),
        tuple(dict.fromkeys(curves.modes)),
    )
