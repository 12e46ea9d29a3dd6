"""The public functions of the library, for ``import bayesdeg as bd``.

Read a study, calibrate its model, criticise it, name the cause, compare, predict, report. Each
function returns a value that prints readably, shows as HTML in a notebook and gives tidy frames;
nothing is changed in place. The same seed gives the same result, whatever the number of workers.
On a terminal, progress is shown on standard error.
"""

import os
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from bayesdeg.actuator.families import geometry_of, geometry_of_study
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.status import Backend
from bayesdeg.analysis.calibrate import base_of
from bayesdeg.analysis.calibrate import calibrate as calibrate_model
from bayesdeg.analysis.judge import extended_model
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.decide.support import can_be_held_out
from bayesdeg.criticism.holdout.gain import gain_table
from bayesdeg.criticism.holdout.held_out import one_by_one, run_folds
from bayesdeg.data.settings import AnyDimensions
from bayesdeg.data.study import Study
from bayesdeg.display import can_show_bars, shown
from bayesdeg.errors import BayesdegError, Stopped, use_one_of
from bayesdeg.inference.sampling import EFFORTS as SAMPLING_EFFORTS
from bayesdeg.pages.checkpoints import NoCheckpoints
from bayesdeg.pages.headline import forward_map_words
from bayesdeg.prediction import forecast, own
from bayesdeg.prediction import lifetime as lives
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.soil import Level, known_levels
from bayesdeg.progress import Progress
from bayesdeg.quantities import EFFORTS, Effort
from bayesdeg.results import Calibration, Model, Report, Verdict, write_run
from bayesdeg.run.record import Results, forward_map_of
from bayesdeg.run.stages import Streams, verdict_on
from bayesdeg.run.update import Update, read_new
from bayesdeg.run.update import update as update_run
from bayesdeg.surrogate.campaign import Campaign, expect, train_emulator
from bayesdeg.surrogate.kept import CACHE, duration, refuse_whole_range, rough_seconds
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import find, write_trained
from bayesdeg.surrogate.workers import kept_processes
from bayesdeg.training import STORE, TrainingOptions, emulator_for, refuse_cells

Floats = NDArray[np.float64]
Causes = Literal["all"] | str | Iterable[Cause | str]


def emulator(
    geometry: AnyDimensions | Moulded | Study,
    *,
    cache: Path | str = CACHE,
    workers: int | None = None,
    progress: bool | None = None,
    backend: Backend | str = Backend.KERNELS,
) -> Surrogate:
    """Return an emulator of an actuator: shipped, trained earlier, or trained now.

    For a study it is trained in the study's region of the input space, as by ``bayesdeg run``, in
    minutes; each finds emulators trained by the other. For dimensions alone it is trained over the
    whole range of materials and causes, which takes hours. Solutions are kept in
    ``.cache/campaign``, so an interrupted training can continue.

    Parameters
    ----------
    geometry : Study, Dimensions or Geometry
        A study, or an actuator as moulded, such as ``study.geometry``.
    cache : Path
        Folder of trained emulators.
    workers : int, optional
        Number of processes; by default one per core.
    progress : bool, optional
        Whether to show progress; by default on a terminal.
    backend : {"kernels", "scikit-fem"}
        Finite element assembly for training. With scikit-fem, which is forty times slower, one is
        trained even if the package has one.

    Returns
    -------
    Surrogate
        A callable that refuses to extrapolate.

    Warns
    -----
    UserWarning
        Before training an emulator for dimensions alone: how long that takes.

    Raises
    ------
    GeometryError
        If no actuator can be made with the dimensions.
    BayesdegError
        If no emulator can be trained for the actuator, or the backend is unknown.
    """
    wanted = can_show_bars() if progress is None else progress
    if backend not in list(Backend):
        raise BayesdegError(f"unknown backend {backend!r}; {use_one_of(str(backend), Backend)}")
    options = TrainingOptions(
        yes=True, quiet=not wanted, cache=Path(cache), backend=Backend(backend)
    )
    if isinstance(geometry, Study) and geometry.actuator is not None:
        refuse_cells(geometry.settings, options.backend)
        # training shows its own progress
        with _work(False, workers, parallel=True) as (_, executor):
            try:
                of_study = emulator_for(geometry, None, options=options, executor=executor)
            except Stopped as stop:
                raise KeyboardInterrupt(str(stop)) from stop
        assert of_study is not None
        return of_study
    if isinstance(geometry, Study):
        shape: Moulded = geometry_of_study(geometry.settings)
    else:
        shape = geometry_of(geometry) if isinstance(geometry, AnyDimensions) else geometry
    refuse_whole_range(shape)
    found = find(shape, recipe=options.recipe, cache=options.cache)
    if found.surrogate is not None:
        return found.surrogate
    with _work(progress, workers, parallel=True) as (show, executor):
        campaign = Campaign(shape, options.recipe, SolutionStore(STORE), executor)
        expectation = expect(campaign, show)
        study = rough_seconds(shape.dimensions, shape.constraint, workers=campaign.workers)
        _warn(
            [
                f"training over the whole range takes {duration(expectation.seconds)}; for a "
                f"study, bayesdeg.emulator(study) trains only its own region, in {duration(study)}"
            ]
        )
        trained = train_emulator(campaign, expectation, show)
    write_trained(found.path, trained)
    return trained


def calibrate(
    model: Model,
    *,
    effort: Effort | None = None,
    seed: int | None = None,
    workers: int | None = None,
    progress: bool | None = None,
) -> Calibration:
    """Calibrate a model: mode, evidence, and posterior draws until the criteria are met.

    Parameters
    ----------
    model : Model
        With or without causes.
    effort : {"quick", "standard", "thorough"}, optional
        By default that of the study; ``standard`` for other models.
    seed : int, optional
        By default that of the study; 0 for other models. With the same seed the base model of a
        study is calibrated as by ``bayesdeg run``.
    workers : int, optional
        Number of processes; by default one per core. Your own forward maps and causes run in
        this process.
    progress : bool, optional
        Whether to show progress; by default on a terminal.

    Returns
    -------
    Calibration
        Has ``.posterior`` and ``.summary()``; prints as a table.

    Warns
    -----
    UserWarning
        If your forward map has no finite answer somewhere, or if two calls with the same values
        differ.

    Raises
    ------
    BayesdegError
        If the effort is unknown, or the density is zero at every possible start.

    Examples
    --------
    >>> import bayesdeg as bd
    >>> def hooke(values, x):
    ...     return values["k"][:, None] * x
    >>> readings = bd.Readings([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 8.0])
    >>> k = bd.Parameter("k", bd.LogNormal(2, 1))
    >>> spring = bd.Model([readings], hooke, parameters=[k])
    >>> fit = bd.calibrate(spring, effort="quick", seed=1)
    >>> round(float(fit.summary().loc["k", "mean"]), 1), fit.converged
    (2.0, True)
    """
    if not isinstance(model, Model):
        raise BayesdegError(f"calibrate needs a bayesdeg.Model, not {type(model).__name__}")
    stated = model.settings
    how, number = _effort(effort or stated.sampling.effort), _seed(seed, stated.seed)
    begun, streams, extended = time.perf_counter(), Streams.of(number), None
    if model.assembly.answers is not None:
        _warn(forward_map_words(model.assembly.answers))
    if model.judgement is not None:
        extended = extended_model(model.judgement)
    with _work(progress, workers, parallel=model.is_parallel) as (show, executor):
        fit = calibrate_model(
            model.density,
            "final" if model.causes else "base",
            effort=SAMPLING_EFFORTS[how],
            seed=streams.final if model.causes else streams.base,
            checkpoints=NoCheckpoints(),
            progress=show,
            executor=executor,
            start=None if extended is None else extended[1],
        )
    failed = forward_map_of(Results(model.assembly, fit, fit, None))
    _warn(() if failed is None else forward_map_words(failed))
    return Calibration(model, fit, how, number, round(time.perf_counter() - begun, 2))


def criticise(
    base: Calibration,
    causes: Causes = "all",
    *,
    effort: Effort | None = None,
    seed: int | None = None,
    workers: int | None = None,
    progress: bool | None = None,
) -> Verdict:
    """Find what is wrong with a calibrated model, if anything: one cause, several, or unknown.

    The misfit is compared with that of data simulated from the model. Causes are added while the
    evidence exceeds what chance gives, and held-out specimens must agree.

    Parameters
    ----------
    base : Calibration
        Calibration of a model without causes.
    causes : "all" or list of str or Cause
        Candidates: the catalogue, part of it, or your own causes.
    effort, seed, optional
        Default: those of the calibration.
    workers, progress, optional
        As in `calibrate`.

    Returns
    -------
    Verdict
        ``.outcome``, ``.causes``, ``.candidates``, ``.explanation``, ``.to_dict()``.

    Raises
    ------
    BayesdegError
        If a cause is unknown, there is none to try, or the model already has causes.
    """
    fit = _calibration(base)
    how, number = _effort(effort or fit.effort), _seed(seed, fit.seed)
    model, begun = fit.model, time.perf_counter()
    assembly = model.with_candidates(causes)
    if model.causes:
        raise BayesdegError(
            f"the model already has {', '.join(cause.name for cause in model.active)}, but only a "
            "model without causes is judged: criticise the calibration of the base model"
        )
    with _work(progress, workers, parallel=model.is_parallel_with(assembly)) as (show, executor):
        found = verdict_on(assembly, fit.fit, how, number, progress=show, executor=executor)
    return Verdict(model, *found, assembly.causes, round(time.perf_counter() - begun, 2))


def compare(
    base: Calibration,
    *others: Calibration,
    seed: int | None = None,
    workers: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """Compare how well models predict held-out specimens.

    Parameters
    ----------
    base : Calibration
        The calibration that the others are compared with.
    *others : Calibration
        Calibrations to the same readings.
    seed, workers, progress, optional
        As in `calibrate`.

    Returns
    -------
    DataFrame
        The columns of ``gain.csv``, one row per model and degradation rate and for all rates:
        ``elpd`` and its difference to the base model with standard errors [nats], ``rmse_per_m``,
        ``crps_per_m`` [1/m], ``r_squared``, and coverage of 50 and 90 % intervals. For your own
        readings, ``level``, ``rmse`` and ``crps`` replace them.

    Raises
    ------
    BayesdegError
        If there are too few specimens to leave any out, or readings or names differ.
    """
    fits = {one.model.name: _calibration(one) for one in (base, *others)}
    if len(fits) <= len(others):
        raise BayesdegError("models to compare must differ in their causes")
    parallel = all(one.model.is_parallel for one in fits.values())
    with _work(progress, workers, parallel=parallel) as (show, executor):
        show.stage("held-out specimens", total=float(len(fits)))
        trials = [base_of(one.fit) for one in fits.values()]
        subject = trials[0].subject
        if not can_be_held_out(subject):
            raise BayesdegError(
                "there is no specimen to leave out; name the specimen of each reading, "
                "Readings(..., specimen=), or measure more specimens"
            )
        if any(not np.array_equal(t.subject.observed, subject.observed) for t in trials):
            raise BayesdegError("models that are compared must have the same readings")
        number, kind = _seed(seed, base.seed), base.model.kind
        plans = (one_by_one(trial, kind.fold_seed(Streams.of(number).verdict)) for trial in trials)
        found = run_folds(plans, executor, lambda _: show.advance(1))
    return kind.gain(gain_table(subject, dict(zip(fits, found, strict=True))))


def predict(
    fit: Calibration,
    *,
    pressure: ArrayLike | None = None,
    degradation: ArrayLike | None = None,
    hours: ArrayLike | None = None,
    x: Any = None,
    conditions: ServiceConditions = PROMPT,
    seed: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """Predict the readings of a new specimen.

    Parameters
    ----------
    fit : Calibration
        Calibration of any model.
    pressure, degradation : float or array
        For actuators: pressures as read [kPa] and degradation rates [%], in every combination. In
        a study in which nothing degrades the rate is 0 by default.
    hours : float or array
        Instead of degradation rates: times in the soil [h], converted to rates with the moisture
        of films and its uncertainty.
    x : array or DataFrame
        For your own readings: the inputs of the forward map.
    conditions : ServiceConditions
        For actuators: by default a prompt first loading in a horizontal mount. Active causes
        change predictions under others, such as ``ServiceConditions(hold_s=60, mount="hanging")``.
    seed, progress, optional
        As in `calibrate`.

    Returns
    -------
    DataFrame
        For actuators one row per rate and pressure: curvature as quantiles ``q05`` to ``q95``
        [1/m] without reading error, ``probability`` of rupture with its 90 % interval, the share
        ``answered`` of specimens within the emulator's range, and ``why`` something is missing.
        For other models one row per x: ``mean``, ``sd`` and the same quantiles.

    Warns
    -----
    UserWarning
        If predictions extrapolate beyond the measurements, and for conditions without effect.

    Raises
    ------
    BayesdegError
        If what the model needs is missing or out of range.
    """
    number, others = _seed(seed, _calibration(fit).seed), (pressure, degradation, hours)
    with _work(progress, 1, parallel=False) as (show, _):
        if not fit.model.kind.is_of_actuators:
            if x is None or any(one is not None for one in others):
                raise BayesdegError("a model with its own forward map requires x=...")
            show.stage("predicting")
            return _given(own.predict(fit.drawn, _inputs(x), number))
        if x is not None:
            raise BayesdegError("a model of a study requires pressure=... and degradation=...")
        pressures = _numbers(pressure, "pressure", "kPa")
        levels = _levels(fit, degradation, hours, number, show)
        return _given(
            forecast.predict(
                *(fit.drawn, levels, pressures), seed=number, progress=show, conditions=conditions
            )
        )


def control(
    fit: Calibration,
    *,
    curvature: ArrayLike | None = None,
    degradation: ArrayLike | None = None,
    hours: ArrayLike | None = None,
    max_risk: float = 0.05,
    beyond: bool = False,
    reading: ArrayLike | None = None,
    x: Any = None,
    conditions: ServiceConditions = PROMPT,
    seed: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """Find the pressure for a target curvature at a bounded risk of rupture.

    For your own forward map, find the input that gives a wanted reading; rupture is unknown there,
    so no risk is bounded.

    Parameters
    ----------
    fit : Calibration
        Calibration of a study with actuators, or of your own forward map.
    curvature, degradation : float or array
        Wanted curvatures [1/m] and degradation rates [%], in every combination; rates as in
        `predict`.
    hours : float or array
        Instead of degradation rates, as in `predict` [h].
    max_risk : float
        Largest acceptable probability of rupture.
    beyond : bool
        Whether to allow pressures above the largest tested one, and above those survived by
        actuators that burst at or near the degradation rate.
    reading : float or array
        For your own forward map: wanted readings, without reading error, in their unit.
    x : array, DataFrame or mapping of names to arrays
        Inputs to try, in order; of several, the first is sought and the others vary with it.
    conditions : ServiceConditions
        For actuators, as in `predict`.
    seed, progress, optional
        As in `calibrate`.

    Returns
    -------
    DataFrame
        For actuators one row per combination: ``reached`` or not, the pressure at which half of
        new specimens bend as far, what 90 % of them need, the largest pressure allowed [kPa], the
        curvature there [1/m], the probability of rupture, and ``why`` it is not reached. For other
        models one row per reading: ``reached`` by half of new specimens or not, the input that
        5, 50 and 95 % of them need (``needed_q05`` to ``needed_q95``), and the ``share`` that
        reaches it.

    Warns
    -----
    UserWarning
        If a pressure or degradation rate lies outside the measurements, and for conditions
        without effect.

    Raises
    ------
    BayesdegError
        If a value is out of range, or the model is not of actuators.
    """
    number = _seed(seed, _calibration(fit).seed)
    _refuse_risk(max_risk)
    if not fit.model.kind.is_of_actuators:
        others = (curvature, degradation, hours)
        if reading is None or x is None or any(one is not None for one in others):
            raise BayesdegError(
                "a model with its own forward map has no pressure and no curvature: use "
                "control(fit, reading=..., x=...) with the wanted reading and the inputs to try"
            )
        values = np.atleast_1d(np.asarray(reading, dtype=np.float64))
        if not np.all(np.isfinite(values)):
            raise BayesdegError(f"reading must be finite numbers, not {reading}")
        return _given(own.control(fit.drawn, values, _inputs(x), number))
    if reading is not None or x is not None:
        raise BayesdegError("a model of a study requires curvature=... and degradation=...")
    wanted = _numbers(curvature, "curvature", "1/m", low=np.nextafter(0.0, 1.0))
    with _work(progress, 1, parallel=False) as (show, _):
        found = forecast.control(
            *(fit.drawn, _levels(fit, degradation, hours, number, show), wanted),
            risk=max_risk,
            beyond=beyond,
            seed=number,
            progress=show,
            conditions=conditions,
        )
    return _given(found)


def lifetime(
    fit: Calibration,
    *,
    pressure: float,
    curvature: float,
    max_risk: float = 0.05,
    hours: ArrayLike | None = None,
    beyond: bool = False,
    conditions: ServiceConditions = PROMPT,
    seed: int | None = None,
    progress: bool | None = None,
) -> pd.DataFrame:
    """Predict the service life of actuators in the soil and the pressure that keeps a curvature.

    An actuator fails when it bursts at the given pressure, or bends less than asked.

    Parameters
    ----------
    fit : Calibration
        Calibration of a study with actuators and the moisture of films against time in the soil.
    pressure, curvature : float
        The duty: gauge pressure [kPa] and the curvature required at it [1/m].
    max_risk : float
        Largest acceptable probability of rupture if the pressure is raised.
    hours : array, optional
        Times in the soil, at least two; by default up to the last film's [h].
    beyond : bool
        Whether pressures above those tested are allowed, as in `control`.
    conditions, seed, progress, optional
        As in `control`.

    Returns
    -------
    DataFrame
        The columns of ``lifetime.csv``, one row per time. Its ``attrs`` have a ``summary`` in
        words, ``time_to_failure_q05_h``, ``_q50_h`` and ``_q95_h`` over new actuators, and
        ``last_reachable_...`` likewise; None if it does not happen within the times.

    Warns
    -----
    UserWarning
        If something lies outside the measurements, and for conditions without effect.

    Raises
    ------
    BayesdegError
        If a value is out of range, or the study has no course of degradation.
    """
    if not _calibration(fit).model.kind.is_of_actuators:
        raise BayesdegError("a model with its own forward map has no lifetime in the soil")
    _refuse_risk(max_risk)
    above = np.nextafter(0.0, 1.0)
    at = _numbers(pressure, "pressure", "kPa", low=above)
    [wanted] = _numbers(curvature, "curvature", "1/m", low=above)[:1]
    times = None if hours is None else _numbers(hours, "hours", "h")
    if times is not None and len(times) == 1:
        raise BayesdegError(
            f"hours {times[0]:g} is a single time, but a lifetime needs several; give at least two"
        )
    with _work(progress, 1, parallel=False) as (show, _):
        soil, drawn = fit.soil(show), fit.drawn
        found = lives.lifetime(
            *(drawn, soil, lives.Duty(float(at[0]), float(wanted), max_risk)),
            lives.default_hours(drawn.measured) if times is None else times,
            beyond=beyond,
            seed=_seed(seed, fit.seed),
            progress=show,
            conditions=conditions,
        )
    table = _given(found)
    table.attrs.update(found.summary, summary=found.headline)
    return table


def _given(answer: forecast.Forecast) -> pd.DataFrame:
    """Return the table of an answer, and warn its user."""
    _warn(answer.messages, depth=4)
    return answer.table


def _refuse_risk(risk: float) -> None:
    if not 0.0 < risk < 1.0:
        raise BayesdegError(
            f"max_risk {risk:g} is out of range; give a probability between 0 and 1"
        )


def _levels(
    fit: Calibration,
    degradation: ArrayLike | None,
    hours: ArrayLike | None,
    seed: int,
    progress: Progress,
) -> tuple[Level, ...]:
    """Return degradation rates, given or derived from hours in the soil."""
    if degradation is not None and hours is not None:
        raise BayesdegError("give either degradation= or hours=, not both")
    if hours is not None:
        return forecast.levels_after(_numbers(hours, "hours", "h"), fit.soil(progress), seed)
    if degradation is None and not fit.fit.model.world.degrades:
        degradation = 0.0
    return known_levels(_numbers(degradation, "degradation", "%", high=100.0))


def _inputs(x: Any) -> Any:
    """Return inputs as a mapping of columns or as an array."""
    if isinstance(x, (pd.DataFrame, Mapping)):
        return x
    return np.asarray(list(x), dtype=np.float64)


def report(
    path: Path | str,
    base: Calibration,
    final: Calibration | None = None,
    verdict: Verdict | None = None,
    *,
    full: bool = True,
    workers: int | None = None,
    progress: bool | None = None,
) -> Report:
    """Write a run folder and its page, as ``bayesdeg run`` does.

    Parameters
    ----------
    path : Path
        The folder; created if needed, refused if it holds something else.
    base : Calibration
        Calibration of the base model.
    final : Calibration, optional
        Of the model with the causes of the verdict; that of the base model by default.
    verdict : Verdict
        Verdict on the base model.
    full : bool
        Whether to compute also the checks of the calibration, the analysis of the films alone and
        the deformed actuators, which takes about a minute; otherwise the page notes their absence.
    workers, progress, optional
        As in `calibrate`.

    Returns
    -------
    Report
        Prints the path of the page; a link in a notebook.

    Raises
    ------
    BayesdegError
        If calibrations and verdict do not match, or the folder cannot be written to.
    """
    model = _calibration(base).model
    last = base if final is None else _calibration(final)
    if verdict is None:
        raise BayesdegError("a report needs a verdict: report(path, base, final, verdict)")
    if verdict.model is not model:
        raise BayesdegError("the verdict is of a different model from the base calibration")
    with _work(progress, workers, parallel=model.is_parallel) as (show, executor):
        return write_run(Path(path), base, last, verdict, show, executor, full=full)


def update(
    run: Path | str | Report | Update,
    new: Path | str | pd.DataFrame,
    *,
    out: Path | str | None = None,
    emulator: Path | str | None = None,
    seed: int | None = None,
    progress: bool | None = None,
) -> Update:
    """Add further actuator readings to a finished run in seconds, as ``bayesdeg update`` does.

    The new readings reweight the draws of the run's posterior; if few of them carry the weight, a
    distribution is fitted to these and sampled with all readings. The run is not changed: a new
    run folder is written, with posteriors, bands, ruptures, decisions, lifetime and shares from all
    readings. The verdict is not updated.

    Parameters
    ----------
    run : Path or Report
        The run folder; its study must still be in its place and unchanged.
    new : Path or DataFrame
        Rows of ``actuator.csv`` for new or earlier specimens: a CSV file or its columns.
    out : Path, optional
        The new run folder; by default that of the run with ``_updated`` appended.
    emulator : Path, optional
        File of the emulator that the run was given, if any.
    seed, progress, optional
        As in `calibrate`.

    Returns
    -------
    Update
        Has ``.folder``, ``.summary()`` and ``.posterior``; prints the parameters that moved most.

    Raises
    ------
    StudyError
        Lists every fault of the new rows.
    BayesdegError
        If the run cannot be updated, or the new folder is in use.
    """
    if isinstance(new, pd.DataFrame):
        name, content = "rows", new.to_csv(index=False).encode()
    else:
        name, content = Path(new).name, read_new(Path(new))
    with _work(progress, 1, parallel=False) as (show, _):
        return update_run(
            Path(run),
            content,
            name,
            out=None if out is None else Path(out),
            seed=None if seed is None else _seed(seed, 0),
            emulator=None if emulator is None else Path(emulator),
            progress=show,
        )


def _calibration(given: object) -> Calibration:
    if not isinstance(given, Calibration):
        raise BayesdegError(f"give the result of calibrate(model), not {type(given).__name__}")
    return given


def _effort(name: str) -> Effort:
    if name not in EFFORTS:
        raise BayesdegError(f"unknown effort {name!r}; {use_one_of(name, EFFORTS)}")
    return name


def _seed(given: int | None, default: int) -> int:
    seed = default if given is None else given
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise BayesdegError(f"seed must be a whole number of at least 0, not {seed!r}")
    return int(seed)


def _numbers(
    values: ArrayLike | None, name: str, unit: str, *, low: float = 0.0, high: float = np.inf
) -> Floats:
    """Return sorted numbers without duplicates."""
    if values is None:
        raise BayesdegError(f"a model of a study requires {name}= [{unit}]")
    found = np.unique(np.atleast_1d(np.asarray(values, dtype=np.float64)))
    if not len(found) or not np.all(np.isfinite(found) & (found >= low) & (found <= high)):
        limit = f" and at most {high:g}" if np.isfinite(high) else ""
        least = "above 0" if 0.0 < low < 1e-300 else f"of at least {low:g}"
        raise BayesdegError(f"{name} must be finite numbers {least}{limit} [{unit}]: {values}")
    return found


def _warn(messages: Iterable[str], *, depth: int = 3) -> None:
    for message in messages:
        warnings.warn(message, UserWarning, stacklevel=depth)


@contextmanager
def _work(
    progress: bool | None, workers: int | None, *, parallel: bool
) -> Iterator[tuple[Progress, Executor | None]]:
    """Show progress, and start worker processes if useful."""
    count = workers if workers is not None else os.cpu_count() or 1
    if count < 1:
        raise BayesdegError(f"workers must be 1 or more, not {workers}")
    wanted = can_show_bars() if progress is None else progress
    with ExitStack() as stack:
        show = stack.enter_context(shown(not wanted))
        executor = None
        if parallel:
            executor = stack.enter_context(kept_processes(count))
        yield show, executor
