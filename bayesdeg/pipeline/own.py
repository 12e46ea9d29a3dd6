"""Readings and a forward map of one's own, as the verbs of the library ask them.

Readings are y = f(θ, x) + s a + e: f the forward map, e ~ N(0, σ²) the reading error, and, where
specimens differ, one deviation a ~ N(0, 1) of each specimen, which moves all of its readings by s.
"""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from arviz_base import from_dict
from numpy.typing import ArrayLike, NDArray

from bayesdeg.causes.cause import Cause, Effect
from bayesdeg.criticism.fit.trials import Trial, base_trial
from bayesdeg.criticism.posterior.convergence import Convergence
from bayesdeg.data.settings import Effort
from bayesdeg.errors import BayesdegError, use_one_of
from bayesdeg.inference.laplace import Evidence, Laplace
from bayesdeg.inference.model import Model
from bayesdeg.inference.sampling import EFFORTS, Chain
from bayesdeg.observations import readings as flat
from bayesdeg.observations.kinds import Places, joined_places
from bayesdeg.observations.readings import Formula, places_of
from bayesdeg.pipeline.calibrate import fitted
from bayesdeg.pipeline.experiment import Judged, Written
from bayesdeg.pipeline.judge import JUDGE_EFFORTS, OWN_MAP, Judgement, judge_model
from bayesdeg.pipeline.progress import Progress
from bayesdeg.pipeline.record import verdict_document
from bayesdeg.pipeline.run import Streams
from bayesdeg.pipeline.summary import summary
from bayesdeg.priors import HalfNormal, Law, Named, Parameter
from bayesdeg.report.checkpoints import NoCheckpoints
from bayesdeg.report.record import Verdict
from bayesdeg.report.tables import ALL_LEVELS

Floats = NDArray[np.float64]
Forward = Callable[[dict[str, Floats], Any], ArrayLike]

EFFORTS_OF_SEARCH = JUDGE_EFFORTS | {"standard": OWN_MAP}
SHARE_OF_SPREAD = 0.5
"""Scale of the default prior of a reading error, of the standard deviation of all readings: 95 % of
it is then below the error that a model which explains nothing would leave."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
PREDICTIVE = 2000  # draws
PROBED = 3  # vectors with which a forward map is tried


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of one kind: what was set, and what was read.

    Parameters
    ----------
    x : array, shape (n,), or DataFrame with n rows
        What the experiment set; handed to the forward map as it is. Misfits are looked for along
        it, or along the first column of a frame.
    y : array, shape (n,)
        What was read.
    specimen : array, shape (n,), optional
        Whose reading it is: readings of one specimen are held out together. By default each
        reading is of a specimen of its own.
    name, unit : str
        What was read, and its unit.
    error : float, array, Law or None
        Standard deviation of a reading: known, with a prior of its own, or, by default, a parameter
        ``<name>_error`` with the prior HalfNormal(sd(y)/2), 95 % of which lies below the standard
        deviation of all readings, which a model that explains nothing would leave as error.
    scatter : bool or Law
        Whether specimens differ: a parameter ``<name>_scatter``, the standard deviation by which
        all readings of a specimen are shifted together; its default prior is that of the error.
    level, time, history : array, optional
        What was set for the whole specimen; when a reading was taken; how it was loaded. Misfits
        are looked for along these as well.

    Raises
    ------
    BayesdegError
        If shapes do not go together, or a reading is no finite number.

    Examples
    --------
    >>> Readings([1.0, 2.0, 3.0], [2.1, 3.9, 6.2], unit="mm").y.tolist()
    [2.1, 3.9, 6.2]
    """

    x: Any
    y: Any
    specimen: Any = None
    name: str = "reading"
    unit: str = "–"
    error: float | ArrayLike | Law | None = None
    scatter: bool | Law = False
    level: Any = 0.0
    time: Any = np.nan
    history: Any = "once"

    def __post_init__(self) -> None:
        """Bring readings to arrays, and refuse what does not go together."""
        y = np.asarray(self.y, dtype=np.float64)
        x = self.x if isinstance(self.x, pd.DataFrame) else np.asarray(self.x, dtype=np.float64)
        if y.ndim != 1 or not len(y) or not np.all(np.isfinite(y)):
            raise BayesdegError(f"{self.name}: y must be finite numbers along one axis")
        if np.ndim(x) == 0 or len(x) != len(y):
            count = "a single number" if np.ndim(x) == 0 else f"{len(x)} rows"
            raise BayesdegError(f"{self.name}: x has {count}, and y has {len(y)} readings")
        for other in ("specimen", "level", "time", "history"):
            value = getattr(self, other)
            if value is not None and np.shape(value) not in ((), y.shape):
                raise BayesdegError(
                    f"{self.name}: {other} has shape {np.shape(value)}, and y {y.shape}"
                )
        if isinstance(self.error, (bool, str)):
            raise BayesdegError(f"{self.name}: error must be a number, an array or a prior law")
        known = None if self.error is None or isinstance(self.error, Law) else self.error
        if known is not None and not np.all(np.asarray(known, dtype=np.float64) > 0.0):
            raise BayesdegError(f"{self.name}: error must be above 0, not {self.error}")
        object.__setattr__(self, "x", x)
        object.__setattr__(self, "y", y)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The parameters that the readings add: of error and scatter, where they are not known."""
        found = []
        if self.error is None or isinstance(self.error, Law):
            meaning = f"reading error of {self.name}, standard deviation"
            law = self.error if isinstance(self.error, Law) else self._default()
            found.append(Parameter(f"{self.name}_error", law, self.unit, meaning))
        if self.scatter is not False:
            meaning = f"shift of {self.name} from specimen to specimen, standard deviation"
            law = self.scatter if isinstance(self.scatter, Law) else self._default()
            found.append(Parameter(f"{self.name}_scatter", law, self.unit, meaning))
        return tuple(found)

    def _default(self) -> Law:
        spread = float(np.std(self.y))
        if spread == 0.0:
            raise BayesdegError(
                f"{self.name}: readings that are all alike say nothing of their error; give error="
            )
        return HalfNormal(SHARE_OF_SPREAD * spread)

    @property
    def places(self) -> Places:
        """Where the readings stand."""
        x = self.x.iloc[:, 0] if isinstance(self.x, pd.DataFrame) else self.x
        along = np.asarray(x, dtype=np.float64).reshape(len(self.y), -1)[:, 0]
        own = [f"{self.name} {number}" for number in range(1, len(self.y) + 1)]
        specimen = own if self.specimen is None else np.asarray(self.specimen).astype(np.str_)
        return places_of(
            along,
            kind=self.name,
            specimen=np.broadcast_to(specimen, self.y.shape),
            level=self.level,
            time=self.time,
            history=self.history,
        )


@dataclass(frozen=True)
class OwnFit:
    """A calibrated model; fields as in `bayesdeg.pipeline.calibrate.Fit`."""

    model: Model
    laplace: Laplace
    evidence: Evidence
    chain: Chain
    diagnosis: Convergence


@dataclass(frozen=True)
class _Asked:
    """What the forward map is asked: values by name (k,), and what each kind of readings was at."""

    values: dict[str, Floats]
    x: tuple[Any, ...]

    @property
    def count(self) -> int:
        """The number of vectors k."""
        return max(map(len, self.values.values()))


@dataclass(frozen=True, eq=False)
class OwnExperiment:
    """Readings, a forward map of one's own, and the causes that are active.

    Parameters
    ----------
    readings : tuple of Readings
        Of one kind or several.
    forward : callable or mapping
        From values by name (k,) and x to predicted readings (k, n); by the names of the readings
        where there are several kinds.
    parameters : tuple of Parameter
        Of the forward map.
    catalogue : tuple of Cause
        All that may be named.
    causes : tuple of Cause
        Active ones.
    """

    readings: tuple[Readings, ...]
    forward: Mapping[str, Forward]
    parameters: tuple[Parameter, ...]
    catalogue: tuple[Cause, ...] = ()
    causes: tuple[Cause, ...] = ()

    effort: Effort = "standard"
    seed: int = 0
    is_parallel = False
    """Functions that a script or notebook defines are not known to other processes."""

    @classmethod
    def of(
        cls,
        readings: Readings | Iterable[Readings],
        forward: Forward | Mapping[str, Forward] | None,
        parameters: Iterable[Parameter],
        catalogue: Iterable[Cause],
        active: Iterable[Cause | str],
    ) -> "OwnExperiment":
        """Check that readings, forward map and parameters go together.

        Raises
        ------
        BayesdegError
            If something is missing, has another type, or has the wrong shape.
        """
        blocks = (readings,) if isinstance(readings, Readings) else tuple(readings)
        wrong = [type(block).__name__ for block in blocks if not isinstance(block, Readings)]
        if wrong or not blocks:
            raise BayesdegError(
                "a Model is of a study, or of a list of Readings and a forward map, not of "
                f"{', '.join(wrong) or 'an empty list'}"
            )
        maps = _maps(blocks, forward)
        base = cls(blocks, maps, tuple(parameters), tuple(catalogue))
        found = replace(base, causes=tuple(base.cause(one) for one in active))
        found._probe()
        return found

    @property
    def density(self) -> Model:
        """What is sampled, and judged."""
        extra = [parameter for block in self.readings for parameter in block.parameters]
        places = [block.places for block in self.readings]
        try:
            read = flat.Readings(
                np.concatenate([block.y for block in self.readings]),
                joined_places(places),
                error=partial(self._sizes, "error"),
                conditions=tuple(block.x for block in self.readings),
                common=partial(self._sizes, "scatter"),
            )
            formula = Formula(self._predicted, _asked, _side_by_side)
            model = Model((*self.parameters, *extra), (read,), formula)
            return model.extended(*map(_of_blocks, self.causes)) if self.causes else model
        except ValueError as fault:
            raise BayesdegError(str(fault)) from fault

    def _predicted(self, asked: _Asked, conditions: tuple[Any, ...]) -> tuple[Floats, ...]:
        found = []
        for block, x in zip(self.readings, asked.x, strict=True):
            answer = np.asarray(self.forward[block.name](asked.values, x), dtype=np.float64)
            shape = (asked.count, len(block.y))
            if answer.shape != shape:
                raise BayesdegError(
                    f"forward must return {block.name} of shape {shape}, one row for each of the "
                    f"values and one column for each reading, not {answer.shape}; write "
                    "values[name][:, None] to let values stand against x"
                )
            found.append(answer)
        return tuple(found)

    def _sizes(self, what: str, values: Named, readings: Floats) -> Floats:
        """Return standard deviations of error or scatter, (k, n)."""
        columns = []
        for block in self.readings:
            name, known = f"{block.name}_{what}", getattr(block, what)
            if name in values:
                size = values[name]
            else:
                size = np.asarray(0.0 if known is False else known, dtype=np.float64)
            columns.append(np.broadcast_to(size, (len(readings), len(block.y))))
        return np.concatenate(columns, axis=1)

    def _probe(self) -> None:
        """Ask the forward map once, so that a wrong shape is told before anything is computed."""
        model = self.density
        count = PROBED + (PROBED in {len(block.y) for block in self.readings})
        model.expected(model.table.sample(np.random.default_rng(0), count))

    @property
    def title(self) -> str:
        """What it is of, in words."""
        return ", ".join(block.name for block in self.readings)

    def cause(self, given: Cause | str) -> Cause:
        """Return a cause of one's own, by itself or by its name.

        Raises
        ------
        BayesdegError
            If there is none of that name.
        """
        known = {cause.name: cause for cause in (*self.catalogue, *self.causes)}
        if isinstance(given, Cause):
            return given
        if given not in known:
            remedy = use_one_of(given, known) if known else "give the bayesdeg.Cause itself"
            raise BayesdegError(f"there is no cause {given!r} of this model; {remedy}")
        return known[given]

    def with_candidates(self, causes: str | Iterable[Cause | str]) -> "OwnExperiment":
        """Return the experiment with other candidates: ``all`` of its catalogue, or a list."""
        if causes == "all":
            wanted = self.catalogue
        else:
            given = [causes] if isinstance(causes, str) else causes
            wanted = tuple(self.cause(one) for one in given)
        if not wanted:
            raise BayesdegError(
                "a model with a forward map of its own has no causes that could be named; give "
                "them as criticise(fit, causes=[...]), or as Model(..., catalogue=[...])"
            )
        return replace(self, catalogue=wanted)

    def fit(
        self, effort: Effort, seed: int, progress: Progress, executor: Executor | None
    ) -> OwnFit:
        """Calibrate the model."""
        model, streams = self.density, Streams.of(seed)
        return OwnFit(
            model,
            *fitted(
                model,
                "final" if self.causes else "base",
                effort=EFFORTS[effort],
                seed=streams.final if self.causes else streams.base,
                checkpoints=NoCheckpoints(),
                progress=progress,
                executor=executor,
            ),
        )

    def posterior(self, fit: OwnFit, effort: Effort, seed: int) -> xr.DataTree:
        """Return kept draws, what they say of every specimen and predict of every reading."""
        chain, model = fit.chain.thinned(EFFORTS[effort].kept), fit.model
        ensembles, steps, walkers, size = chain.vectors.shape
        vectors = chain.vectors.reshape(-1, size)
        lead = (ensembles, steps * walkers)
        generator = np.random.default_rng(np.random.SeedSequence([seed, 1]))
        named = {"reading": ["observation"], "joint": ["specimen"], "x": ["observation"]}
        groups = {
            "posterior": {n: v.reshape(lead) for n, v in model.table.named(vectors).items()},
            "sample_stats": {"lp": chain.log_prob.reshape(lead)},
            "log_likelihood": {"joint": model.group_density(vectors).reshape(*lead, -1)},
            "posterior_predictive": {
                "reading": model.simulated(vectors, generator).reshape(*lead, -1)
            },
            "observed_data": {"reading": model.observed},
            "constant_data": {"x": model.places.along},
        }
        tree: xr.DataTree = from_dict(
            groups, coords={"specimen": np.array(model.groups)}, dims=named
        )
        labels = {
            "specimen_id": ("observation", model.places.specimen),
            "kind": ("observation", model.places.kind),
        }
        for name in ("posterior_predictive", "observed_data", "constant_data"):
            tree[name] = xr.DataTree(tree[name].to_dataset().assign_coords(labels))
        return tree

    def judge(
        self, fit: OwnFit, effort: Effort, seed: int, progress: Progress, executor: Executor | None
    ) -> Judged:
        """Judge the model: its misfit, the causes alone and together, readings held out."""
        if self.causes:
            names = ", ".join(cause.name for cause in self.causes)
            raise BayesdegError(
                f"the model has {names} already, and a verdict is of a model without causes: "
                "criticise the calibration of the base model"
            )
        progress.stage("misfit, causes and held-out specimens")
        found = judge_model(
            fit.model,
            tuple(map(_of_blocks, self.catalogue)),
            seed=seed,
            effort=EFFORTS_OF_SEARCH[effort],
        )
        return Judged(_document(found), self.catalogue, found)

    def trial(self, fit: OwnFit) -> Trial:
        """Return the calibration as what groups of readings can be left out of."""
        return base_trial(fit.model, fit.laplace.mode, fit.evidence)

    def folds(self, seed: int) -> np.random.SeedSequence:
        """Return the seed with which a verdict holds out what the model is fitted to."""
        return np.random.SeedSequence(seed).spawn(2)[1]

    def tidy(self, gain: pd.DataFrame) -> pd.DataFrame:
        """Return held-out scores by level, in the unit of the first kind of readings."""
        plain = {"rmse_per_m": "rmse", "crps_per_m": "crps", "degradation_pct": "level"}
        several = gain["degradation_pct"].nunique() > 2
        rows = gain if several else gain[gain["degradation_pct"] == ALL_LEVELS]
        return rows.rename(columns=plain).reset_index(drop=True)

    def predict(
        self, fit: OwnFit, effort: Effort, seed: int, progress: Progress, *, x: Any
    ) -> pd.DataFrame:
        """Return what a new specimen would show at x, without reading error."""
        chain = fit.chain.thinned(EFFORTS[effort].kept)
        generator = np.random.default_rng(np.random.SeedSequence([seed, 1]))
        flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
        vectors = flat[generator.integers(len(flat), size=PREDICTIVE)]
        frames = []
        progress.stage("predicting", total=float(len(self.readings)))
        for block in self.readings:
            at = replace(block, x=x, y=np.zeros(len(x)), specimen=None, error=1.0, scatter=False)
            at = replace(at, level=0.0, time=np.nan, history="once")
            alone = replace(self, readings=(at,), parameters=fit.model.base, causes=())
            model = alone.density.extended(*fit.model.causes)
            mean = model.expected(vectors)
            scatter = fit.model.table.named(vectors).get(f"{block.name}_scatter")
            if scatter is not None:
                mean = mean + (scatter * generator.standard_normal(PREDICTIVE))[:, None]
            frames.append(_bands(block, at, mean))
            progress.advance(1, block.name)
        return pd.concat(frames, ignore_index=True)

    def control(self, *_: Any, **__: Any) -> pd.DataFrame:
        """Refuse: a pressure for a curvature is asked of actuators.

        Raises
        ------
        BayesdegError
            Always.
        """
        raise BayesdegError(
            "control finds the pressure of an actuator, and this model has a forward map of its "
            "own; look for the x that is wanted in predict(fit, x=...)"
        )

    def extrapolations(self, *_: Floats) -> tuple[str, ...]:
        """Say nothing: what is outside is for the user to know."""
        return ()

    def write(
        self,
        path: Path,
        base: Written,
        final: Written,
        judged: tuple[Judged, float] | None,
        progress: Progress,
        executor: Executor | None,
        *,
        full: bool,
    ) -> Path:
        """Refuse: the page is of actuators and films.

        Raises
        ------
        BayesdegError
            Always.
        """
        raise BayesdegError(
            "a report of a forward map of one's own cannot be written yet; keep "
            "fit.posterior.to_netcdf(...), fit.summary() and verdict.to_dict()"
        )


def _maps(
    blocks: tuple[Readings, ...], forward: Forward | Mapping[str, Forward] | None
) -> Mapping[str, Forward]:
    names = [block.name for block in blocks]
    if len(set(names)) < len(names):
        raise BayesdegError(
            f"several kinds of readings need names of their own, Readings(..., name=), not {names}"
        )
    if isinstance(forward, Mapping):
        missing = [name for name in names if not callable(forward.get(name))]
        if missing:
            raise BayesdegError(f"forward has no function for {', '.join(missing)}")
        return forward
    if not callable(forward):
        raise BayesdegError("readings need a forward map: Model([...], forward=function)")
    if len(names) > 1:
        raise BayesdegError(
            f"there are several kinds of readings: give forward={{{names[0]!r}: function, ...}}"
        )
    return {names[0]: forward}


def _asked(values: Named, conditions: tuple[Any, ...]) -> _Asked:
    return _Asked({name: value[:, 0] for name, value in values.items()}, conditions)


def _side_by_side(readings: tuple[Floats, ...]) -> Floats:
    return np.concatenate(readings, axis=1)


def _of_blocks(cause: Cause) -> Cause:
    """Return a cause whose hooks act on every kind of readings in turn.

    One without hooks acts through its parameters, which the forward map is given by name.
    """
    hooks: dict[str, Any] = {"on_inputs": partial(_on_inputs, cause.on_inputs)}
    if cause.on_reading is not None:
        hooks["on_reading"] = partial(_on_readings, cause.on_reading)
    return replace(cause, **hooks)


def _on_inputs(
    hook: Callable[..., Any] | None, asked: _Asked, recorded: tuple[Any, ...], effect: Effect
) -> _Asked:
    if hook is None:
        return asked
    pairs = zip(asked.x, recorded, strict=True)
    return replace(asked, x=tuple(hook(x, before, effect) for x, before in pairs))


def _on_readings(
    hook: Callable[..., Any],
    readings: tuple[Floats, ...],
    recorded: tuple[Any, ...],
    effect: Effect,
) -> tuple[Floats, ...]:
    pairs = zip(readings, recorded, strict=True)
    return tuple(np.asarray(hook(one, at, effect), dtype=np.float64) for one, at in pairs)


def _bands(block: Readings, at: Readings, draws: Floats) -> pd.DataFrame:
    """Return quantiles of predictions (k, n), a row for each x."""
    x = at.x if isinstance(at.x, pd.DataFrame) else pd.DataFrame({"x": at.places.along})
    low = {f"q{round(100 * q):02d}": np.nanquantile(draws, q, axis=0) for q in QUANTILES}
    numbers = {"mean": np.nanmean(draws, axis=0), "sd": np.nanstd(draws, axis=0)}
    answered = np.mean(np.isfinite(draws), axis=0)
    return x.reset_index(drop=True).assign(
        kind=block.name, unit=block.unit, **numbers, **low, answered=answered
    )


def _document(found: Judgement) -> Verdict:
    """Return the content of ``verdict.json``."""
    known = {cause.name: cause.mechanism for cause in found.search.causes}
    document = verdict_document(found, "", explanation=_explanation(found, summary(found)))
    candidates = (
        entry.model_copy(update={"mechanism": known.get(entry.cause, "")})
        for entry in document.candidates
    )
    return document.model_copy(update={"candidates": tuple(candidates)})


def _explanation(found: Judgement, whole: dict[str, Any]) -> str:
    """Say what the verdict rests on."""
    base, left = whole["misfit"]["p_value"], whole["misfit_left"]["p_value"]
    said = [f"The misfit of the model without a cause has p = {base:.2g}."]
    for one in found.supported:
        gain = ""
        if one.elpd_diff is not None:
            gain = f", and readings held out are predicted better by {one.elpd_diff:.1f}"
            gain += f" ± {one.elpd_diff_se:.1f} in log density" if one.elpd_diff_se else ""
        said.append(
            f"{one.cause} has a log Bayes factor of {one.log_bayes_factor:.1f}, where naming takes "
            f"{whole['threshold']:.1f}{gain}; with it the misfit has p = {left:.2g}."
        )
    said += [f"Not named: {reason}." for reason in whole["reasons"]]
    if not found.supported:
        said.append("No cause has enough evidence to be named.")
    return " ".join(said)
