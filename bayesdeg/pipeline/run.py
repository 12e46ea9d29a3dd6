"""The main job: read, calibrate, criticise, name the cause, extend, measure the gain, predict."""

import hashlib
import json
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import bayesdeg
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.data.study import Study
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.trained import default_surrogate, to_bytes
from bayesdeg.inference.model import Model
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.calibrate import Fit, base_of, calibrate
from bayesdeg.pipeline.checks import check
from bayesdeg.pipeline.deformed import Begun, begin
from bayesdeg.pipeline.films import examine
from bayesdeg.pipeline.judge import (
    JUDGE_EFFORTS,
    Judgement,
    extended_model,
    judge,
    with_sampled_sizes,
)
from bayesdeg.pipeline.progress import Progress
from bayesdeg.pipeline.record import in_doubt, run_document
from bayesdeg.pipeline.results import Results
from bayesdeg.pipeline.writing import write_results
from bayesdeg.report.checkpoints import Checkpoints
from bayesdeg.report.folder import RunFolder
from bayesdeg.report.left_out import Guard, Stage
from bayesdeg.report.record import InDoubt, Verdict

Calibrate = Callable[..., Fit]
Floats = NDArray[np.float64]


@dataclass
class _Clock:
    """Wall time of the stages [s]."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = round(time.perf_counter() - start, 2)


def run_study(
    study: Study,
    folder: RunFolder,
    checkpoints: Checkpoints,
    *,
    progress: Progress,
    executor: Executor | None = None,
    forward: Surrogate | None = None,
    guard: Guard | None = None,
) -> Verdict:
    """Do the main job on a study and write the run folder, except for the page.

    Only reading and the calibration of the base model are indispensable. Any other stage that
    fails is left out, with what happened in ``verdict.json``, ``run.json`` and ``left_out.txt``.

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
    Verdict
        The content of ``verdict.json``.
    """
    clock, guard = _Clock(), guard or Guard()
    seeds = np.random.SeedSequence(study.settings.seed).spawn(6)
    with clock.stage("read"):
        assembly = assemble(study, forward)
    fit = partial(
        calibrate,
        effort=EFFORTS[study.settings.effort],
        checkpoints=checkpoints,
        progress=progress,
        executor=executor,
    )
    with clock.stage("base"):
        base = fit(assembly.model, "base", seed=seeds[1])
    results = Results(assembly, base, base, None)
    if assembly.model.actuator is not None or assembly.model.tensile is not None:
        judged = partial(_judged, progress=progress, executor=executor, guard=guard)
        with clock.stage("verdict"), threadpool_limits(limits=1):
            judgement = guard.attempt(Stage.VERDICT, judged, study, results, seeds[2])
        with clock.stage("extended"):
            results = _extend(replace(results, judgement=judgement), fit, seeds[3], guard)
    pictures = _begun_pictures(study, results, executor, guard)
    results = _examine(
        study, results, seeds[4:], clock=clock, progress=progress, executor=executor, guard=guard
    )
    progress.stage("predictions and tables")
    with clock.stage("predict"):
        write = partial(write_results, pictures=pictures)
        document = write(study, folder, results, np.random.default_rng(seeds[0]), guard)
    doubted = guard.attempt(Stage.IN_DOUBT, in_doubt, study, results) or InDoubt()
    record = run_document(study, results, clock.seconds, guard, doubted)
    folder.write(record.model_copy(update={"posteriors": folder.posterior_hashes()}))
    return say_left_out(folder, document.model_copy(update=dict(doubted)), guard)


def _begun_pictures(
    study: Study, results: Results, executor: Executor | None, guard: Guard
) -> Begun | None:
    """Begin to solve the deformed actuators, which takes long, beside what comes next."""
    if results.final.model.actuator is None or executor is None:
        return None
    geometry = Geometry(study.settings.dimensions)
    return guard.attempt(Stage.DEFORMED, begin, results.final, geometry, executor)


def say_left_out(folder: RunFolder, document: Verdict, guard: Guard) -> Verdict:
    """Write what was left out into a run folder, and the verdict with it; return the verdict.

    Parameters
    ----------
    folder : RunFolder
        Of a run, with its ``run.json``.
    document : Verdict
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


def _judged(
    study: Study,
    results: Results,
    seed: np.random.SeedSequence,
    *,
    progress: Progress,
    executor: Executor | None,
    guard: Guard,
) -> Judgement:
    return judge(
        results.assembly,
        base_of(results.base),
        effort=JUDGE_EFFORTS[study.settings.effort],
        seed=seed,
        progress=progress,
        executor=executor,
        guard=guard,
    )


def fingerprint(study: Study, forward: Surrogate | None = None) -> str:
    """Return a hash of everything that a run's results depend on."""
    settings = study.settings
    emulator = to_bytes(forward or default_surrogate())
    content = json.dumps(
        [
            bayesdeg.__version__,
            hashlib.sha256(emulator).hexdigest(),
            dict(study.hashes),
            settings.effort,
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
    found = guard.attempt(Stage.EXTENDED, _final, judgement, extended, fit, seed)
    if found is None:
        return replace(results, judgement=replace(judgement, sampled=False))
    return replace(results, final=found[0], judgement=found[1])


def _final(
    judgement: Judgement,
    extended: tuple[Model, Floats],
    fit: Calibrate,
    seed: np.random.SeedSequence,
) -> tuple[Fit, Judgement]:
    final = fit(extended[0], "final", seed=seed, start=extended[1])
    return final, with_sampled_sizes(judgement, final)


def _examine(
    study: Study,
    results: Results,
    seeds: list[np.random.SeedSequence],
    *,
    clock: _Clock,
    progress: Progress,
    executor: Executor | None,
    guard: Guard,
) -> Results:
    """Ask what the final calibration rests on, and what the films alone say."""
    with clock.stage("checks"):
        checks = check(
            results.final, seed=seeds[0], progress=progress, executor=executor, guard=guard
        )
    with clock.stage("films"):
        effort = EFFORTS[study.settings.effort]
        model = results.base.model
        films = examine(study, model, effort=effort, seed=seeds[1], progress=progress, guard=guard)
    return replace(results, checks=checks, films=films)
