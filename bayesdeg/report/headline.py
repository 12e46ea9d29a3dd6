"""The verdict in plain words: one sentence, two that say why, and three numbers."""

import re
from dataclasses import dataclass

import pandas as pd

from bayesdeg.criticism.checks.discrepancy import MISFIT_LEVEL
from bayesdeg.report.left_out import Stage
from bayesdeg.report.record import InQuestion, Outcome, Verdict
from bayesdeg.report.summaries import BASE, Row, extended_model, pooled, rows_of
from bayesdeg.report.wording import (
    BADGES,
    NOTHING,
    SPACE,
    fixed,
    listed,
    number,
    p_value,
    percent,
    words,
)

UNJUDGED = "The simulation could not be judged on this data"
SURE = 0.99999  # which is worded as more than 99.9 %


@dataclass(frozen=True)
class KeyNumber:
    """One of the numbers that stand beside the verdict."""

    label: str
    value: str
    note: str


@dataclass(frozen=True)
class Headline:
    """What a reader in a hurry takes away.

    Parameters
    ----------
    badge : str
        The outcome in one or two words.
    sentence : str
        The outcome in one sentence.
    numbers : tuple of KeyNumber
        Misfit beside noise, how sure, what was gained.
    lede : tuple of str
        What is wrong, and what was made of it: a sentence each.
    """

    badge: str
    sentence: str
    numbers: tuple[KeyNumber, ...]
    lede: tuple[str, ...] = ()


def headline_of(verdict: Verdict, gain: pd.DataFrame | None) -> Headline:
    """Word the verdict.

    Examples
    --------
    >>> from bayesdeg.report.record import verdict_of
    >>> named = verdict_of({"outcome": "named", "causes": ["creep"], "candidates": [],
    ...                     "misfit": {"rms_per_m": 2.0, "noise_per_m": 0.5, "p_value": 0.002}})
    >>> headline_of(named, None).sentence
    'The misfit is explained by creep'
    >>> headline_of(named, None).numbers[0].value.replace(SPACE, " ")
    '2.00 1/m'
    """
    badge, lede = BADGES[verdict.outcome], lede_of(verdict, gain)
    if not verdict.judged:
        return Headline(badge, UNJUDGED, (_misfit(verdict),), lede)
    numbers = (_misfit(verdict), _certainty(verdict), _gained(verdict, gain))
    return Headline(badge, _sentence(verdict), numbers, lede)


def _sentence(verdict: Verdict) -> str:
    match verdict.outcome:
        case Outcome.ADEQUATE if verdict.suspects:
            return "No misfit beyond the noise, but there are readings in doubt"
        case Outcome.ADEQUATE:
            return "No misfit beyond the noise"
        case Outcome.NAMED if verdict.is_directed:
            beyond = "though the misfit as a whole is within chance"
            return f"The readings speak for {_sized(verdict)}, {beyond}"
        case Outcome.NAMED:
            together = " acting together" if len(verdict.causes) > 1 else ""
            return f"The misfit is explained by {_sized(verdict)}{together}"
        case Outcome.AMBIGUOUS:
            either = " or ".join(words(cause) for cause in verdict.causes)
            if verdict.is_directed:
                within = (
                    "The misfit as a whole is within chance, yet the readings speak for a cause"
                )
                return f"{within}, and cannot tell which: {either}"
            return f"There is a misfit, and this data cannot tell its cause: {either}"
        case Outcome.UNEXPLAINED if fits_off_priors(verdict):
            odd = listed([one.parameter for one in verdict.in_question])
            return f"The readings fit only with values that the priors all but exclude: {odd}"
        case Outcome.UNEXPLAINED:
            return "There is a misfit, and no cause in the catalogue accounts for it"
        case Outcome.NOT_JUDGED:
            return UNJUDGED


def _sized(verdict: Verdict) -> str:
    """Name the causes with the size of each: of one alone with its 90 % interval."""
    alone = len(verdict.causes) == 1
    sizes = [(cause, size_of(verdict, cause, interval=alone)) for cause in verdict.causes]
    if alone:
        return ": ".join(filter(None, (words(sizes[0][0]), sizes[0][1])))
    return listed([f"{words(cause)} ({size})" if size else words(cause) for cause, size in sizes])


def size_of(verdict: Verdict, cause: str, *, interval: bool) -> str:
    """Word the first effect of a cause, which is its size; empty if it was not fitted.

    Examples
    --------
    >>> from bayesdeg.report.record import verdict_of
    >>> effect = {"offset": {"mean": 14.17, "sd": 0.25, "q05": 13.76, "q95": 14.57, "unit": "kPa"}}
    >>> leak = {"cause": "pressure_offset", "effect": effect}
    >>> verdict = verdict_of({"outcome": "named", "candidates": [leak]})
    >>> size_of(verdict, "pressure_offset", interval=True).replace(SPACE, " ")
    '14.2 kPa [13.8, 14.6]'
    """
    found = verdict.candidate(cause)
    if found is None or not found.effects or found.effects[0].mean is None:
        return ""
    effect = found.effects[0]
    unit = "" if effect.unit in ("", NOTHING) else f"{SPACE}{effect.unit}"
    name = "" if unit else f"{words(effect.name)} "
    ends = f" [{number(effect.q05)},{SPACE}{number(effect.q95)}]"
    known = interval and effect.q05 is not None and effect.q95 is not None
    return f"{name}{number(effect.mean)}{unit}{ends if known else ''}"


def fits_off_priors(verdict: Verdict) -> bool:
    """Return whether the readings alone agree with a model that takes values off their priors."""
    p_value = verdict.misfit.p_value
    return bool(verdict.in_question) and p_value is not None and p_value > MISFIT_LEVEL


def doubts_of(verdict: Verdict) -> tuple[str, ...]:
    """Return what speaks against taking a verdict as it is: one sentence each.

    Examples
    --------
    >>> from bayesdeg.report.record import verdict_of
    >>> question = {"parameter": "volume_ratio", "meaning": "α", "unit": "–", "median": 0.976,
    ...             "prior_low": 0.39, "prior_high": 0.85}
    >>> doubts_of(verdict_of({"outcome": "adequate", "parameters_in_question": [question]}))
    ('volume ratio is calibrated to 0.976 (α); 99.9 % of its prior lies within 0.390 to 0.850.',)
    """
    return (*verdict.suspects, *(_in_question(one) for one in verdict.in_question))


def _in_question(one: InQuestion) -> str:
    unit = "" if one.unit in ("", "–") else f"{SPACE}{one.unit}"
    low, high = number(one.prior_low), number(one.prior_high)
    return (
        f"{words(one.parameter)} is calibrated to {number(one.median)}{unit} ({one.meaning}); "
        f"99.9 % of its prior lies within {low} to {high}{unit}."
    )


def _misfit(verdict: Verdict) -> KeyNumber:
    misfit = verdict.misfit
    label = "Misfit of the base model"
    rms, noise, unit, kind = misfit.rms_per_m, misfit.noise_per_m, "1/m", "curvature"
    if rms is None:
        rms, noise, unit, kind = misfit.rms_mpa, misfit.noise_mpa, "MPa", "stress"
    if rms is None:
        failed = "the verdict was left out of this run"
        absent = "no actuator curvature to hold the simulation against"
        return KeyNumber(label, "–", failed if Stage.VERDICT in dict(verdict.left_out) else absent)
    note = f"rms in {kind}; the noise is {fixed(noise)}{SPACE}{unit}"
    if misfit.p_value is not None:
        note += f"; {_chance(verdict)}"
    if verdict.is_directed:
        note += f" as a whole{_directed(verdict)}"
    return KeyNumber(label, f"{fixed(rms)}{SPACE}{unit}", note)


def _directed(verdict: Verdict) -> str:
    """Say the largest p-value of the test that names, over the causes that passed it."""
    entries = (verdict.candidate(cause) for cause in verdict.predicted_with or verdict.causes)
    found = [entry.naming_p_value for entry in entries if entry and entry.naming_p_value]
    if not found:
        return ""
    largest = p_value(max(found), verdict.naming_replicates)
    return f", {largest} where it is directed at the candidates"


def _chance(verdict: Verdict) -> str:
    return p_value(verdict.misfit.p_value, verdict.misfit.replicates)


def _certainty(verdict: Verdict) -> KeyNumber:
    label, rate = "How sure", _false_names(verdict)
    if verdict.outcome is Outcome.ADEQUATE:
        chance = "how often a misfit this large comes about by chance"
        return KeyNumber(label, _chance(verdict), f"{chance}{rate}")
    if verdict.outcome is Outcome.UNEXPLAINED:
        return _best(verdict)
    found = [verdict.candidate(cause) for cause in verdict.causes]
    if found and all(entry is not None and entry.probability is None for entry in found):
        chance = "how often a misfit this large comes about by chance; of its cause nothing can be"
        return KeyNumber(label, _chance(verdict), f"{chance} said")
    shown = [percent(_less_than_sure(entry.probability)) if entry else NOTHING for entry in found]
    of = " and ".join(words(cause) for cause in verdict.causes)
    every = all(entry.probability is not None for entry in verdict.candidates)
    among = "" if every else " among the causes judged"
    return KeyNumber(label, " / ".join(shown), f"probability of {of}{among}{rate}")


def _less_than_sure(probability: float | None) -> float | None:
    """Return a probability that is short of 1, however it was rounded."""
    return None if probability is None else min(probability, SURE)


def _false_names(verdict: Verdict) -> str:
    if verdict.false_name_rate is None:
        return ""
    rate = percent(verdict.false_name_rate)
    return f"; where nothing is wrong, chance favours a cause in {rate} of such studies at most"


def _best(verdict: Verdict) -> KeyNumber:
    tried = [entry for entry in verdict.candidates if entry.explained_fraction is not None]
    if not tried:
        return KeyNumber("Best candidate", "–", "no cause could be tried on this data")
    best = max(tried, key=lambda entry: entry.explained_fraction or 0.0)
    note = f"of what there is to explain, by {words(best.cause)}: too little to name it"
    return KeyNumber("Best candidate explains", percent(best.explained_fraction), note)


def _gained(verdict: Verdict, gain: pd.DataFrame | None) -> KeyNumber:
    label, extended = "Error on held-out specimens", extended_model(gain, verdict)
    rows = {str(row["model"]): row for row in rows_of(pooled(gain))}
    base = rows.get(BASE)
    if extended is None or extended not in rows:
        adequate = verdict.outcome is Outcome.ADEQUATE
        why = (
            "no cause had to be added" if adequate else "nothing was gained, as no cause was named"
        )
        note = f"rms of the base model; {why}"
        if base is None:
            return KeyNumber(label, "–", "prediction of held-out specimens was not tried")
        return KeyNumber(label, _error(base), note)
    after = rows[extended]
    if after["rmse_per_m"] is None and after.get("rmse_MPa") is None:
        gained = f"{_elpd(after['elpd_diff'])} ± {_elpd(after['elpd_diff_se']).lstrip('+')}"
        return KeyNumber("Gain on held-out specimens", gained, "elpd, over the base model")
    before = f"{_error(base).split(SPACE)[0]} → " if base else ""
    plural = "s are" if len(verdict.causes) > 1 else " is"
    return KeyNumber(
        label, f"{before}{_error(after)}", f"rms before and after the cause{plural} in"
    )


def _error(row: Row) -> str:
    """Return the error of a row of the gain with its unit: of stresses where it has no other."""
    if row["rmse_per_m"] is None and row.get("rmse_MPa") is not None:
        return f"{_cell(row['rmse_MPa'])}{SPACE}MPa"
    return f"{_cell(row['rmse_per_m'])}{SPACE}1/m"


def lede_of(verdict: Verdict, gain: pd.DataFrame | None) -> tuple[str, ...]:
    """Return what is wrong and what was made of it, a sentence each; those that can be said."""
    if not verdict.judged:
        return tuple(filter(None, (first_sentence(verdict.explanation),)))
    match verdict.outcome:
        case Outcome.NAMED:
            made = _explained(verdict, gain)
        case Outcome.AMBIGUOUS:
            made = _open(verdict)
        case Outcome.ADEQUATE:
            made = "Data simulated from the calibrated model misfit as much: no cause is needed."
        case _:
            best = _best(verdict)
            made = f"{best.label} {best.value} {best.note}." if best.value != NOTHING else ""
    return tuple(filter(None, (first_sentence(verdict.misfit.where), made)))


def first_sentence(text: str) -> str:
    """Return the first sentence of a text, or what comes before its first semicolon.

    Examples
    --------
    >>> first_sentence("It departs by 0.3 MPa. Of 20 data sets, none misfit as much.")
    'It departs by 0.3 MPa.'
    >>> first_sentence("It departs by 0.3 MPa; most of it in one specimen.")
    'It departs by 0.3 MPa.'
    """
    first = re.split(r"(?:\.|;) ", text, maxsplit=1)[0]
    return first if not first or first.endswith(".") else f"{first}."


def _explained(verdict: Verdict, gain: pd.DataFrame | None) -> str:
    """Say what including the named causes does to held-out predictions."""
    extended = extended_model(gain, verdict)
    rows = {str(row["model"]): row for row in rows_of(pooled(gain))}
    fractions = [c.explained_fraction for c in map(verdict.candidate, verdict.causes) if c]
    share = max((fraction for fraction in fractions if fraction is not None), default=None)
    plural = len(verdict.causes) > 1
    doing = "Together they explain" if plural else f"{_begun(verdict.causes[0])} explains"
    said = "" if share is None else f"{doing} {percent(share)} of the misfit"
    if extended not in rows or BASE not in rows or _error(rows[BASE]).startswith(NOTHING):
        return f"{said}." if said else ""
    before, after = _error(rows[BASE]).split(SPACE)[0], _error(rows[extended])
    error = f"the error on held-out specimens goes from {before} to {after}"
    return f"{said}; {error}." if said else f"{error.capitalize()}."


def _begun(cause: str) -> str:
    """Word a cause at the beginning of a sentence."""
    name = words(cause)
    return name[0].upper() + name[1:]


def _open(verdict: Verdict) -> str:
    """Say what would tell apart causes that fit alike."""
    alike = "These fit alike, so none is named"
    if not verdict.next_experiments:
        return f"{alike}."
    return f"{alike}; what would tell most: {verdict.next_experiments[0].design}."


def _cell(value: float | str | None) -> str:
    return fixed(None if value is None else float(value))


def _elpd(value: float | str | None) -> str:
    return fixed(None if value is None else float(value), 1, sign=True)
