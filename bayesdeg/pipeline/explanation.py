"""The verdict in plain words."""

from dataclasses import dataclass

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.candidates import Candidate, EffectSize
from bayesdeg.criticism.discrepancy import MISFIT_LEVEL
from bayesdeg.criticism.verdict import Outcome, share_explained
from bayesdeg.pipeline.explanation_of_films import by_mode, hidden, one_mode
from bayesdeg.pipeline.judgement import Judgement
from bayesdeg.pipeline.misfit_in_words import beside, chance, edge, wrong
from bayesdeg.pipeline.support_in_words import directed, gains, predicted_with
from bayesdeg.priors import Parameter

Json = dict[str, object]

LIKELY = 0.5  # of a cause: a reader of the table asks why it is not named


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
        Outcome.NOT_JUDGED: _not_judged,
    }[judgement.decision.outcome](story)
    return " ".join(part for part in (words, beside(judgement), edge(judgement)) if part)


def _adequate(story: Story) -> str:
    said = (
        "The simulation agrees with the measurements within specimen scatter and reading noise "
        f"({chance(story.judgement)}). No cause is named."
    )
    parts = (said, _not_named(story.judgement), hidden(story.judgement.alike))
    return " ".join(part for part in parts if part)


def _not_named(judgement: Judgement) -> str:
    """Say why a cause that the table shows as likely is not named; empty if there is none."""
    if judgement.supported:
        favoured = " and ".join(one.cause for one in judgement.supported)
        why = "; ".join(judgement.decision.reasons)
        return f"The evidence favours {favoured}, which is not named: {why}."
    likely = [c for c in judgement.candidates if (c.probability or 0.0) >= LIKELY]
    if not likely or likely[0].log_bayes_factor is None:
        return ""
    best, factor = likely[0], likely[0].log_bayes_factor
    if factor >= judgement.threshold:
        why = "is that of screening, and no full fit confirms it"
    else:
        why = (
            f"is below the {judgement.threshold:.1f} that naming takes: data simulated without it "
            "reach such a factor too"
        )
    return (
        f"The table shows {best.cause} as the likeliest cause; it is not named, as its log Bayes "
        f"factor {factor:.1f} {why}."
    )


def _unexplained(story: Story) -> str:
    judgement = story.judgement
    text = f"{_off(story)} No cause in the catalogue accounts for it."
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


def _off(story: Story) -> str:
    """Say what is wrong: readings, or values that fit them and should not."""
    judgement = story.judgement
    if judgement.questioned and judgement.misfit.p_value > MISFIT_LEVEL:
        return (
            "The readings alone agree with the simulation, but only at values that the priors all "
            "but exclude, and that is a misfit too."
        )
    return wrong(judgement, story.where)


def _not_judged(story: Story) -> str:
    """Say why nothing can be said, and what was seen."""
    judgement = story.judgement
    why = "; ".join(judgement.decision.reasons)
    if not judgement.supported:
        return (
            "Nothing can be said of whether the base model is adequate, and no cause is named. Of "
            f"its misfit, {why}. {story.where}"
        ).strip()
    favoured = " and ".join(one.cause for one in judgement.supported)
    return (
        f"{story.where} The readings favour {favoured}, but nothing is judged and nothing named: "
        f"{why}."
    ).strip()


def _ambiguous(story: Story) -> str:
    judgement = story.judgement
    names = " or ".join(judgement.decision.causes)
    if not judgement.supported:
        said = (
            wrong(judgement, story.where),
            one_mode(names),
            _mechanisms(judgement),
        )
        return " ".join(said)
    parts = [
        wrong(judgement, story.where),
        f"It is explained by {names}; these readings cannot tell them apart.",
        directed(judgement),
        _mechanisms(judgement),
        *(gains(judgement) if len(judgement.supported) > 1 else ()),
        _left(judgement),
        predicted_with(judgement),
    ]
    return " ".join(part for part in parts if part)


def _named(story: Story) -> str:
    judgement, causes = story.judgement, story.judgement.decision.causes
    verb = "The cause is" if len(causes) == 1 else "The causes, acting together, are"
    parts = [
        wrong(judgement, story.where),
        f"{verb} {'; and '.join(_cause(judgement, name) for name in causes)}.",
    ]
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
    if not judgement.left.p_value <= MISFIT_LEVEL:  # nan where it could not be calibrated
        return ""
    return (
        f"What is left is still more than chance gives (p = {judgement.left.p_value:.2g}, from "
        f"{len(judgement.left.null)} data sets simulated from the extended model): something that "
        "is not named is wrong too."
    )


def _share(judgement: Judgement) -> str:
    """Say how much of the misfit is explained, and on whose scale where that matters."""
    if judgement.misfit.statistic <= judgement.misfit.by_chance:
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


def _cause(judgement: Judgement, name: str) -> str:
    found = _entry(judgement, name)
    cause = _known(judgement, name)
    size = "; ".join(_size(p, found.effect[p.name]) for p in cause.parameters)
    return f"{name}: {cause.mechanism} ({size})"


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


def _mechanisms(judgement: Judgement) -> str:
    names = judgement.decision.causes
    return " ".join(f"{name}: {_known(judgement, name).mechanism}." for name in names)


def _known(judgement: Judgement, name: str) -> Cause:
    """Return a cause by its name: one of the catalogue, or one of the user's own."""
    if name in CATALOGUE:
        return CATALOGUE[name]
    return next(cause for cause in judgement.search.causes if cause.name == name)
