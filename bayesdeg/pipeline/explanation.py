"""The verdict in plain words."""

from dataclasses import dataclass

import numpy as np

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.candidates import Candidate, EffectSize
from bayesdeg.criticism.discrepancy import MISFIT_LEVEL
from bayesdeg.criticism.search import FALSE_NAME_RATE
from bayesdeg.criticism.verdict import Outcome, share_explained
from bayesdeg.laws import Parameter
from bayesdeg.pipeline.explanation_of_films import by_mode, hidden, one_mode
from bayesdeg.pipeline.judgement import Judgement
from bayesdeg.pipeline.support_in_words import directed, gains, predicted_with

Json = dict[str, object]

LARGEST_LOSS = 0.05  # of simulated data sets, before the reader is warned
SMALL_CHANCE = 0.05  # p-value of ruptures that deserves a sentence


@dataclass(frozen=True)
class Story:
    """What the words are about.

    Parameters
    ----------
    judgement : Judgement
        The verdict.
    where : str
        Where the misfit sits, in a sentence.
    """

    judgement: Judgement
    where: str


def explain(judgement: Judgement, where: str) -> str:
    """Return one paragraph: what is wrong, why, how sure, what else it could be."""
    story = Story(judgement, where)
    words = {
        Outcome.ADEQUATE: _adequate,
        Outcome.UNEXPLAINED: _unexplained,
        Outcome.AMBIGUOUS: _ambiguous,
        Outcome.NAMED: _named,
    }[judgement.decision.outcome](story)
    return " ".join(part for part in (words, _beside(judgement), _edge(judgement)) if part)


def _adequate(story: Story) -> str:
    said = (
        "The simulation agrees with the measurements within specimen scatter and reading noise "
        f"({_chance(story.judgement)}). No cause is named."
    )
    return " ".join(part for part in (said, hidden(story.judgement.alike)) if part)


def _unexplained(story: Story) -> str:
    judgement = story.judgement
    text = f"{_wrong(story)} No cause in the catalogue accounts for it."
    judged = [c for c in judgement.candidates if c.log_bayes_factor is not None]
    if not judged:
        return text
    if judgement.decision.reasons:
        nearest = " and ".join(one.cause for one in judgement.supported)
        return f"{text} The nearest is {nearest}: {'; '.join(judgement.decision.reasons)}."
    best = max(judged, key=lambda c: c.log_bayes_factor or 0.0)
    return (
        f"{text} The nearest is {best.cause}: its log Bayes factor {best.log_bayes_factor:.1f} is "
        f"below the {judgement.threshold:.1f} that naming takes."
    )


def _ambiguous(story: Story) -> str:
    judgement = story.judgement
    names = " or ".join(judgement.decision.causes)
    if not judgement.supported:
        return f"{_wrong(story)} {one_mode(names)} {_mechanisms(judgement.decision.causes)}"
    parts = [
        _wrong(story),
        f"It is explained by {names}; these readings cannot tell them apart.",
        directed(judgement),
        _mechanisms(judgement.decision.causes),
        *(gains(judgement) if len(judgement.supported) > 1 else ()),
        _left(judgement),
        predicted_with(judgement),
    ]
    return " ".join(part for part in parts if part)


def _named(story: Story) -> str:
    judgement, causes = story.judgement, story.judgement.decision.causes
    verb = "The cause is" if len(causes) == 1 else "The causes, acting together, are"
    parts = [_wrong(story), f"{verb} {'; and '.join(_cause(judgement, name) for name in causes)}."]
    parts += [_share(judgement), directed(judgement), *gains(judgement)]
    parts.append(by_mode(judgement.search.base.subject, judgement.held_out))
    parts += [
        f"Beside this one of {' or '.join(names)} acts; these readings cannot tell which."
        for names in judgement.decision.one_of
    ]
    parts += [_runner_up(judgement), _left(judgement)]
    return " ".join(part for part in parts if part)


def _left(judgement: Judgement) -> str:
    """Say so where what is left is no chance either."""
    if judgement.left.p_value > MISFIT_LEVEL:
        return ""
    return (
        f"What is left is still more than chance gives (p = {judgement.left.p_value:.2g}, from "
        f"{len(judgement.left.null)} data sets simulated from the extended model): something that "
        "is not named is wrong too."
    )


def _share(judgement: Judgement) -> str:
    """Say how much of the misfit is explained, and on whose scale where that matters."""
    if judgement.misfit.statistic <= float(np.mean(judgement.misfit.null)):
        return ""
    own, common = (round(100 * share) for share in share_explained(*judgement.steps))
    included = "it" if len(judgement.supported) == 1 else "them"
    text = f"With {included} {max(own, common)} % of the misfit is explained"
    if common > own:
        text += (
            f", against the errors of the model that has {included}: the model without takes part "
            "of the misfit for error"
        )
    return f"{text}."


def _wrong(story: Story) -> str:
    judgement = story.judgement
    if judgement.misfit.p_value > FALSE_NAME_RATE and not judgement.decision.causes:
        if judgement.supported and judgement.left.p_value <= MISFIT_LEVEL:
            favoured = " and ".join(one.cause for one in judgement.supported)
            return (
                f"Taken alone, the readings agree with the simulation ({_chance(judgement)}), but "
                f"they favour {favoured}, and what is left beside it is more than chance gives "
                f"(p = {judgement.left.p_value:.2g}): errors taken for wide may hide a misfit."
            )
        return "The readings alone agree with the simulation."
    if judgement.misfit.p_value > MISFIT_LEVEL and judgement.decision.causes:
        return f"{story.where} As a whole that is within chance: {_chance(judgement)}.".strip()
    return f"{story.where} {_not_chance(judgement)}".strip()


def _cause(judgement: Judgement, name: str) -> str:
    found = _entry(judgement, name)
    cause = CATALOGUE[name]
    size = "; ".join(_size(p, found.effect[p.name]) for p in cause.parameters)
    return f"{name}: {cause.mechanism} ({size})"


def _beside(judgement: Judgement) -> str:
    """Return what the base model contradicts beside the readings: ruptures and measured means."""
    parts = []
    ruptures, mean = judgement.rupture, judgement.contradicted
    if ruptures is not None and ruptures.p_value <= SMALL_CHANCE:
        parts.append(
            f"{ruptures.burst} actuators burst, where the base model expects "
            f"{ruptures.expected:.1f} (p = {ruptures.p_value:.2g})."
        )
    if mean is not None and mean.p_value <= SMALL_CHANCE:
        measured = mean.statistic
        parts.append(
            f"Calibrated without a cause, the model takes {mean.wanted:.3g} for the "
            f"{measured.quantity.replace('_', ' ')}, where {measured.value:.3g} ± "
            f"{measured.se:.2g} was measured ({measured.source}; p = {mean.p_value:.2g})."
        )
    return " ".join(parts)


def _edge(judgement: Judgement) -> str:
    lost = judgement.misfit.lost
    if lost <= LARGEST_LOSS:
        return ""
    return (
        f"Caution: {100 * lost:.0f} % of the data sets simulated from the calibrated model leave "
        "the range on which the emulator was trained, because actuators of this material are "
        "about to balloon at the highest pressures; leave those pressures out of actuator.csv "
        "and compare."
    )


def _size(parameter: Parameter, effect: EffectSize) -> str:
    unit = "" if effect.unit == "–" else f" {effect.unit}"
    interval = f"90 % interval {effect.q05:.3g} to {effect.q95:.3g}"
    return f"{parameter.meaning}: {effect.mean:.3g}{unit}, {interval}"


def _entry(judgement: Judgement, name: str) -> Candidate:
    return next(c for c in judgement.candidates if c.cause == name)


def _runner_up(judgement: Judgement) -> str:
    """Say by how much the best of what could stand in a named cause's place is behind."""
    gaps = {
        (rival, one.cause): gap
        for one in judgement.supported
        if one.cause in judgement.decision.causes
        for rival, gap in one.rivals.items()
    }
    if not gaps:
        return "No other cause comes near."
    rival, cause = min(gaps, key=lambda pair: gaps[pair])
    instead = f" in the place of {cause}" if len(judgement.supported) > 1 else ""
    return (
        f"The next best candidate{instead}, {rival}, is {gaps[rival, cause]:.1f} behind in log "
        "Bayes factor."
    )


def _mechanisms(names: tuple[str, ...]) -> str:
    return " ".join(f"{name}: {CATALOGUE[name].mechanism}." for name in names)


def _chance(judgement: Judgement) -> str:
    count, p = len(judgement.misfit.null), judgement.misfit.p_value
    return f"{100 * p:.0f} % of {count} data sets simulated from the model misfit as much or more"


def _not_chance(judgement: Judgement) -> str:
    count, p = len(judgement.misfit.null), judgement.misfit.p_value
    larger = round(p * (count + 1) - 1)
    return (
        f"Of {count} data sets simulated from the calibrated model, {larger or 'none'} misfit as "
        f"much (p = {p:.3g})."
    )
