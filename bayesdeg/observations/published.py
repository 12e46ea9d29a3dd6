"""Published tests of actuators: the log density of R², and counts of ruptures as data.

R² = 1 − SSE/SST measures how far n specimens were from the published simulation. A specimen
s differs from it, to first order, by

    d_sj = J_j (m_s − m_0) + ε_sj,   J = ∂κ/∂ ln(stiffness),

with m_s ~ N(0, τ²) its own stiffness deviation, including the error of its degradation rate,
m_0 ~ N(0, τ_0²) the error of the constants, fitted to a few films, and ε the reading noise. So SSE
is a weighted sum of chi-squares, approximated by a scaled chi-square.

R² is a likelihood only for a study without its own readings. With an ``actuator.csv`` it is shown
next to the model's and not fitted: it describes other specimens and a different simulation, and the
study's own readings carry the information. `r_squared_log_density` uses R² for scatter and noise,
not for the shape of the curves.

Counts of ruptures are data in every study that has them, see `bayesdeg.observations.counts`.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, NamedTuple, override

import numpy as np
import scipy
from numpy.typing import NDArray

from bayesdeg.data.study import Study
from bayesdeg.errors import Fault, StudyError
from bayesdeg.observations.counts import CountedTests, RuptureCounts
from bayesdeg.observations.curvature import actuator_parameters, inputs_without_causes
from bayesdeg.observations.kinds import Observations, Rows, State
from bayesdeg.observations.specimens import FilmsAndActuators, stiffness_spread
from bayesdeg.priors import Parameter

Floats = NDArray[np.float64]

SMALLEST_MISFIT = 2.5e-4
"""R² is published to three decimals: 1.000 means a misfit between 0 and 5e-4."""


class Differences(NamedTuple):
    """Components of the differences between specimens and the published simulation.

    ``slope`` is J [1/m], of either sign, (n, n_levels, n_pressures). ``spread`` and
    ``common_spread`` are τ² and τ_0², (n, n_levels) or (n, 1). ``noise`` is the covariance V of
    the noise along a path [1/m²], (n, n_levels, n_pressures, n_pressures). ``specimens`` is n,
    (n_levels,) or a number.
    """

    slope: Floats
    spread: Floats
    common_spread: Floats
    noise: Floats
    specimens: Floats | float


class Moments(NamedTuple):
    """Mean and variance of SSE, each (n, n_levels), [1/m²] and its square."""

    mean: Floats
    variance: Floats


def misfit_moments(differences: Differences) -> Moments:
    r"""Return mean and variance of the sum of squared differences, SSE.

    All readings of all specimens have covariance
    :math:`\Sigma = I_n \otimes (V + \tau^2 J J^T) + 1 1^T \otimes \tau_0^2 J J^T`; with it
    :math:`E = tr\,\Sigma` and :math:`Var = 2\,tr\,\Sigma^2`.

    Examples
    --------
    One specimen, one reading of noise 0.5 and scatter 1 × 2: SSE is (4 + 0.25) χ².

    >>> one = np.ones((1, 1))
    >>> some = Differences(2.0 * one[..., None], one, 0.0 * one, 0.25 * one[..., None, None], 1.0)
    >>> misfit_moments(some)
    Moments(mean=array([[4.25]]), variance=array([[36.125]]))
    """
    slope, spread, common_spread, noise, specimens = differences
    size = np.sum(slope**2, axis=-1)
    both = (spread + common_spread) * size
    across = np.sum(slope * np.matmul(noise, slope[..., None])[..., 0], axis=-1)
    mean = specimens * (np.trace(noise, axis1=-2, axis2=-1) + both)
    within = np.sum(noise**2, axis=(-2, -1)) + 2.0 * (spread + common_spread) * across + both**2
    between = (specimens - 1.0) * (common_spread * size) ** 2
    return Moments(mean, 2.0 * specimens * (within + between))


def expected_total(curvature: Floats, differences: Differences) -> Floats:
    """Return the mean of SST over all readings, including the zeros at 0 kPa, (n, n_levels).

    Scatter and noise of the readings add to the sum of squares of the mean curve.

    Examples
    --------
    One exact specimen with readings 0, 3, 3 about their mean of 2:

    >>> one, curve = np.ones((1, 1)), np.array([[[3.0, 3.0]]])
    >>> exact = Differences(0.0 * curve, 0.0 * one, 0.0 * one, np.zeros((1, 1, 2, 2)), 1.0)
    >>> float(expected_total(curve, exact)[0, 0])
    6.0
    """
    slope, spread, _, noise, specimens = differences
    count = curvature.shape[-1] + 1
    curve = np.sum(curvature**2, axis=-1) - np.sum(curvature, axis=-1) ** 2 / count
    squares = np.trace(noise, axis1=-2, axis2=-1) + spread * np.sum(slope**2, axis=-1)
    of_mean = np.sum(noise, axis=(-2, -1)) + spread * np.sum(slope, axis=-1) ** 2
    total: Floats = specimens * (curve + squares) - of_mean / count
    return total


def r_squared_log_density(
    one_minus_r2: Floats, curvature: Floats, differences: Differences
) -> Floats:
    r"""Return the log density of 1 − R² = SSE/SST at each level, shape (n, n_levels).

    SSE is approximated by :math:`c\,\chi^2_\nu` with its own mean and variance,
    :math:`c = Var / (2 E)` and :math:`\nu = 2 E^2 / Var`, and SST by its mean. Between the 5 and
    the 95 % quantile the log density of SSE is then accurate to 0.3, for scatter of 2 to 10 %,
    errors of D_R up to 2 points and noise of 0.5 to 5 %; the probability that R² is below a value
    is accurate to 0.06, including the nonlinear response of the simulation to stiffness.

    Parameters
    ----------
    one_minus_r2 : array, shape (n_levels,)
        Published; nan gives nan.
    curvature : array, shape (n, n_levels, n_pressures)
        At the pressures above zero [1/m].
    differences : Differences
        Of the specimens to the simulation.

    References
    ----------
    Satterthwaite (1946), Biometrics Bulletin 2:110–114; doi:10.2307/3002019.

    Examples
    --------
    Two readings of one specimen with much noise of equal size: SSE is v χ² of 2 degrees of freedom,
    and SST = 6 + (2 − 2/3) v = 10 on average.

    >>> none, curve = np.zeros((1, 1)), np.array([[[3.0, 3.0]]])
    >>> noise = Differences(0.0 * curve, none, none, 3.0 * np.eye(2)[None, None], 1.0)
    >>> density = r_squared_log_density(np.array([0.5]), curve, noise)
    >>> bool(np.isclose(density[0, 0], np.log(0.5 * 10 / 3) - 0.5 * 0.5 * 10 / 3))
    True
    """
    mean, variance = misfit_moments(differences)
    scale, half_freedom = 0.5 * variance / mean, mean**2 / variance
    log_unit = np.log(expected_total(curvature, differences)) - np.log(scale)
    log_x = np.log(np.maximum(one_minus_r2, SMALLEST_MISFIT)) + log_unit
    density: Floats = (
        (half_freedom - 1.0) * log_x
        - 0.5 * np.exp(log_x)
        - half_freedom * np.log(2.0)
        - scipy.special.gammaln(half_freedom)
        + log_unit
    )
    return density


Flags = NDArray[np.bool_]
Kind = Literal["r_squared", "ruptures"]

PRESSURES = np.arange(20.0, 241.0, 20.0)
"""Pressures of the published tests [kPa]; curvature at 0 kPa, zero by definition, counts in SST."""
SPECIMENS = 3.0
"""Default number of actuators at a level, and of films behind its constants."""


@dataclass(frozen=True)
class PublishedTests:
    """Tests of actuators with only statistics known.

    Parameters
    ----------
    degradation, degradation_sd : array, shape (n_levels,)
        D_R of each level and its standard error from specimen to specimen [%].
    pressure : array, shape (n_pressures,)
        In increasing order [kPa].
    tested : array, shape (n_levels,)
        Number of actuators.
    r_squared, ruptured : array, shape (n_levels,)
        R² [–] and number of actuators that burst; nan where not given.
    films : float
        Number of films behind the constants of the published simulation at a level.
    """

    degradation: Floats
    degradation_sd: Floats
    pressure: Floats
    tested: Floats
    r_squared: Floats
    ruptured: Floats
    films: float = SPECIMENS

    def given(self, kind: Kind) -> Flags:
        """Return the levels at which a statistic is given, shape (n_levels,)."""
        return np.isfinite(self.r_squared if kind == "r_squared" else self.ruptured)

    def names(self, kind: Kind) -> tuple[str, ...]:
        """Return the labels of the columns of a block of the log likelihood."""
        words = {"r_squared": "R²", "ruptures": "ruptures"}[kind]
        return tuple(f"{words} at {level:g} %" for level in self.degradation[self.given(kind)])

    @property
    def counted(self) -> RuptureCounts | None:
        """The levels with known numbers of ruptures; None if there are none."""
        known = self.given("ruptures")
        if not np.any(known):
            return None
        tests = CountedTests(
            specimens=self.names("ruptures"),
            degradation=self.degradation[known, None],
            degradation_sd=self.degradation_sd[known, None],
            pressure=np.full(int(np.sum(known)), self.pressure[-1]),
            tested=self.tested[known],
            ruptured=self.ruptured[known],
        )
        return RuptureCounts(tests)


def published_tests(study: Study) -> PublishedTests | None:
    """Return the published statistics of a study without its own actuator readings.

    Degraded specimens get the study's general error of degradation rates; fresh ones have no
    error.

    Returns
    -------
    PublishedTests or None
        None if none are given, or the study has its own actuator readings.

    Raises
    ------
    StudyError
        If a statistic is given twice at a level, or more burst than were tested.
    """
    return None if study.actuator is not None else _tests_of(study)


def published_counts(study: Study) -> RuptureCounts | None:
    """Return published numbers of ruptures, whatever other data the study has.

    In a study with its own actuators they are assumed tested up to the same pressure.

    Raises
    ------
    StudyError
        As in `published_tests`.
    """
    found = _tests_of(study)
    if found is not None and study.actuator is not None:
        pressure = np.sort(study.actuator["pressure_kPa"].to_numpy(np.float64))
        found = replace(found, pressure=pressure)
    return None if found is None else found.counted


def _tests_of(study: Study) -> PublishedTests | None:
    if study.summary is None:
        return None
    given = {name: _by_level(study, name) for name in ("r_squared", "ruptured_count")}
    tested = _by_level(study, "tested_count")
    levels = sorted({level for values in given.values() for level in values})
    if not levels:
        return None
    films = study.summary.loc[study.summary["quantity"] == "young_modulus", "n"].dropna()
    r_squared, ruptured = (
        np.array([values.get(level, np.nan) for level in levels]) for values in given.values()
    )
    tests = PublishedTests(
        degradation=np.array(levels),
        degradation_sd=np.where(
            np.array(levels) > 0.0, study.settings.noise.degradation_sd_pct, 0.0
        ),
        pressure=PRESSURES,
        tested=np.array([tested.get(level, SPECIMENS) for level in levels]),
        r_squared=r_squared,
        ruptured=ruptured,
        films=float(films.min()) if len(films) else SPECIMENS,
    )
    faults = [
        Fault(
            "summary.csv",
            f"{ruptured:g} of {tested:g} actuators burst at {level:g} %",
            "give tested_count at that level: at least 1, and at least ruptured_count",
        )
        for level, tested, ruptured in zip(
            tests.degradation, tests.tested, tests.ruptured, strict=True
        )
        if tested < max(np.nan_to_num(ruptured), 1.0)
    ]
    if faults:
        raise StudyError(faults)
    return tests


def _r_squared(state: State[FilmsAndActuators], tests: PublishedTests) -> Floats:
    """Return the log density of R² at each level, for actuators of its median material."""
    values, material = state.values, state.world.material(state.values, tests.degradation)
    c1, c2, c3 = (material.constants[..., i, None] for i in range(3))
    inputs = inputs_without_causes(state, tests.pressure, (c1, c2, c3))
    prediction = state.world.forward(inputs)
    noise, floor, length = (
        values[name][:, None, None]
        for name in ("curvature_noise", "curvature_noise_floor", "curvature_noise_length")
    )
    sd = np.hypot(floor, noise * prediction.curvature)
    apart = np.abs(tests.pressure[:, None] - tests.pressure)
    correlation = np.exp(-apart / length)[:, None]
    differences = Differences(
        slope=prediction.slope,
        spread=stiffness_spread(values, material, tests.degradation_sd),
        common_spread=values["stiffness_scatter"][:, None] ** 2 / tests.films,
        noise=sd[..., :, None] * correlation * sd[..., None, :],
        specimens=tests.tested,
    )
    return r_squared_log_density(1.0 - tests.r_squared, prediction.curvature, differences)


def _by_level(study: Study, quantity: str) -> dict[float, float]:
    assert study.summary is not None
    table = study.summary
    rows = table[(table["quantity"] == quantity) & table["degradation_pct"].notna()]
    levels = rows["degradation_pct"].to_numpy(np.float64)
    twice = sorted({float(level) for level in levels if np.sum(levels == level) > 1})
    if twice:
        problems = [f"{quantity} at {level:g} % is given twice" for level in twice]
        raise StudyError([Fault("summary.csv", p, "keep one row per level") for p in problems])
    return dict(zip(levels.tolist(), rows["value"].to_numpy(np.float64).tolist(), strict=True))


@dataclass(frozen=True)
class RSquared(Observations):
    """Published R² of the curvatures.

    Parameters
    ----------
    tests : PublishedTests
        With R² at one level at least.
    """

    name: ClassVar[str] = "r_squared"
    order: ClassVar[int] = 60
    uses_forward: ClassVar[bool] = True

    tests: PublishedTests

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        return actuator_parameters(float(self.tests.pressure.max()))

    @property
    @override
    def labels(self) -> tuple[str, ...]:
        return self.tests.names("r_squared")

    @property
    @override
    def specimens(self) -> tuple[str, ...]:
        return ()

    @property
    @override
    def material_levels(self) -> Floats:
        return self.tests.degradation

    @override
    def log_likelihood(self, state: State[FilmsAndActuators]) -> Floats:
        return _r_squared(state, self.tests)[:, self.tests.given("r_squared")]

    @override
    def subset(self, rows: Rows) -> "RSquared":
        kept = np.flatnonzero(self.tests.given("r_squared"))[rows]
        left = np.full_like(self.tests.r_squared, np.nan)
        left[kept] = self.tests.r_squared[kept]
        return RSquared(replace(self.tests, r_squared=left))


def of_tests(tests: PublishedTests) -> tuple[Observations, ...]:
    """Return given statistics of published tests, each as a separate kind."""
    r_squared = (RSquared(tests),) if np.any(tests.given("r_squared")) else ()
    counted = tests.counted
    return r_squared if counted is None else (*r_squared, counted)


def from_study(study: Study) -> tuple[Observations, ...]:
    """Return published R² if a study has no readings of its own; counts are not fitted."""
    found = published_tests(study)
    if found is None:
        return ()
    return of_tests(replace(found, ruptured=np.full_like(found.ruptured, np.nan)))
