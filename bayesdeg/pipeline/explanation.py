"""What is wrong with the base model, and how sure that is, in plain words.

The sentences are in ``report/templates/verdict.j2``; here are the facts of which they speak.
"""

from dataclasses import dataclass

import numpy as np

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.decide.candidates import Candidate, EffectSize
from bayesdeg.criticism.decide.verdict import share_explained, uncalibrated
from bayesdeg.criticism.fit.search import FALSE_NAME_RATE
from bayesdeg.criticism.holdout.gain import mode_table
from bayesdeg.criticism.outcome import MISFIT_LEVEL
from bayesdeg.pipeline.judge import Judgement
from bayesdeg.priors import Parameter
from bayesdeg.report.wording import SPACE, sentences, worded

LARGEST_LOSS = 0.05  # of simulated data sets, before the reader is warned
SMALL_CHANCE = 0.05  # p-value of ruptures that deserves a sentence
FEW_ERRORS = 2.0  # standard errors within which a gain may as well be nothing
LIKELY = 0.5  # of a cause: a reader of the table asks why it is not named


@dataclass(frozen=True)
class _NamedCause:
    name: str
    mechanism: str
    sizes: tuple[str, ...]


@dataclass(frozen=True)
class _Rival:
    name: str
    cause: str
    gap: float


@dataclass(frozen=True)
class _ModeError:
    name: str
    before: float
    after: float


def explain(judgement: Judgement, where: str) -> str:
    """Return one paragraph: what is wrong, why, how sure, what else it could be.

    Parameters
    ----------
    judgement : Judgement
        The verdict.
    where : str
        Where the misfit is, in a sentence.
    """
    misfit, decision = judgement.misfit, judgement.decision
    count = len(misfit.null)
    counted, degrades = judgement.counted, judgement.search.base.subject.degrades
    contradicted = counted is not None and counted.misfit.contradicts
    said = sentences(
        "verdict",
        "explanation",
        j=judgement,
        degrades=degrades,
        counts=worded(counted, degrades=degrades) if contradicted else "",
        by_counts_alone=contradicted and _agrees_otherwise(judgement),
        where=where,
        outcome=str(decision.outcome),
        catalogue={name: _known(judgement, name) for name in decision.causes},
        causes=[_named(judgement, name) for name in decision.causes],
        named_or=" or ".join(decision.causes),
        favoured=" and ".join(one.cause for one in judgement.supported),
        reasons="; ".join(worded(one, degrades=degrades) for one in decision.reasons),
        uncalibrated="" if misfit.is_calibrated else worded(uncalibrated(misfit)),
        count=count,
        larger=round(misfit.p_value * (count + 1) - 1) if np.isfinite(misfit.p_value) else 0,
        likely=_likely(judgement),
        nearest=_nearest(judgement),
        rival=_rival(judgement),
        shares=_shares(judgement),
        modes=_modes(judgement),
        level=MISFIT_LEVEL,
        false_name_rate=FALSE_NAME_RATE,
        small_chance=SMALL_CHANCE,
        largest_loss=LARGEST_LOSS,
        few_errors=FEW_ERRORS,
    )
    return said.replace(SPACE, " ")


def _agrees_otherwise(judgement: Judgement) -> bool:
    """Return whether nothing but counts of ruptures speaks against the base model."""
    rupture, mean = judgement.rupture, judgement.contradicted
    beside = [one.p_value for one in (rupture, mean) if one is not None]
    shared = any(one.is_more_than_chance for one in judgement.shared)
    quiet = judgement.misfit.p_value > MISFIT_LEVEL and all(p > MISFIT_LEVEL for p in beside)
    return quiet and not (judgement.supported or judgement.questioned or shared)


def _likely(judgement: Judgement) -> Candidate | None:
    """Return the cause that the table shows as likely."""
    return next((c for c in judgement.candidates if (c.probability or 0.0) >= LIKELY), None)


def _nearest(judgement: Judgement) -> Candidate | None:
    """Return the candidate with the largest log Bayes factor; None if none was judged."""
    judged = [c for c in judgement.candidates if c.log_bayes_factor is not None]
    return max(judged, key=lambda c: c.log_bayes_factor or 0.0, default=None)


def _shares(judgement: Judgement) -> tuple[float, float] | None:
    """Return what share of the misfit is explained on either scale; None where not known."""
    calibrated = judgement.misfit.is_calibrated and judgement.left.is_calibrated
    if not calibrated or judgement.misfit.statistic <= judgement.misfit.by_chance:
        return None
    own, common = share_explained(*judgement.steps)
    return round(own, 3), round(common, 3)


def _modes(judgement: Judgement) -> list[_ModeError]:
    """Return by how much modes that were left out are off, before and after [MPa]."""
    subject, held_out = judgement.search.base.subject, judgement.held_out
    whole = subject.holds_out_modes
    if not whole or len(held_out) < 2:
        return []
    ends = {name: held_out[name] for name in (next(iter(held_out)), list(held_out)[-1])}
    error = mode_table(subject, ends).pivot(index="mode", columns="model", values="rmse_MPa")
    return [
        _ModeError(str(mode), float(row.iloc[0]), float(row.iloc[1]))
        for mode, row in error[list(ends)].iterrows()
    ]


def _named(judgement: Judgement, name: str) -> _NamedCause:
    cause = _known(judgement, name)
    effect = next((c.effect for c in judgement.candidates if c.cause == name), {})
    sizes = tuple(_size(p, effect[p.name]) for p in cause.parameters if p.name in effect)
    return _NamedCause(name, cause.mechanism, sizes)


def _size(parameter: Parameter, effect: EffectSize) -> str:
    unit = "" if effect.unit == "–" else f" {effect.unit}"
    interval = f"90 % interval {effect.q05:.3g} to {effect.q95:.3g}"
    return f"{parameter.meaning}: {effect.mean:.3g}{unit}, {interval}"


def _rival(judgement: Judgement) -> _Rival | None:
    """Return the best of what could stand in a named cause's place, and how far it is behind."""
    rivals = [
        _Rival(name, one.cause, gap)
        for one in judgement.supported
        if one.cause in judgement.decision.causes
        for name, gap in one.rivals.items()
    ]
    return min(rivals, key=lambda rival: rival.gap, default=None)


def _known(judgement: Judgement, name: str) -> Cause:
    """Return a cause by its name: one that was tried, as the user's own, or of the catalogue."""
    tried = (cause for cause in judgement.search.causes if cause.name == name)
    return next(tried, None) or CATALOGUE[name]
