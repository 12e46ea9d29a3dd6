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
from threadpoolctl import threadpool_limits

import bayesdeg
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.trained import default_surrogate, to_bytes
from bayesdeg.inference.ensemble import EFFORTS
from bayesdeg.measure.study import Study
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.base import base_of
from bayesdeg.pipeline.calibrate import Fit, calibrate
from bayesdeg.pipeline.checks import check
from bayesdeg.pipeline.films import examine
from bayesdeg.pipeline.judge import JUDGE_EFFORTS, judge
from bayesdeg.pipeline.judgement import extended_model, with_sampled_sizes
from bayesdeg.pipeline.progress import Progress
from bayesdeg.pipeline.record import run_document
from bayesdeg.pipeline.results import Results
from bayesdeg.pipeline.writing import write_results
from bayesdeg.report.checkpoints import Checkpoints
from bayesdeg.report.folder import RUN, VERDICT, RunFolder

Calibrate = Callable[..., Fit]


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
) -> dict[str, object]:
    """Do the main job on a study and write the run folder, except for the page.

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

    Returns
    -------
    dict
        The content of ``verdict.json``.
    """
    clock = _Clock()
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
        with clock.stage("verdict"), threadpool_limits(limits=1):
            judgement = judge(
                assembly,
                base_of(base),
                effort=JUDGE_EFFORTS[study.settings.effort],
                seed=seeds[2],
                progress=progress,
                executor=executor,
            )
        with clock.stage("extended"):
            results = _extend(replace(results, judgement=judgement), fit, seeds[3])
    results = _examine(study, results, seeds[4:], clock=clock, progress=progress, executor=executor)
    progress.stage("predictions and tables")
    with clock.stage("predict"):
        document = write_results(study, folder, results, np.random.default_rng(seeds[0]))
    folder.write_json(VERDICT, document)
    folder.write_json(RUN, run_document(study, results, clock.seconds))
    return document


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


def _extend(results: Results, fit: Calibrate, seed: np.random.SeedSequence) -> Results:
    """Calibrate the model with the leading cause, if there is one."""
    judgement = results.judgement
    assert judgement is not None
    extended = extended_model(judgement)
    if extended is None:
        return results
    final = fit(extended[0], "final", seed=seed, start=extended[1])
    return replace(results, final=final, judgement=with_sampled_sizes(judgement, final))


def _examine(
    study: Study,
    results: Results,
    seeds: list[np.random.SeedSequence],
    *,
    clock: _Clock,
    progress: Progress,
    executor: Executor | None,
) -> Results:
    """Ask what the final calibration rests on, and what the films alone say."""
    with clock.stage("checks"):
        checks = check(results.final, seed=seeds[0], progress=progress, executor=executor)
    with clock.stage("films"):
        effort = EFFORTS[study.settings.effort]
        model = results.base.model
        films = examine(study, model, effort=effort, seed=seeds[1], progress=progress)
    return replace(results, checks=checks, films=films)
