"""What is wrong with the base model, and how sure that is, in plain words."""

from bayesdeg.criticism.conflict import Questioned
from bayesdeg.criticism.discrepancy import MISFIT_LEVEL
from bayesdeg.criticism.search import FALSE_NAME_RATE
from bayesdeg.criticism.verdict import Outcome, uncalibrated
from bayesdeg.pipeline.judgement import Judgement

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
            f"(p = {judgement.left.p_value:.2g}): errors taken for wide may hide a misfit."
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
            f"{ruptures.expected:.1f} (p = {ruptures.p_value:.2g})."
        )
    if mean is not None and mean.p_value <= SMALL_CHANCE:
        measured = mean.statistic
        parts.append(
            f"Calibrated without a cause, the model takes {mean.wanted:.3g} for the "
            f"{measured.quantity.replace('_', ' ')}, where {measured.value:.3g} ± "
            f"{measured.se:.2g} was measured ({measured.source}; p = {mean.p_value:.2g})."
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


def _not_chance(judgement: Judgement) -> str:
    count, p = len(judgement.misfit.null), judgement.misfit.p_value
    larger = round(p * (count + 1) - 1)
    return (
        f"Of {count} data sets simulated from the calibrated model, {larger or 'none'} misfit as "
        f"much (p = {p:.3g})."
    )
