"""Analysis of the films alone: course of degradation, polynomial order, material law."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.analysis.material_laws import NOISE, LawComparison, compare_laws
from bayesdeg.analysis.order import OrderComparison, compare_orders
from bayesdeg.criticism.fit.side_by_side import later
from bayesdeg.criticism.posterior.convergence import Convergence, diagnose
from bayesdeg.data.settings import MaterialLaw
from bayesdeg.data.study import Study
from bayesdeg.inference.course import (
    CourseModel,
    course_model,
    degradation_at,
    moisture_at,
    rate_errors,
    time_to_reach,
)
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain, Effort, sample
from bayesdeg.observations.tensile import Tensile
from bayesdeg.pages import tables as columns
from bayesdeg.pages.left_out import Guard, OptionalStage
from bayesdeg.pages.wording import worded
from bayesdeg.prediction.soil import Soil
from bayesdeg.priors import Distribution
from bayesdeg.progress import Progress

Floats = NDArray[np.float64]

COMMON_ERROR = "common_error"
TARGET = 25.0  # %, the largest degradation rate of doi:10.3389/frobt.2021.760485
NEARLY_CERTAIN = 0.95  # probability above which the time has a 90 % interval
POINTS = 73
QUANTILES = (5, 25, 50, 75, 95)


@dataclass(frozen=True)
class CourseFit:
    """The calibrated course of degradation; fields as in `bayesdeg.analysis.calibrate.Fit`."""

    model: CourseModel
    chain: Chain
    diagnosis: Convergence

    @property
    def draws(self) -> dict[str, Floats]:
        """Named values of all draws."""
        return self.model.table.named(self.chain.vectors.reshape(-1, self.chain.vectors.shape[-1]))

    def soil(self, kept: int) -> Soil:
        """Return the course for the draws in a run folder, in the order of its file."""
        ordered = self.chain.thinned(kept).by_walker
        return Soil(self.model.table.named(ordered.reshape(-1, ordered.shape[-1])))


@dataclass(frozen=True)
class Films:
    """Results from the films alone.

    Parameters
    ----------
    course : CourseFit, optional
        None without readings of moisture at two times.
    orders : OrderComparison, optional
        None without films at several degradation rates.
    stated : array
        Degradation rates of degraded specimens and their standard errors, (n, 2) [%].
    laws : LawComparison, optional
        None without films.
    degrades : bool
        Whether anything of the study does.
    """

    course: CourseFit | None
    orders: OrderComparison | None
    stated: Floats
    laws: LawComparison | None = None
    degrades: bool = True

    def tables(self, generator: np.random.Generator) -> dict[str, Callable[[], pd.DataFrame]]:
        """Return what makes the tables of the run folder, by their names."""
        found: dict[str, Callable[[], pd.DataFrame]] = {}
        if self.course is not None:
            found[columns.COURSE] = partial(course_table, self.course, generator)
        if self.orders is not None:
            found[columns.ORDERS] = self.orders.table
        if self.laws is not None:
            found[columns.MATERIAL_LAWS] = self.laws.table
        return found

    def sentences(self) -> dict[str, str]:
        """Return the results in words."""
        said = {}
        if self.course is not None:
            said[columns.COURSE] = worded(course_summary(self.course))
            said[COMMON_ERROR] = worded(common_error(self.course, self.stated))
        if self.orders is not None:
            said[columns.ORDERS] = worded(self.orders)
        if self.laws is not None:
            said[columns.MATERIAL_LAWS] = worded(self.laws, degrades=self.degrades)
        return said


type Examination = Callable[[Progress, Guard], Films]


def begin_examination(
    study: Study,
    model: JointModel,
    *,
    effort: Effort,
    seed: np.random.SeedSequence,
    executor: Executor | None = None,
) -> Examination:
    """Start the analysis of the films; orders and laws are compared in the background.

    Parameters
    ----------
    study : Study
        Readings of moisture, and degradation rates of specimens.
    model : JointModel
        The base model, for its films and priors.
    effort : Effort
        Of sampling the course.
    seed : SeedSequence
        Everything random comes from it.
    executor : Executor, optional
        Compares orders and laws; by default that is done when the rest is.

    Returns
    -------
    callable
        Calibrates the course of degradation and waits for orders and laws; a guard leaves out
        what fails.
    """
    of_course, of_orders = seed.spawn(2)
    orders = later(partial(_orders, model, of_orders), executor)
    priors = {p.name: p.law for p in model.base if p.name in NOISE}
    used = model.world.law
    laws = later(partial(_laws, model.of_kind(Tensile), priors, used), executor)
    return partial(_examined, study, effort, of_course, orders, laws)


def _examined(
    study: Study,
    effort: Effort,
    seed: np.random.SeedSequence,
    begun: Callable[[], OrderComparison | None],
    laws: Callable[[], LawComparison | None],
    progress: Progress,
    guard: Guard,
) -> Films:
    if study.moisture is not None:
        progress.stage("course of degradation")
    fit = guard.attempt(OptionalStage.COURSE, _course, study, effort=effort, seed=seed)
    if study.degrades:
        progress.stage("order of the polynomials of the degradation rate")
    orders = guard.attempt(OptionalStage.ORDERS, begun)
    if study.tensile is not None:
        progress.stage(OptionalStage.LAWS)
    compared = guard.attempt(OptionalStage.LAWS, laws)
    pairs = [
        table.groupby("specimen_id", sort=False)[["degradation_pct", "degradation_sd_pct"]].first()
        for table in (study.tensile, study.actuator)
        if table is not None
    ]
    found = np.concatenate([np.empty((0, 2)), *(p.to_numpy(np.float64) for p in pairs)])
    return Films(fit, orders, found[found[:, 0] > 0.0], compared, study.degrades)


def _orders(model: JointModel, seed: np.random.SeedSequence) -> OrderComparison | None:
    # one thread: the same bits in any process
    with threadpool_limits(limits=1):
        return compare_orders(model, seed=seed)


def _laws(
    films: tuple[Tensile, ...], priors: dict[str, Distribution], used: MaterialLaw
) -> LawComparison | None:
    """Compare material laws; None without films."""
    if not films:
        return None
    with threadpool_limits(limits=1):
        return compare_laws(films[0].tests, priors, used=used)


def course_of(study: Study, effort: Effort, seed: np.random.SeedSequence) -> CourseFit | None:
    """Calibrate the course of degradation, as `begin_examination` does with the same seed.

    Returns
    -------
    CourseFit or None
        None without readings of moisture at two times.
    """
    return _course(study, effort=effort, seed=seed.spawn(2)[0])


def course_table(fit: CourseFit, generator: np.random.Generator) -> pd.DataFrame:
    """Return bands of degradation rate and moisture against time, and the films: ``course.csv``.

    The band of the degradation rate is for the mean film, that of moisture for a single film.
    """
    model, values = fit.model, fit.draws
    time = np.linspace(0.0, float(model.time_h.max()), POINTS)
    rates = np.percentile(degradation_at(values, time), QUANTILES, axis=0)
    mean = moisture_at(values, time)
    readings = mean + values["moisture_scatter"][:, None] * generator.standard_normal(mean.shape)
    moisture = np.percentile(readings, (5, 50, 95), axis=0)
    band = pd.DataFrame(
        {"kind": "band", "film_id": "", "time_h": time}
        | {f"q{q:02d}": rates[i] for i, q in enumerate(QUANTILES)}
        | {f"moisture_q{q:02d}": moisture[i] for i, q in enumerate((5, 50, 95))}
    )
    fresh = float(np.mean(values["fresh_moisture"]))
    films = pd.DataFrame(
        {
            "kind": "film",
            "film_id": model.films,
            "time_h": model.time_h,
            "moisture_pct": model.moisture_pct,
            "degradation_pct": 100.0 * (1.0 - model.moisture_pct / fresh),
        }
    )
    return pd.concat([band, films], ignore_index=True)


@dataclass(frozen=True)
class CourseSummary:
    """Time at which a degradation rate is reached, or the probability that it ever is.

    Parameters
    ----------
    films : int
        Films whose moisture tells it.
    target : float
        The degradation rate [%].
    reached : float
        Probability that it is ever reached [–].
    hours, limit : (float, float, float)
        After what time [h], and the rate that is approached [%]: median, 5 and 95 %.
    last_h : float
        Time of the last reading [h].
    """

    films: int
    target: float
    reached: float
    hours: tuple[float, float, float]
    limit: tuple[float, float, float]
    last_h: float

    @property
    def is_certain(self) -> bool:
        """Whether nearly all draws reach it, so that the time has an interval."""
        return self.reached >= NEARLY_CERTAIN


@dataclass(frozen=True)
class CommonError:
    """The error shared by all degradation rates, and the one stated by the study.

    Parameters
    ----------
    fresh, films : int
        Films weighed fresh, and films at one later time.
    level : float
        Degradation rate at which it is largest [%].
    common, own, total : float
        Standard error by the mean fresh moisture, by the mean of one time, and of both [points].
    stated : float, optional
        What the study states for its degraded specimens [points]; None without such specimens.
    """

    fresh: int
    films: int
    level: float
    common: float
    own: float
    total: float
    stated: float | None


def course_summary(fit: CourseFit, target: float = TARGET) -> CourseSummary:
    """Return when a degradation rate is reached, or the probability that it ever is."""
    values = fit.draws
    time = time_to_reach(values, target)
    middle, low, high = np.percentile(time, (50, 5, 95), method="nearest").tolist()
    limit = np.percentile(values["degradation_limit"], (50, 5, 95)).tolist()
    return CourseSummary(
        films=len(fit.model.films),
        target=target,
        reached=float(np.mean(np.isfinite(time))),
        hours=(middle, low, high),
        limit=tuple(limit),
        last_h=float(fit.model.time_h.max()),
    )


def common_error(fit: CourseFit, stated: Floats) -> CommonError:
    """Return the error shared by all degradation rates.

    Parameters
    ----------
    fit : CourseFit
        Moisture and its scatter.
    stated : array, shape (n, 2)
        Degradation rates of degraded specimens and their standard errors [%].
    """
    time = fit.model.time_h
    _, counts = np.unique(time[time > 0.0], return_counts=True)
    fresh, films = int(np.sum(time == 0.0)), int(np.median(counts))
    level = float(np.max(stated[:, 0])) if len(stated) else TARGET
    given = float(np.median(stated[:, 1])) if len(stated) else None
    if fresh == 0:
        unknown = float("nan")
        return CommonError(fresh, films, level, unknown, unknown, unknown, given)
    errors = rate_errors(fit.draws, np.array([level]), fresh_films=fresh, films=films)
    return CommonError(
        fresh=fresh,
        films=films,
        level=level,
        common=float(np.mean(errors.common)),
        own=float(np.mean(errors.own)),
        total=float(np.mean(errors.total)),
        stated=given,
    )


def _course(study: Study, *, effort: Effort, seed: np.random.SeedSequence) -> CourseFit | None:
    """Calibrate the course of degradation; None without readings of moisture at two times."""
    course = course_model(study)
    if course is None:
        return None
    first, chains = seed.spawn(2)
    generator = np.random.default_rng(first)
    # one thread: the same bits whatever the machine's number of them
    with threadpool_limits(limits=1):
        start = evidence(course, approximate(course, generator), generator)
    chain = sample(course, start, effort=effort, seed=chains)
    return CourseFit(course, chain, diagnose(course, chain, effort))
