"""From a study folder alone to its verdict, as ``bayesdeg run --effort quick`` comes to it.

Verdicts are made in processes of their own, which open the folder and nothing else.
"""

import multiprocessing
from collections.abc import Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bayesdeg.causes.cause import Cause
from bayesdeg.measure.study import read_study
from bayesdeg.pipeline.assemble import Assembly, assemble
from bayesdeg.pipeline.base import base_without_chain
from bayesdeg.pipeline.judge import JUDGE_EFFORTS, judge
from bayesdeg.pipeline.judgement import Judgement
from bayesdeg.pipeline.progress import Silent


@dataclass(frozen=True)
class Verdict:
    """What a verdict says.

    Parameters
    ----------
    outcome : str
    causes : tuple of str
    sizes : dict
        Mean and standard deviation by cause and parameter.
    factors : dict of str to float
        How far the log Bayes factor of each supported cause is above what naming takes.
    confirmed : dict of str to bool
        Whether held-out specimens agree.
    p_value : float
        Of the base model's misfit.
    """

    outcome: str
    causes: tuple[str, ...]
    sizes: dict[str, dict[str, tuple[float, float]]]
    factors: dict[str, float]
    confirmed: dict[str, bool]
    p_value: float


def verdict_on(folder: Path, idle: str = "") -> Verdict:
    """Judge a folder; or against a cause that does nothing, if one is given."""
    assembly = assemble(read_study(folder))
    return _told(judged(idle_alone(assembly, idle) if idle else assembly))


def side_by_side(folders: Iterable[tuple[str, Path, str]]) -> dict[str, Future[Verdict]]:
    """Begin to judge folders, two at a time."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        return {key: pool.submit(verdict_on, folder, idle) for key, folder, idle in folders}


def judged(assembly: Assembly, *, seed: int = 1) -> Judgement:
    """Return the verdict at quick effort; the chain only where the verdict would use it."""
    fitting, judging = np.random.SeedSequence(seed).spawn(2)
    return judge(
        assembly,
        base_without_chain(assembly.model, fitting),
        effort=JUDGE_EFFORTS["quick"],
        seed=judging,
        progress=Silent(),
    )


def idle_alone(assembly: Assembly, name: str) -> Assembly:
    """Return the assembly with a single candidate, a cause of the catalogue that does nothing."""
    return replace(
        assembly, candidates=tuple(_idle(c) for c in assembly.candidates if c.name == name)
    )


def _idle(cause: Cause) -> Cause:
    hooks = ("on_degradation", "on_inputs", "on_reading", "on_stress", "on_strength")
    return replace(cause, **{hook: _unchanged for hook in hooks if getattr(cause, hook)})


def _unchanged(state: object, *_: object) -> object:
    return state


def _told(judgement: Judgement) -> Verdict:
    return Verdict(
        str(judgement.decision.outcome),
        judgement.decision.causes,
        {
            c.cause: {name: (size.mean, size.sd) for name, size in c.effect.items()}
            for c in judgement.candidates
        },
        {one.cause: one.log_bayes_factor - judgement.threshold for one in judgement.supported},
        {one.cause: one.held_out_agrees for one in judgement.supported},
        judgement.misfit.p_value,
    )
