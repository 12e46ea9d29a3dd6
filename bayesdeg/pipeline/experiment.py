"""A study, or readings with a user's forward map, behind the public functions."""

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.reading import mechanics_of
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.checks.residuals import predict_readings
from bayesdeg.criticism.fit.trials import Trial
from bayesdeg.data.plausibility import doubts, refuse_impossible
from bayesdeg.data.settings import Settings
from bayesdeg.data.study import Study
from bayesdeg.emulator.kept import refuse_whole_range
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.trained import find as find_emulator
from bayesdeg.errors import BayesdegError, use_one_of
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.inference.tree import to_datatree
from bayesdeg.pipeline import forecast, formula
from bayesdeg.pipeline.aside import set_aside
from bayesdeg.pipeline.assemble import Assembly, assemble, assemble_own
from bayesdeg.pipeline.averaged import Averaged
from bayesdeg.pipeline.calibrate import Fit, base_of, calibrate
from bayesdeg.pipeline.experience import experience_of
from bayesdeg.pipeline.films import course_of
from bayesdeg.pipeline.forecast import Caution, Drawn, model_document
from bayesdeg.pipeline.formula import DrawnFormula, OwnMap, cause_of, probe
from bayesdeg.pipeline.judge import Judgement, extended_model, with_sampled_sizes
from bayesdeg.pipeline.lifetime import (
    allowed_at_ends,
    default_hours,
    life_summary,
    life_table,
    lifetime_of,
)
from bayesdeg.pipeline.outline import outline
from bayesdeg.pipeline.output import run_folder
from bayesdeg.pipeline.progress import Progress
from bayesdeg.pipeline.record import Results, forward_map_of, in_doubt, verdict_of
from bayesdeg.pipeline.run import (
    Clock,
    Streams,
    add_page,
    can_be_judged,
    conclude,
    judged_fit,
    judged_with_suspects,
    with_average,
    with_counts,
    with_options,
)
from bayesdeg.pipeline.suspects import assemble_screened
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.lifetime import Duty
from bayesdeg.prediction.soil import Level, Soil
from bayesdeg.priors import Parameter
from bayesdeg.quantities import Effort
from bayesdeg.report.checkpoints import NoCheckpoints
from bayesdeg.report.headline import forward_map_words
from bayesdeg.report.left_out import Guard
from bayesdeg.report.record import ModelEntry, VerdictRecord
from bayesdeg.report.tables import ALL_LEVELS

Floats = NDArray[np.float64]

MOST_OF_ONE_LEVEL = 2  # rows per model: its one level, and all levels pooled
SCORED_FIRST = ("model", "level", "elpd", "elpd_se", "elpd_diff", "elpd_diff_se", "rmse", "crps")
SCORED_ELSE = ("rmse_per_m", "crps_per_m")


@dataclass(frozen=True)
class Judged:
    """The parts of a verdict.

    Parameters
    ----------
    document : VerdictRecord
        The content of ``verdict.json``.
    causes : tuple of Cause
        All that were tried.
    judgement : object
        What it rests on; None where there was nothing to judge.
    """

    document: VerdictRecord
    causes: tuple[Cause, ...]
    judgement: Any = None


@dataclass(frozen=True)
class Written:
    """A calibration for a report.

    Parameters
    ----------
    fit : Fit
        The calibration.
    effort, seed, seconds
        How it was made, and how long it took [s].
    """

    fit: Any
    effort: Effort
    seed: int
    seconds: float


@dataclass(frozen=True)
class ModelledExperiment:
    """A study with its base model and active causes.

    Parameters
    ----------
    study : Study
        Checked; of readings in a script it holds a title alone.
    assembly : Assembly
        Base model and candidates.
    causes : tuple of Cause
        Active ones.
    judgement : Judgement, optional
        The verdict that they follow from, where the model is that of the verdict.
    """

    study: Study
    assembly: Assembly
    causes: tuple[Cause, ...] = ()
    judgement: Judgement | None = None

    @classmethod
    def of(
        cls, study: Study, forward: ForwardMap | None, active: Iterable[Cause | str]
    ) -> "ModelledExperiment":
        """Check a study for impossible data, and build its models.

        Raises
        ------
        StudyError
            If what was recorded is impossible, or a prior is of no known parameter.
        BayesdegError
            If no emulator of the geometry is to be had, or a cause does not exist.
        """
        if study.settings.forward is not None:
            return cls._with(study, assemble(study), active)
        plan = outline(study, emulated=forward is None or isinstance(forward, Surrogate))
        refuse_impossible(doubts(study, plan.expected))
        if forward is None and plan.needs_forward:
            forward = _known_emulator(study)
        assembly = assemble_screened(study, forward)
        return cls._with(assembly.study or study, assembly, active)

    @classmethod
    def of_readings(
        cls,
        own: OwnMap,
        parameters: Iterable[Parameter],
        catalogue: Iterable[Cause],
        active: Iterable[Cause | str],
    ) -> "ModelledExperiment":
        """Build the model of readings and a user's forward map.

        Raises
        ------
        BayesdegError
            If something is missing, has another type, or has the wrong shape.
        """
        settings = Settings(title=own.title, seed=0)
        named = Study(own.title, Path(own.title), settings)
        return cls._with(named, assemble_own(own, parameters, catalogue), active)

    @classmethod
    def _with(
        cls, study: Study, assembly: Assembly, active: Iterable[Cause | str]
    ) -> "ModelledExperiment":
        base = cls(study, assembly)
        found = replace(base, causes=tuple(base.cause(one) for one in active))
        if assembly.own is not None and found.causes:
            probe(found.density)
        return found

    @property
    def own(self) -> OwnMap | None:
        """The user's forward map, if any."""
        return self.assembly.own

    @property
    def density(self) -> JointModel:
        """The sampled density.

        Raises
        ------
        BayesdegError
            If a cause acts on nothing of it, or names clash.
        """
        try:
            return self.assembly.extended(*self.causes)
        except ValueError as fault:
            raise BayesdegError(str(fault)) from fault

    @property
    def title(self) -> str:
        """What it is of, in words."""
        return self.study.settings.title or self.study.name

    @property
    def effort(self) -> Effort:
        """What the study states."""
        return self.study.settings.effort

    @property
    def seed(self) -> int:
        """What the study states."""
        return self.study.settings.seed

    @property
    def is_parallel(self) -> bool:
        """Whether other processes can compute it, which excludes functions of the user."""
        if self.own is not None:
            return False
        forward = mechanics_of(self.assembly.model.forward)
        ours = forward is None or isinstance(forward, Surrogate)
        tried = (*self.causes, *self.assembly.candidates)
        return ours and all(map(_is_ours, tried))

    def cause(self, given: Cause | str) -> Cause:
        """Return a cause by name, with the priors of the study, or a given cause unchanged.

        Raises
        ------
        BayesdegError
            If there is none of that name; the message suggests the nearest.
        """
        if self.own is not None:
            return cause_of(given, (*self.assembly.candidates, *self.causes))
        if isinstance(given, Cause):
            return given
        known = CATALOGUE | {one.name: one for one in (*self.assembly.causes, *self.causes)}
        if given not in known:
            raise BayesdegError(f"there is no cause {given!r}; {use_one_of(given, known)}")
        return known[given]

    def with_candidates(self, causes: str | Iterable[Cause | str]) -> "ModelledExperiment":
        """Return the experiment with different candidates: ``all`` of the study, or a list."""
        if causes == "all":
            self._refuse_no_candidates(self.assembly.candidates)
            return self
        wanted = [self.cause(one) for one in ([causes] if isinstance(causes, str) else causes)]
        self._refuse_no_candidates(wanted)
        unjudged = self.assembly.unjudged
        names = {one.name for one in wanted}
        assembly = replace(
            self.assembly,
            candidates=tuple(one for one in wanted if one.name not in unjudged),
            unjudged={one.name: unjudged[one.name] for one in wanted if one.name in unjudged},
            alike=tuple(one for one in self.assembly.alike if one.name in names),
            of_counts=tuple(one for one in self.assembly.of_counts if one.name in names),
        )
        return replace(self, assembly=assembly)

    def _refuse_no_candidates(self, wanted: Sequence[Cause]) -> None:
        if wanted or (self.own is None and self.assembly.unjudged):
            return
        if self.own is None:
            raise BayesdegError("causes is empty; name at least one cause, or 'all'")
        raise BayesdegError(
            "a model with its own forward map has no candidate causes; give "
            "criticise(fit, causes=[...]) or Model(..., catalogue=[...])"
        )

    def fit(self, effort: Effort, seed: int, progress: Progress, executor: Executor | None) -> Fit:
        """Calibrate the model; the base model as ``bayesdeg run`` does with the same seed."""
        streams = Streams.of(seed)
        found = None if self.judgement is None else extended_model(self.judgement)
        return calibrate(
            self.density,
            "final" if self.causes else "base",
            effort=EFFORTS[effort],
            seed=streams.final if self.causes else streams.base,
            checkpoints=NoCheckpoints(),
            progress=progress,
            executor=executor,
            start=None if found is None else found[1],
        )

    def said_of_map(self, fit: Fit | None = None) -> tuple[str, ...]:
        """Say where the user's forward map fails, including a fit's proposals."""
        known = self.assembly.answers
        if known is not None and fit is not None:
            known = forward_map_of(Results(self.assembly, fit, fit, None))
        return () if known is None else forward_map_words(known)

    def posterior(self, fit: Fit, effort: Effort, seed: int) -> xr.DataTree:
        """Return the draws that a run folder keeps, with predictions of the readings."""
        kept = fit.chain.thinned(EFFORTS[effort].kept)
        return to_datatree(fit.model, kept, np.random.default_rng(Streams.of(seed).drawing))

    def judge(
        self, fit: Fit, effort: Effort, seed: int, progress: Progress, executor: Executor | None
    ) -> Judged:
        """Judge the base model, as ``bayesdeg run`` does with the same seed.

        Raises
        ------
        BayesdegError
            If causes are active already.
        """
        if self.causes:
            names = ", ".join(cause.name for cause in self.causes)
            raise BayesdegError(
                f"the model already has {names}, but only a model without causes is judged: "
                "criticise the calibration of the base model"
            )
        guard, streams, judgement = Guard(), Streams.of(seed), None
        if can_be_judged(fit):
            work = partial(judged_fit, progress=progress, executor=executor, guard=guard)
            judgement = work(self.assembly, fit, effort, streams.verdict)
        results = Results(self.assembly, fit, fit, judgement)
        if judgement is None:
            results = with_counts(results, streams.verdict, guard)
        elif self.assembly.aside and self.assembly.whole is not None:
            whole = set_aside(self.assembly.whole, self.assembly.beyond)
            emulator = mechanics_of(self.assembly.model.forward)
            forward = emulator if isinstance(emulator, Surrogate) else None
            asked = (results, whole, forward, streams.suspects, executor, guard)
            results = judged_with_suspects(*asked)
        residual = _residual(fit, streams.drawing)
        doubted = dict(in_doubt(self.study, results)) | {"left_out": guard.entries()}
        document = verdict_of(results, residual, "", guard).model_copy(update=doubted)
        return Judged(document, self.assembly.causes, judgement)

    def trial(self, fit: Fit) -> Trial:
        """Return the calibration in a form from which groups of readings can be held out."""
        return base_of(fit)

    def folds(self, seed: int) -> np.random.SeedSequence:
        """Return the seed with which a verdict holds out data."""
        if self.own is not None:
            return np.random.SeedSequence(seed).spawn(2)[1]
        return Streams.of(seed).verdict.spawn(3)[1]

    def tidy(self, gain: pd.DataFrame) -> pd.DataFrame:
        """Return held-out scores, for a user's forward map in the unit of its readings."""
        if self.own is None:
            return gain
        several = gain["degradation_pct"].nunique() > MOST_OF_ONE_LEVEL
        rows = gain if several else gain[gain["degradation_pct"] == ALL_LEVELS]
        plain = rows.rename(columns={"degradation_pct": "level"}).reset_index(drop=True)
        return plain[[*SCORED_FIRST, *(n for n in plain if n not in (*SCORED_FIRST, *SCORED_ELSE))]]

    def predict(
        self,
        drawn: Drawn,
        seed: int,
        progress: Progress,
        *,
        pressure: Floats,
        levels: Sequence[Level],
        conditions: ServiceConditions = PROMPT,
    ) -> pd.DataFrame:
        """Return curvature bands and rupture probabilities of a new specimen."""
        if self.own is not None:
            raise BayesdegError("a model with its own forward map requires x=...")
        return forecast.predict(
            drawn,
            levels,
            pressure,
            seed=np.random.SeedSequence([seed, 1]),
            progress=progress,
            conditions=conditions,
        )

    def control(
        self,
        drawn: Drawn,
        seed: int,
        progress: Progress,
        *,
        curvature: Floats,
        levels: Sequence[Level],
        max_risk: float,
        conditions: ServiceConditions = PROMPT,
        beyond: bool = False,
    ) -> tuple[pd.DataFrame, tuple[str, ...]]:
        """Return the pressure for each curvature at each degradation rate, and its limit."""
        if self.own is not None:
            raise BayesdegError(
                "a model with its own forward map has no curvature and no pressure: use "
                "control(fit, reading=..., x=...)"
            )
        experience = experience_of(self._document)
        found = forecast.settings(
            drawn,
            levels,
            curvature,
            risk=max_risk,
            seed=np.random.SeedSequence([seed, 1]),
            progress=progress,
            conditions=conditions,
            experience=None if beyond else experience,
        )
        allowed, strong = forecast.allowed_by_rate(found), drawn.model.has_elongation
        said = forecast.basis(experience, allowed, beyond=beyond, strong=strong)
        return forecast.settings_table(found), said

    def predict_own(self, fit: Fit, effort: Effort, seed: int, x: Any) -> pd.DataFrame:
        """Return predictions for a new specimen at x, without reading error."""
        return formula.predict(
            *self._of_own(fit, effort, "pressure=... and degradation=..."),
            x,
            np.random.SeedSequence([seed, 1]),
        )

    def control_own(
        self, fit: Fit, effort: Effort, seed: int, wanted: Floats, x: Any
    ) -> pd.DataFrame:
        """Return the input that gives the wanted reading."""
        asked = self._of_own(fit, effort, "curvature=... and degradation=...")
        return formula.control(*asked, wanted, x, np.random.SeedSequence([seed, 1]))

    def _of_own(self, fit: Fit, effort: Effort, ask: str) -> tuple[OwnMap, DrawnFormula]:
        if self.own is None:
            raise BayesdegError(f"a model of a study requires {ask}")
        return self.own, DrawnFormula(fit.model, fit.chain.thinned(EFFORTS[effort].kept))

    def soil(self, effort: Effort, seed: int, progress: Progress) -> Soil:
        """Return the course of degradation as ``bayesdeg run`` finds it with the same seed.

        Raises
        ------
        BayesdegError
            If the study has no moisture of films.
        """
        progress.stage("course of degradation")
        course = course_of(self.study, EFFORTS[effort], Streams.of(seed).films)
        if course is None:
            raise BayesdegError(forecast.NO_COURSE)
        return course.soil(EFFORTS[effort].kept)

    def lifetime(
        self,
        drawn: Drawn,
        soil: Soil,
        seed: int,
        progress: Progress,
        duty: Duty,
        hours: Floats | None,
        conditions: ServiceConditions,
        *,
        beyond: bool,
    ) -> tuple[pd.DataFrame, tuple[str, ...]]:
        """Return the life of actuators in the soil, with warnings."""
        times = default_hours(forecast.ranges_of(self._document)) if hours is None else hours
        experience = experience_of(self._document)
        life = lifetime_of(
            *(drawn, soil, duty, times),
            seed=np.random.SeedSequence([seed, 1]),
            progress=progress,
            conditions=conditions,
            experience=None if beyond else experience,
        )
        table, summary = life_table(drawn, life, duty), life_summary(drawn, life, duty)
        table.attrs.update(summary.facts, summary=str(summary))
        at, levels = np.array([duty.pressure]), soil.levels(times[[0, -1]])
        allowed, strong = allowed_at_ends(life, levels), drawn.model.has_elongation
        said = forecast.basis(experience, allowed, beyond=beyond, strong=strong)
        return table, (*self.cautions(drawn, levels, at, conditions), *said)

    def cautions(
        self, drawn: Drawn, levels: Sequence[Level], pressure: Floats, conditions: ServiceConditions
    ) -> tuple[str, ...]:
        """Warn about averaging, extrapolation and conditions without effect."""
        ranges, rates = forecast.ranges_of(self._document), forecast.rates_of(levels)
        members = drawn.members if isinstance(drawn, Averaged) else ()
        averaged = Caution("averaged", {"members": members, "by_command": False})
        return (
            *((str(averaged),) if members else ()),
            *forecast.extrapolations(ranges, rates, pressure),
            *forecast.hours_beyond(ranges, levels),
            *forecast.unanswered_conditions(drawn, rates, conditions),
        )

    @property
    def _document(self) -> ModelEntry:
        return model_document(self.assembly.model, self.study)

    def drawn(self, fit: Fit, effort: Effort, seed: int) -> Drawn:
        """Return the draws for predictions, as in a run folder.

        They are over all sets of causes that the verdict could not tell apart, if the model is
        that of a verdict; `effort` and `seed` are those of the calibration.
        """
        if fit.model.forward is None:
            raise BayesdegError(
                f"{self.study.name} has no actuator readings, so its posterior cannot predict "
                "actuators; add actuator.csv to the study"
            )
        final = Results(self.assembly, fit, fit, _of_final(self.judgement, fit))
        averaged = with_average(final, Streams.of(seed).averaged, Guard(strict=True)).averaged
        return averaged or replace(fit, chain=fit.chain.thinned(EFFORTS[effort].kept))

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
        """Write the run folder and its page; return the page.

        Raises
        ------
        BayesdegError
            If the calibrations and the verdict do not belong together, or the folder is not free.
        """
        judgement = None if judged is None else _of_final(judged[0].judgement, final.fit)
        settled = judgement is None or judgement.sampled or not final.fit.model.causes
        fit = final.fit if settled else base.fit
        results = Results(self.assembly, base.fit, fit, judgement)
        study = with_options(self.study, base.effort, base.seed)
        guard, clock = Guard(), Clock({"base": base.seconds})
        clock.seconds |= {"verdict": judged[1]} if judged else {}
        clock.seconds |= {"extended": final.seconds} if final.fit is not base.fit else {}
        results = with_average(results, Streams.of(base.seed).averaged, guard)
        with run_folder(path, study) as folder:
            work = partial(conclude, progress=progress, executor=executor, guard=guard, full=full)
            document = work(study, folder, results, clock)
            page = add_page(folder, document, guard)[1]
        if page is None:
            raise BayesdegError(f"{path}: the page could not be built; see left_out.txt there")
        return page


def _is_ours(cause: Cause) -> bool:
    """Return whether a cause is from the catalogue, whatever its priors."""
    known = CATALOGUE.get(cause.name)
    return known is not None and replace(cause, parameters=known.parameters) == known


def _known_emulator(study: Study) -> Surrogate:
    """Return the emulator of a study's geometry that ships with the package, or was trained here.

    Raises
    ------
    BayesdegError
        If there is none yet.
    """
    geometry = geometry_of_study(study.settings)
    refuse_whole_range(geometry)
    found = find_emulator(geometry)
    if found.surrogate is None:
        raise BayesdegError(
            f"{found.reason}; use Model(study, bayesdeg.emulator(study)), which finds the "
            "emulator that `bayesdeg run` trained here, or trains one"
        )
    return found.surrogate


def _residual(fit: Fit, seed: np.random.SeedSequence) -> Floats | None:
    """Return curvature residuals of the posterior prediction [1/m]; None without readings."""
    if fit.model.actuator is None:
        return None
    found = predict_readings(fit.model, fit.chain, np.random.default_rng(seed))
    return fit.model.actuator.curvature - found.mean


def _of_final(judgement: Judgement | None, final: Fit) -> Judgement | None:
    """Return a judgement with the sizes of the causes from the final model's posterior.

    Raises
    ------
    BayesdegError
        If the final model has other causes than those with which the verdict predicts.
    """
    if judgement is None:
        return None
    wanted: Sequence[str] = judgement.predicted_with
    given = sorted(cause.name for cause in final.model.causes)
    if not given:
        return replace(judgement, sampled=False)
    if given == sorted(judgement.of_readings):
        judgement = replace(judgement, counts_fitted=given == sorted(wanted))
    elif given != sorted(wanted):
        raise BayesdegError(
            f"the final model has {', '.join(given)}, but the verdict predicts with "
            f"{', '.join(wanted) or 'no cause'}; calibrate "
            "model.with_verdict(verdict)"
        )
    return with_sampled_sizes(judgement, final)
