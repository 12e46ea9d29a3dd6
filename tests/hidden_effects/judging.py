"""From a study folder alone to its verdict, as ``bayesdeg run --effort quick`` comes to it.

Verdicts are made in processes of their own, which open the folder and nothing else. So are those of
a catalogue in which one cause does nothing, or something else (`verdict_with`).
"""

import multiprocessing
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import BASE, JUDGE_EFFORTS, Judgement, judge
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.causes.cause import Cause, Effect
from bayesdeg.criticism.checks.missing_terms import MissingTerm
from bayesdeg.criticism.decide.alternatives import stated_sets
from bayesdeg.criticism.decide.candidates import effect_sizes
from bayesdeg.criticism.decide.support import Support, supports
from bayesdeg.criticism.decide.verdict import Reason, decide
from bayesdeg.criticism.fit.screening import screen
from bayesdeg.criticism.fit.search import (
    Search,
    Step,
    factors_by_chance,
    naming_threshold,
    run_search,
)
from bayesdeg.criticism.holdout.gain import gain_table
from bayesdeg.data.study import read_study
from bayesdeg.progress import Silent

NARROW = replace(JUDGE_EFFORTS["quick"], fitted=1, pairs=0)
HOOKS = ("on_degradation", "on_inputs", "on_reading", "on_stress", "on_strength")


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
    rupture_p_value : float
        Of the ruptures that the base model expects.
    reasons : tuple of Reason
        Why what the evidence favours is not named.
    terms : tuple of MissingTerm
        That would remove a misfit that no cause accounts for.
    chief : str
        The column in which most of it sits; empty where nothing is described.
    sets : tuple of tuple of str
        Lists of each of which one cause acts.
    proposed : tuple of (tuple of str, float)
        What further experiments tell apart, and the log Bayes factor expected of them.
    """

    outcome: str
    causes: tuple[str, ...]
    sizes: dict[str, dict[str, tuple[float, float]]]
    factors: dict[str, float]
    confirmed: dict[str, bool]
    p_value: float
    rupture_p_value: float
    reasons: tuple[Reason, ...] = ()
    terms: tuple[MissingTerm, ...] = ()
    chief: str = ""
    sets: tuple[tuple[str, ...], ...] = ()
    proposed: tuple[tuple[tuple[str, ...], float], ...] = ()


@dataclass(frozen=True)
class Verdicts:
    """The verdict on a folder, and those with a cause of the catalogue that does nothing.

    Parameters
    ----------
    plain : Verdict
    idle : dict of str to Verdict
        By the name of that cause.
    concluded : dict
        What `concluded` makes of the verdict.
    """

    plain: Verdict
    idle: dict[str, Verdict]
    concluded: dict[str, Any]


def verdicts_on(folder: Path, idle: tuple[str, ...] = ()) -> Verdicts:
    """Judge a folder; then anew with each of some causes doing nothing."""
    judgement = judged(assemble(read_study(folder)))
    plain, numbers = _told(judgement), concluded(judgement)
    return Verdicts(plain, {name: verdict_with(judgement, name) for name in idle}, numbers)


def side_by_side(
    folders: Iterable[tuple[str, Path, tuple[str, ...]]],
) -> dict[str, Future[Verdicts]]:
    """Begin to judge folders, two at a time."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        return {key: pool.submit(verdicts_on, folder, idle) for key, folder, idle in folders}


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


def concluded(found: Judgement) -> dict[str, Any]:
    """Return what is concluded as words, numbers and lists of them by name."""
    subject = found.search.base.subject
    gains = gain_table(subject, found.held_out).set_index(["model", "degradation_pct"])
    return {
        "outcome": str(found.decision.outcome),
        "causes": list(found.decision.causes),
        "threshold": found.threshold,
        "log_evidence": found.search.base.log_evidence,
        "misfit": {"statistic": found.misfit.statistic, "p_value": found.misfit.p_value},
        "misfit_left": {"statistic": found.left.statistic, "p_value": found.left.p_value},
        "rupture_p_value": None if found.rupture is None else found.rupture.p_value,
        "candidates": {
            one.cause: {
                "log_bayes_factor": one.log_bayes_factor,
                "explained_fraction": one.explained_fraction,
                "elpd_diff": one.elpd_diff,
                "elpd_diff_se": one.elpd_diff_se,
                "effect": {name: [size.mean, size.sd] for name, size in one.effect.items()},
            }
            for one in found.candidates
            if one.log_bayes_factor is not None
        },
        "held_out": {
            model: dict(zip(subject.groups, one.log_density.tolist(), strict=True))
            for model, one in found.held_out.items()
        },
        "gain": {
            str(model): {str(name): float(value) for name, value in row.items()}
            for model, row in gains.xs("all", level="degradation_pct").iterrows()
        },
    }


def idle(cause: Cause) -> Cause:
    """Return a cause that does nothing."""
    return replace(cause, **{hook: _unchanged for hook in HOOKS if getattr(cause, hook)})


def scaled(factor: float) -> Callable[[Cause], Cause]:
    """Return what makes a cause act as with its first parameter that much farther off neutral."""

    def mutated(cause: Cause) -> Cause:
        size = cause.parameters[0]

        def wrong(hook: Callable[..., object]) -> Callable[..., object]:
            def acting(state: object, conditions: object, effect: Effect, *rest: object) -> object:
                moved = size.neutral + factor * (effect[size.name] - size.neutral)
                return hook(state, conditions, {**effect, size.name: moved}, *rest)

            return acting

        hooks = {name: getattr(cause, name) for name in HOOKS}
        return replace(cause, **{name: wrong(hook) for name, hook in hooks.items() if hook})

    return mutated


def verdict_with(
    judgement: Judgement, name: str, mutate: Callable[[Cause], Cause] = idle
) -> Verdict:
    """Return the verdict of a catalogue in which one cause does something else, or nothing.

    The search is made anew, but what it knows already of sets without that cause is the same for
    both and is not computed twice. Further sets are fitted only with the cause that screening finds
    best. Held-out specimens, the dear part, are taken to agree with all that is found: they can but
    take causes away, so a test that fails this verdict fails the whole one.
    """
    search = search_with(judgement.search, name, mutate)
    chosen = run_search(search)
    agreed = [
        replace(one, elpd_diff=np.inf, elpd_diff_se=0.0, together=None)
        for one in (supports(search, chosen, {}))
    ]
    decision = decide(
        search.step(BASE),
        search.step(chosen),
        agreed,
        rupture=judgement.rupture,
        contradicted=judgement.contradicted,
        on_rupture=frozenset(cause.name for cause in search.causes if cause.is_of_rupture_alone),
        stated=stated_sets(search, chosen, agreed),
    )
    generator, trial = np.random.default_rng(0), search.trials[chosen]
    return replace(
        _told(judgement),
        outcome=str(decision.outcome),
        causes=decision.causes,
        sets=decision.sets,
        sizes={
            cause.name: {
                p: (s.mean, s.sd) for p, s in effect_sizes(trial, cause, generator).items()
            }
            for cause in trial.subject.causes
        },
        **_evidence(agreed, search.step(BASE).threshold),
    )


def search_with(search: Search, name: str, mutate: Callable[[Cause], Cause]) -> Search:
    """Return a search with another cause of that name, and with what is known without it."""
    causes = tuple(mutate(c) if c.name == name else c for c in search.causes)
    other = replace(search, causes=causes, effort=NARROW, trials={}, steps={}, on_fit=None)
    other.trials |= {n: trial for n, trial in search.trials.items() if name not in n}
    [mutant] = (cause for cause in causes if cause.name == name)
    for names, step in search.steps.items():
        if name not in names:
            others = [cause for cause in causes if cause.name not in names]
            other.steps[names] = _screened_with(step, mutant, others)
    return other


def _screened_with(step: Step, mutant: Cause, others: list[Cause]) -> Step:
    """Return what is known of a set where another cause has become something else."""
    linear = step.trial.linear
    found = {mutant.name: screen(linear, mutant)}
    chance = factors_by_chance(linear, others, step.simulated)
    return replace(
        step,
        screened=step.screened | found,
        threshold=naming_threshold(chance),
        chance=chance,
        unbent=step.unbent | found if mutant.name in step.unbent else step.unbent,
    )


def _unchanged(state: object, *_: object) -> object:
    return state


def _told(judgement: Judgement) -> Verdict:
    rupture, described = judgement.rupture, judgement.missing
    chief = None if described is None else described.chief
    return Verdict(
        str(judgement.decision.outcome),
        judgement.decision.causes,
        {
            c.cause: {name: (size.mean, size.sd) for name, size in c.effect.items()}
            for c in judgement.candidates
        },
        p_value=judgement.misfit.p_value,
        rupture_p_value=1.0 if rupture is None else rupture.p_value,
        reasons=judgement.decision.reasons,
        terms=() if described is None else described.found.terms,
        chief="" if chief is None else chief.column,
        sets=judgement.decision.sets,
        proposed=tuple(
            (one.separates, one.expected_log_bayes_factor) for one in judgement.experiments
        ),
        **_evidence(judgement.supported, judgement.threshold),
    )


def _evidence(supported: Iterable[Support], threshold: float) -> dict[str, dict[str, float]]:
    found = list(supported)
    return {
        "factors": {one.cause: one.log_bayes_factor - threshold for one in found},
        "confirmed": {one.cause: one.held_out_agrees for one in found},
    }
