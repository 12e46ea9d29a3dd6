"""What is wrong with the base model, and how sure that is, in plain words."""

from dataclasses import dataclass

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.checks.conflict import Questioned
from bayesdeg.criticism.checks.discrepancy import MISFIT_LEVEL, Misfit
from bayesdeg.criticism.decide.candidates import Candidate, EffectSize
from bayesdeg.criticism.decide.support import Support
from bayesdeg.criticism.decide.verdict import Outcome, share_explained, uncalibrated
from bayesdeg.criticism.fit.search import FALSE_NAME_RATE
from bayesdeg.criticism.holdout.gain import mode_table
from bayesdeg.criticism.holdout.held_out import HeldOut
from bayesdeg.inference.model import Model
from bayesdeg.pipeline.judge import Judgement
from bayesdeg.priors import Parameter
from bayesdeg.quantities import p_value_text

LARGEST_LOSS = 0.05  # of simulated data sets, before the reader is warned
SMALL_CHANCE = 0.05  # p-value of ruptures that deserves a sentence


def wrong(judgement: Judgement, where: str) -> str:
    """Say what is wrong, or that it is within chance; `where` says where the misfit sits."""
    if not judgement.misfit.is_calibrated:
        return f"{where} Of this misfit, {uncalibrated(judgement.misfit)}.".strip()
    no_cause = not judgement.decision.causes
    if judgement.misfit.p_value > FALSE_NAME_RATE and no_cause:
        return _hidden(judgement) or "The readings alone agree with the simulation."
    if judgement.misfit.p_value > MISFIT_LEVEL and not no_cause:
        return f"{where} As a whole that is within chance: {chance(judgement)}.".strip()
    return f"{where} {_not_chance(judgement)}".strip()


def _hidden(judgement: Judgement) -> str:
    """Say what a misfit that is within chance as a whole hides; empty if nothing is known of it."""
    alone = f"Taken alone, the readings agree with the simulation ({chance(judgement)}), but"
    favoured = " and ".join(one.cause for one in judgement.supported)
    if favoured and judgement.left.p_value <= MISFIT_LEVEL:
        return (
            f"{alone} they favour {favoured}, and what is left beside it is more than chance gives "
            f"({_p(judgement.left)}): errors taken for wide may hide a misfit."
        )
    if any(one.is_more_than_chance for one in judgement.shared):
        return (
            f"{alone} specimens differ by more than they should, and not one by one: those of one "
            "degradation rate deviate together. Ask what they have in common, such as the batch "
            "that they were cast from."
        )
    return ""


def beside(judgement: Judgement) -> str:
    """Return what the base model contradicts beside the readings: ruptures, means and priors."""
    parts = []
    ruptures, mean = judgement.rupture, judgement.contradicted
    if ruptures is not None and ruptures.p_value <= SMALL_CHANCE:
        parts.append(
            f"{ruptures.burst} actuators burst, where the base model expects "
            f"{ruptures.expected:.1f} ({p_value_text(ruptures.p_value, ruptures.known)})."
        )
    if mean is not None and mean.p_value <= SMALL_CHANCE:
        measured = mean.statistic
        parts.append(
            f"Calibrated without a cause, the model takes {mean.wanted:.3g} for the "
            f"{measured.quantity.replace('_', ' ')}, where {measured.value:.3g} ± "
            f"{measured.se:.2g} was measured ({measured.source}; "
            f"{p_value_text(mean.p_value)})."
        )
    if judgement.questioned and judgement.decision.outcome is not Outcome.NAMED:
        taken = "; ".join(_off_prior(one) for one in judgement.questioned)
        parts.append(
            "Calibrated without a cause, the model takes values that their priors all but exclude: "
            f"{taken}. Either a prior is wrong, or a reading, or something that the model does not "
            "have acts."
        )
    return " ".join(parts)


def _off_prior(one: Questioned) -> str:
    """Say what a model takes for a parameter, and what its prior expects."""
    low, high = one.expected
    unit = "" if one.parameter.unit == "–" else f" {one.parameter.unit}"
    return (
        f"{one.value:.3g}{unit} for {one.parameter.name} ({one.parameter.meaning}), where 99.9 % "
        f"of the prior lies within {low:.3g} to {high:.3g}{unit}"
    )


def edge(judgement: Judgement) -> str:
    """Warn where much of what the base model expects is out of the emulator's range."""
    lost = judgement.misfit.lost
    if lost <= LARGEST_LOSS:
        return ""
    return (
        f"Caution: {100 * lost:.0f} % of the data sets simulated from the calibrated model leave "
        "the range on which the emulator was trained, because actuators of this material are "
        "about to balloon at the highest pressures; leave those pressures out of actuator.csv "
        "and compare."
    )


def chance(judgement: Judgement) -> str:
    """Say how often chance gives a misfit as large as that of the base model."""
    count, p = len(judgement.misfit.null), judgement.misfit.p_value
    return f"{100 * p:.0f} % of {count} data sets simulated from the model misfit as much or more"


def _p(misfit: Misfit) -> str:
    return p_value_text(misfit.p_value, len(misfit.null))


def _not_chance(judgement: Judgement) -> str:
    count, p = len(judgement.misfit.null), judgement.misfit.p_value
    larger = round(p * (count + 1) - 1)
    return (
        f"Of {count} data sets simulated from the calibrated model, {larger or 'none'} misfit as "
        f"much ({_p(judgement.misfit)})."
    )


FEW_ERRORS = 2.0  # standard errors within which a gain may as well be nothing


def directed(judgement: Judgement) -> str:
    """Say what named where the misfit as a whole does not show it: a test with a p-value each.

    Empty where the misfit as a whole shows it too.
    """
    known = [(one.cause, one.chance) for one in judgement.supported if one.chance is not None]
    if not known or not judgement.misfit.p_value > MISFIT_LEVEL:  # nan where not calibrated
        return ""
    count = len(judgement.steps[0].chance)
    shares = " and ".join(
        f"{p_value_text(p, count)} in data simulated without {name}" for name, p in known
    )
    return (
        "What names is a test directed at the candidates, which sees what the misfit as a whole, "
        "measured without a candidate in mind, does not: by chance the best of them gains as much "
        f"evidence with {shares}."
    )


def gains(judgement: Judgement) -> list[str]:
    """Say what each favoured cause adds to the prediction of what was left out, and all of them."""
    known = [one for one in judgement.supported if one.elpd_diff is not None]
    several = len(judgement.supported) > 1
    found = [_gain(one, several=several) for one in known]
    together = known[0].together if known else None
    if several and together is not None:
        found.append(f"All of them together raise it by {together[0]:.1f} ± {together[1]:.1f}.")
    return found


def predicted_with(judgement: Judgement) -> str:
    """Say with which of the causes that cannot be told apart predictions are made."""
    used = judgement.predicted_with
    if not used:
        return ""
    return (
        f"Bands, ruptures and decisions are predicted with {' and '.join(used)}, one of "
        "the possible answers; the others may predict differently where nothing was measured."
    )


def _gain(one: Support, *, several: bool) -> str:
    gain, error = one.elpd_diff or 0.0, one.elpd_diff_se or 0.0
    beside = " beside the others" if several else ""
    text = (
        f"What was left out of the calibration in turn is predicted better with {one.cause}"
        f"{beside} by {gain:.1f} ± {error:.1f} in log density"
    )
    if several and abs(gain) < FEW_ERRORS * error:
        text += (
            ", which is within two standard errors of nothing: held-out specimens neither confirm "
            f"nor contradict {one.cause} by itself"
        )
    return f"{text}."


ANY_CURVE = "any stress–stretch curve in one mode of tension is that of some energy in I₁ alone"


def one_mode(names: str) -> str:
    """Say why a misfit in a single mode names nothing.

    Parameters
    ----------
    names : str
        What it may be, as a list in words.
    """
    return (
        f"It may be {names}, or no more than the form of the law: {ANY_CURVE}, so these films "
        "cannot tell them apart, and nothing is named."
    )


def hidden(names: tuple[str, ...]) -> str:
    """Say which causes a single mode would not have shown; empty if there is none.

    Examples
    --------
    >>> hidden(())
    ''
    >>> hidden(("second_invariant", "stress_measure"))[:57]
    'Whether second_invariant or stress_measure acts these fil'
    """
    if not names:
        return ""
    return f"Whether {' or '.join(names)} acts these films cannot show: {ANY_CURVE}."


def by_mode(subject: Model, held_out: dict[str, HeldOut]) -> str:
    """Say how far predictions of modes that were left out are off, before and after.

    Parameters
    ----------
    subject : Model
        The base model.
    held_out : dict of str to HeldOut
        The base model first, the one with all that is named last.

    Returns
    -------
    str
        Empty where no whole modes were held out, or nothing was added.
    """
    whole = subject.holds_out_modes
    if not whole or len(held_out) < 2:
        return ""
    ends = {name: held_out[name] for name in (next(iter(held_out)), list(held_out)[-1])}
    error = mode_table(subject, ends).pivot(index="mode", columns="model", values="rmse_MPa")
    said = [
        f"{mode} {row.iloc[0]:.3f} → {row.iloc[1]:.3f} MPa"
        for mode, row in error[list(ends)].iterrows()
    ]
    return (
        "Each mode of tension predicted from the others, the root mean square error goes "
        f"{', '.join(said)}."
    )


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
            _mechanisms(judgement.decision.causes),
        )
        return " ".join(said)
    parts = [
        wrong(judgement, story.where),
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
        f"What is left is still more than chance gives ({_p(judgement.left)}, from "
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
    cause = CATALOGUE[name]
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


def _mechanisms(names: tuple[str, ...]) -> str:
    return " ".join(f"{name}: {CATALOGUE[name].mechanism}." for name in names)
