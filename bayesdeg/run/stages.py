"""The main job: read, calibrate, criticise, name the cause, extend, measure the gain, predict."""

import hashlib
import json
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import bayesdeg
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.reading import mechanics_of
from bayesdeg.analysis.averaged import averaged
from bayesdeg.analysis.calibrate import Fit, awake, base_without_chain, calibrate
from bayesdeg.analysis.checks import check
from bayesdeg.analysis.judge import (
    COUNT_DRAWS,
    Judgement,
    count_misfits,
    extended_model,
    judge,
    judge_briefly,
    with_sampled_sizes,
)
from bayesdeg.analysis.model_kind import kind_of, kind_of_study
from bayesdeg.assembly.aside import set_aside
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.assembly.reach import assemble_within_reach
from bayesdeg.assembly.suspects import screened
from bayesdeg.criticism.checks.residuals import predict_readings
from bayesdeg.criticism.decide.verdict import Decision
from bayesdeg.data.settings import SamplingOptions
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.pages.folder import POSTERIOR_AVERAGED, RunFolder
from bayesdeg.pages.left_out import Guard, OptionalStage, posterior_stage
from bayesdeg.pages.page import build_page
from bayesdeg.pages.record import InDoubt, VerdictRecord
from bayesdeg.progress import Progress
from bayesdeg.quantities import Effort
from bayesdeg.run.deformed import begin
from bayesdeg.run.record import Results, in_doubt, verdict_of
from bayesdeg.run.run_record import emulated, run_document
from bayesdeg.run.writing import Files, write_posteriors, write_results
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import to_bytes
from bayesdeg.surrogate.workers import WorkerProcesses

Calibrate = Callable[..., Fit]
Floats = NDArray[np.float64]


@dataclass
class Clock:
    """Wall time of the stages [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = round(time.perf_counter() - start, 2)


class Streams(NamedTuple):
    """Independent streams of random numbers, one for each stage, from the one seed of a study.

    A stage draws the same numbers whether the others were run or not.
    """

    drawing: np.random.SeedSequence
    base: np.random.SeedSequence
    verdict: np.random.SeedSequence
    final: np.random.SeedSequence
    checks: np.random.SeedSequence
    films: np.random.SeedSequence
    averaged: np.random.SeedSequence
    suspects: np.random.SeedSequence

    @classmethod
    def of(cls, seed: int) -> Self:
        """Return the streams of a seed.

        Examples
        --------
        >>> Streams.of(1).base.spawn_key
        (1,)
        """
        return cls(*np.random.SeedSequence(seed).spawn(len(cls._fields)))


def run_study(
    study: Study,
    folder: RunFolder,
    checkpoints: Checkpoints,
    *,
    progress: Progress,
    executor: Executor | None = None,
    forward: Surrogate | None = None,
    guard: Guard | None = None,
) -> VerdictRecord:
    """Run the whole analysis of a study and write the run folder, except for the page.

    Only reading and the calibration of the base model are essential. Any other stage that fails is
    left out, with the reason in ``verdict.json``, ``run.json`` and ``left_out.txt``.

    Parameters
    ----------
    study : Study
        Checked; its settings hold effort and seed.
    folder : RunFolder
        Where the results go.
    checkpoints : Checkpoints
        Finished stages of an interrupted run.
    progress : Progress
        Shows the work.
    executor : Executor, optional
        For ensembles and folds.
    forward : Surrogate, optional
        An emulator of the study's geometry; by default the one that ships with the package.
    guard : Guard, optional
        Leaves out what fails; a new one by default.

    Returns
    -------
    VerdictRecord
        The content of ``verdict.json``.
    """
    clock, guard = Clock(), guard or Guard()
    if isinstance(executor, WorkerProcesses):
        for _ in range(executor.workers):  # imports, a second of work, while the study is read
            executor.submit(awake)
    seeds = Streams.of(study.settings.seed)
    with clock.stage("read"):
        assembly = assemble_within_reach(study, forward)
    with clock.stage("suspects"):
        progress.stage(OptionalStage.SUSPECTS)
        assembly = _screened(assembly, forward, guard)
    study = assembly.study
    fit = partial(
        calibrate,
        effort=EFFORTS[study.settings.sampling.effort],
        checkpoints=checkpoints,
        progress=progress,
        executor=executor,
    )
    with clock.stage("base"):
        base = fit(assembly.model, "base", seed=seeds.base)
    results = Results(assembly, base, base, None)
    if can_be_judged(base):
        with clock.stage("verdict"):
            judging = (assembly, base, study.settings.sampling.effort, seeds.verdict)
            judged = partial(judged_fit, progress=progress, executor=executor, guard=guard)
            judgement = guard.attempt(OptionalStage.VERDICT, judged, *judging)
        with clock.stage("extended"):
            results = _extend(replace(results, judgement=judgement), fit, seeds.final, guard)
            results = with_average(results, seeds.averaged, guard)
        if assembly.sets_aside:
            with clock.stage("verdict with suspects"):
                results = judged_with_suspects(results, forward, seeds.suspects, executor, guard)
    if results.judgement is None:
        results = with_counts(results, seeds.verdict, guard)
    return conclude(
        study, folder, results, clock, progress=progress, executor=executor, guard=guard
    )


def _screened(assembly: Assembly, forward: Surrogate | None, guard: Guard) -> Assembly:
    """Return a study's models with its outlying readings, set aside if beyond doubt."""
    with threadpool_limits(limits=1):
        return guard.attempt(OptionalStage.SUSPECTS, screened, assembly, forward) or assembly


def verdict_on(
    assembly: Assembly,
    base: Fit,
    effort: Effort,
    seed: int,
    *,
    progress: Progress,
    executor: Executor | None,
) -> tuple[VerdictRecord, Judgement | None]:
    """Judge a calibrated base model, as `run_study` does with the same seed.

    Returns the content of ``verdict.json`` and its basis; None if there was nothing to judge.
    """
    guard, streams, judgement = Guard(), Streams.of(seed), None
    if can_be_judged(base):
        judging = (assembly, base, effort, streams.verdict)
        judgement = judged_fit(*judging, progress=progress, executor=executor, guard=guard)
    results = Results(assembly, base, base, judgement)
    if judgement is None:
        results = with_counts(results, streams.verdict, guard)
    elif assembly.sets_aside:
        emulator = mechanics_of(assembly.model.world.forward)
        forward = emulator if isinstance(emulator, Surrogate) else None
        results = judged_with_suspects(results, forward, streams.suspects, executor, guard)
    residual = None
    if base.model.of_kind(Curvature):
        generator = np.random.default_rng(streams.drawing)
        predicted = predict_readings(base.model, base.chain, generator)
        residual = base.model.data_of(Curvature).tests.curvature - predicted.mean
    doubted = dict(in_doubt(results)) | {"left_out": guard.entries()}
    return verdict_of(results, residual, "", guard).model_copy(update=doubted), judgement


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


def judged_with_suspects(
    results: Results,
    forward: Surrogate | None,
    seed: np.random.SeedSequence,
    executor: Executor | None,
    guard: Guard,
) -> Results:
    """Judge the study with all that curves reach, briefly."""
    if results.judgement is None:
        return results
    work = partial(_decision_of, results.assembly, forward, seed, executor)
    found = guard.attempt(OptionalStage.WITH_SUSPECTS, work)
    return replace(results, with_suspects=found)


def _decision_of(
    left: Assembly,
    forward: Surrogate | None,
    seed: np.random.SeedSequence,
    executor: Executor | None,
) -> Decision:
    fitting, judging = seed.spawn(2)
    with threadpool_limits(limits=1):
        assembly = assemble(set_aside(left.whole, left.beyond), forward)
        base = base_without_chain(assembly.model, fitting, chain=False)
        return judge_briefly(assembly, base, seed=judging, executor=executor)


def conclude(
    study: Study,
    folder: RunFolder,
    results: Results,
    clock: Clock,
    *,
    progress: Progress,
    executor: Executor | None,
    guard: Guard,
    full: bool = True,
) -> VerdictRecord:
    """Write all results of the calibrations and the verdict, except for the page.

    Parameters
    ----------
    study : Study
        Its settings hold the effort and the seed of the calibrations.
    folder : RunFolder
        Where the files go.
    results : Results
        Calibrations and verdict.
    clock : Clock
        Holds the wall time of the stages before.
    progress, executor, guard
        As of `run_study`.
    full : bool
        Whether to compute what takes long: what the final calibration rests on, what the films
        alone say, and the deformed actuators.

    Returns
    -------
    VerdictRecord
        The content of ``verdict.json``.
    """
    seeds, files = Streams.of(study.settings.seed), Files(folder, guard)
    generator = np.random.default_rng(seeds.drawing)
    final, pictures, examined = results.final, None, None
    if full and final.model.of_kind(Curvature) and executor is not None:
        # solved in the background, since it takes long
        geometry = geometry_of_study(study.settings)
        pictures = guard.attempt(OptionalStage.DEFORMED, begin, final, geometry, executor)
    if full:
        begun = kind_of(results.base.model).begin_films
        films = (study, results.base.model, seeds.films, executor)
        examined = guard.attempt(OptionalStage.ORDERS, begun, *films)
    progress.stage("posteriors")
    write_posteriors(study, files, results, generator)
    forward = emulated(results)
    folder.write_emulator(None if forward is None else to_bytes(forward))
    if full:
        checked = partial(check, results.final, seed=seeds.checks, executor=executor)
        with clock.stage("checks"):
            results = replace(results, checks=checked(progress=progress, guard=guard))
    if examined is not None:
        with clock.stage("films"):
            results = replace(results, films=examined(progress, guard))
    progress.stage("predictions and tables")
    with clock.stage("predict"):
        write = partial(write_results, pictures=pictures, deformed=full)
        document = write(study, files, results, generator)
    if POSTERIOR_AVERAGED not in files.written:
        results = replace(
            results, averaged=None
        )  # files of failed stages are not recorded as present
    doubted = guard.attempt(OptionalStage.IN_DOUBT, in_doubt, results) or InDoubt()
    record = run_document(study, results, clock.seconds, guard, doubted)
    folder.write(record.model_copy(update={"posteriors": folder.posterior_hashes()}))
    return say_left_out(folder, document.model_copy(update=dict(doubted)), guard)


def add_page(
    folder: RunFolder, document: VerdictRecord, guard: Guard
) -> tuple[VerdictRecord, Path | None]:
    """Write the page of a run folder; return the verdict, with failed stages, and the page."""
    page = guard.attempt(OptionalStage.PAGE, build_page, folder.path, guard)
    if guard.left_out:
        document = say_left_out(folder, document, guard)
    return document, page


def with_counts(results: Results, seed: np.random.SeedSequence, guard: Guard) -> Results:
    """Compare published rupture counts with the final model of a study that was not judged.

    A verdict compares them with the model of the causes that readings show. So causes of rupture
    are removed from the final model, at its posterior of all other parameters.
    """
    counts = results.assembly.counts
    if counts is None:
        return results
    model, vectors = results.final.model, results.final.chain.spread(COUNT_DRAWS)
    shown = tuple(cause for cause in model.causes if not cause.is_of_rupture_alone)
    if shown != model.causes:
        without = replace(model.without_kinds(RuptureCounts.name), causes=shown)
        vectors = vectors[:, [model.table.names.index(name) for name in without.table.names]]
        model = without
    generator = np.random.default_rng(seed)
    found = guard.attempt(
        OptionalStage.RUPTURE_COUNTS, count_misfits, model, counts, vectors, generator
    )
    return results if found is None else replace(results, counts=found[0])


def can_be_judged(base: Fit) -> bool:
    """Return whether a base model has converged and has readings that can show a misfit."""
    return len(base.model.places) > 0 and base.diagnosis.is_converged


def with_options(study: Study, effort: Effort | None = None, seed: int | None = None) -> Study:
    """Return a study with a different effort or seed.

    Examples
    --------
    >>> with_options(Study("gelatin", Path("gelatin")), seed=7).settings.seed
    7
    """
    settings = study.settings
    settings = replace(settings, sampling=SamplingOptions(effort or settings.sampling.effort))
    return replace(study, settings=settings if seed is None else replace(settings, seed=seed))


def say_left_out(folder: RunFolder, document: VerdictRecord, guard: Guard) -> VerdictRecord:
    """Write the failed stages and the verdict into a run folder; return the verdict.

    Parameters
    ----------
    folder : RunFolder
        Of a run, with its ``run.json``.
    document : VerdictRecord
        Content of ``verdict.json``.
    guard : Guard
        Knows what was left out.
    """
    found = {"left_out": guard.entries()}
    document = document.model_copy(update=found)
    folder.write(document)
    folder.write(folder.read_run().model_copy(update=found))
    folder.write_left_out(guard.traces())
    return document


def judged_fit(
    assembly: Assembly,
    base: Fit,
    effort: Effort,
    seed: np.random.SeedSequence,
    *,
    progress: Progress,
    executor: Executor | None,
    guard: Guard,
) -> Judgement:
    """Judge the base model of a study by its calibration.

    Linear algebra uses one thread, so that results are the same bits on every machine.
    """
    with threadpool_limits(limits=1):
        kind = kind_of(assembly.model)
        start, seed = kind.start_of_search(base, seed)
        return judge(
            assembly,
            start,
            effort=kind.search_effort(effort),
            seed=seed,
            progress=progress,
            executor=executor,
            guard=guard,
        )


def fingerprint(study: Study, forward: Surrogate | None = None) -> str:
    """Return a hash of all inputs of a run."""
    settings = study.settings
    emulator = kind_of_study(study).surrogate_bytes(forward)
    content = json.dumps(
        [
            bayesdeg.__version__,
            hashlib.sha256(emulator).hexdigest(),
            dict(study.hashes),
            settings.sampling.effort,
            settings.seed,
        ],
        sort_keys=True,
    )
    return hashlib.sha256(content.encode()).hexdigest()


def _extend(
    results: Results, fit: Calibrate, seed: np.random.SeedSequence, guard: Guard
) -> Results:
    """Calibrate the model with the leading cause, if there is one."""
    judgement = results.judgement
    extended = None if judgement is None else extended_model(judgement)
    if judgement is None or extended is None:
        return results
    model, start = results.assembly.with_its_counts(extended[0]), extended[1]
    extending = (results.base, judgement, (model, start), fit, seed)
    found = guard.attempt(OptionalStage.EXTENDED, _final, *extending)
    if found is None:
        return replace(results, judgement=replace(judgement, sampled=False))
    return replace(results, final=found[0], judgement=found[1])


def with_average(results: Results, seed: np.random.SeedSequence, guard: Guard) -> Results:
    """Draw over the causes that cannot be told apart, if there are several."""
    final = results.final.model
    if results.judgement is None or not kind_of(final).is_averaged(final):
        return results
    generator, stage = np.random.default_rng(seed), posterior_stage(POSTERIOR_AVERAGED)
    found = guard.attempt(stage, averaged, results.judgement, results.final, generator)
    return replace(results, averaged=found)


def _final(
    base: Fit,
    judgement: Judgement,
    extended: tuple[JointModel, Floats],
    fit: Calibrate,
    seed: np.random.SeedSequence,
) -> tuple[Fit, Judgement]:
    """Return the predictive model and the verdict; without causes if it did not converge."""
    final = fit(extended[0], "final", seed=seed, start=extended[1])
    found = with_sampled_sizes(judgement, final)
    return (final if found.sampled else base), found
