"""A study, or readings with a user's forward map, behind the public functions."""

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

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
from bayesdeg.criticism.fit.trials import CandidateFit
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
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pipeline.aside import set_aside
from bayesdeg.pipeline.assemble import Assembly, assemble, assemble_own
from bayesdeg.pipeline.calibrate import Fit, base_of, calibrate
from bayesdeg.pipeline.films import course_of
from bayesdeg.pipeline.forecast import NO_COURSE
from bayesdeg.pipeline.formula import UserMap, cause_of, probe
from bayesdeg.pipeline.judge import Judgement, extended_model, with_sampled_sizes
from bayesdeg.pipeline.outline import outline
from bayesdeg.pipeline.posterior import Posterior
from bayesdeg.pipeline.progress import Progress
from bayesdeg.pipeline.record import Results, forward_map_of, in_doubt, verdict_of
from bayesdeg.pipeline.run import (
    Streams,
    can_be_judged,
    judged_fit,
    judged_with_suspects,
    with_average,
    with_counts,
)
from bayesdeg.pipeline.run_record import model_of
from bayesdeg.pipeline.suspects import assemble_screened
from bayesdeg.prediction.soil import Soil
from bayesdeg.priors import Parameter
from bayesdeg.quantities import Effort
from bayesdeg.report.checkpoints import NoCheckpoints
from bayesdeg.report.headline import forward_map_words
from bayesdeg.report.left_out import Guard
from bayesdeg.report.record import VerdictRecord
from bayesdeg.report.tables import ALL_LEVELS

Floats = NDArray[np.float64]

MOST_OF_ONE_LEVEL = 2  # rows per model: its one level, and all levels pooled
SCORED_FIRST = ("model", "level", "elpd", "elpd_se", "elpd_diff", "elpd_diff_se", "rmse", "crps")
SCORED_ELSE = ("rmse_per_m", "crps_per_m")


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
        own: UserMap,
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
    def own(self) -> UserMap | None:
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
        return self.study.settings.sampling.effort

    @property
    def seed(self) -> int:
        """What the study states."""
        return self.study.settings.seed

    @property
    def is_parallel(self) -> bool:
        """Whether other processes can compute it, which excludes functions of the user."""
        if self.own is not None:
            return False
        forward = mechanics_of(self.assembly.model.world.forward)
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

    def map_cautions(self, fit: Fit | None = None) -> tuple[str, ...]:
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
    ) -> tuple[VerdictRecord, Judgement | None]:
        """Judge the base model, as ``bayesdeg run`` does with the same seed.

        Returns the content of ``verdict.json`` and its basis; None if there was nothing to judge.

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
            emulator = mechanics_of(self.assembly.model.world.forward)
            forward = emulator if isinstance(emulator, Surrogate) else None
            asked = (results, whole, forward, streams.suspects, executor, guard)
            results = judged_with_suspects(*asked)
        residual = _residual(fit, streams.drawing)
        doubted = dict(in_doubt(self.study, results)) | {"left_out": guard.entries()}
        return verdict_of(results, residual, "", guard).model_copy(update=doubted), judgement

    def trial(self, fit: Fit) -> CandidateFit:
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
            raise BayesdegError(NO_COURSE)
        return course.soil(EFFORTS[effort].kept)

    def drawn(self, fit: Fit, effort: Effort, seed: int) -> Posterior:
        """Return the draws for predictions, as in a run folder.

        They are over all sets of causes that the verdict could not tell apart, if the model is
        that of a verdict; `effort` and `seed` are those of the calibration.

        Raises
        ------
        BayesdegError
            If the study has no actuator readings.
        """
        kept = fit.chain.thinned(EFFORTS[effort].kept)
        if self.own is not None:
            return Posterior(fit.model, kept, own=self.own)
        if fit.model.world.forward is None:
            raise BayesdegError(
                f"{self.study.name} has no actuator readings, so its posterior cannot predict "
                "actuators; add actuator.csv to the study"
            )
        final = Results(self.assembly, fit, fit, of_final(self.judgement, fit))
        averaged = with_average(final, Streams.of(seed).averaged, Guard(strict=True)).averaged
        tested = model_of(self.assembly.model, fit.model, self.study)
        return replace(averaged or Posterior(fit.model, kept), tested=tested)


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
    if not fit.model.of_kind(Curvature):
        return None
    found = predict_readings(fit.model, fit.chain, np.random.default_rng(seed))
    return fit.model.data_of(Curvature).tests.curvature - found.mean


def of_final(judgement: Judgement | None, final: Fit) -> Judgement | None:
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
