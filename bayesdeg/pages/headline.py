"""The headline of a report: the verdict in one sentence, two reasons and three numbers.

The sentences are in ``templates/headline.j2``; this module prepares their facts.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.findings import Candidate
from bayesdeg.criticism.outcome import MISFIT_LEVEL, Outcome
from bayesdeg.pages.record import ForwardMapEntry, VerdictRecord
from bayesdeg.pages.summaries import BASE, Row, extended_model, pooled, rows_of
from bayesdeg.pages.wording import (
    NOTHING,
    SPACE,
    fixed,
    listed,
    number,
    p_value,
    percent,
    plus_minus,
    sentences,
    words,
)

BADGES = {
    Outcome.ADEQUATE: "Adequate",
    Outcome.NAMED: "Cause named",
    Outcome.AMBIGUOUS: "Ambiguous",
    Outcome.UNEXPLAINED: "Unexplained",
    Outcome.NOT_JUDGED: "Not judged",
}
SURE = 0.99999  # displayed as more than 99.9 %


@dataclass(frozen=True)
class KeyNumber:
    """One of the key numbers below the verdict."""

    label: str
    value: str
    note: str


@dataclass(frozen=True)
class Headline:
    """The verdict at a glance.

    Parameters
    ----------
    badge : str
        The outcome in one or two words.
    sentence : str
        The outcome in one sentence.
    numbers : tuple of KeyNumber
        Misfit and noise, how sure, and the gain.
    lede : tuple of str
        What is wrong, and how it was resolved: a sentence each.
    """

    badge: str
    sentence: str
    numbers: tuple[KeyNumber, ...]
    lede: tuple[str, ...] = ()


def headline_of(verdict: VerdictRecord, gain: pd.DataFrame | None) -> Headline:
    """Word the verdict.

    Examples
    --------
    >>> from bayesdeg.pages.record import VerdictRecord
    >>> named = VerdictRecord.read({"outcome": "named", "causes": ["creep"], "candidates": [],
    ...                     "misfit": {"rms_per_m": 2.0, "noise_per_m": 0.5, "p_value": 0.002}})
    >>> headline_of(named, None).sentence
    'The misfit is explained by creep'
    >>> headline_of(named, None).numbers[0].value.replace(SPACE, " ")
    '2.00 1/m'
    """
    facts = _facts(verdict, gain)
    sentence = sentences("headline", "sentence", **facts)
    misfit = KeyNumber("Misfit of the base model", str(facts["size"]), _note("misfit", facts))
    if not verdict.judged:
        lede = tuple(filter(None, (*counts_of(verdict), first_sentence(verdict.explanation))))
        return Headline(BADGES[verdict.outcome], sentence, (misfit,), lede)
    numbers = (misfit, _certainty(verdict, facts), _gained(facts))
    made = sentences("headline", "made", **facts)
    of_readings, of_counts = (first_sentence(verdict.misfit.where), made), counts_of(verdict)
    if facts["ruptures"]:
        of_readings = of_readings[::-1]
    both = (*of_counts, *of_readings) if facts["by_counts"] else (*of_readings, *of_counts)
    lede = tuple(filter(None, both))
    return Headline(BADGES[verdict.outcome], sentence, numbers, lede)


def _facts(verdict: VerdictRecord, gain: pd.DataFrame | None) -> Mapping[str, object]:
    """Return the facts for the templates."""
    found = [verdict.candidate(cause) for cause in verdict.causes]
    fractions = [one.explained_fraction for one in found if one]
    return {
        "v": verdict,
        "SPACE": SPACE,
        "sized": _sized(verdict) if verdict.causes else "",
        "either": sentences("headline", "possible", v=verdict),
        "first": _begun(verdict.causes[0]) if verdict.causes else "",
        "beside": _beside(verdict),
        "off_priors": fits_off_priors(verdict),
        "by_counts": _by_counts(verdict) or _by_ruptures(verdict),
        "ruptures": verdict.ruptures if _by_ruptures(verdict) else None,
        "share": max((one for one in fractions if one is not None), default=None),
        "best": _best(verdict),
        "directed": _directed(verdict),
        "unknown": bool(found) and all(one and one.probability is None for one in found),
        "among": any(one.probability is None for one in verdict.candidates),
        **_misfit_facts(verdict),
        **_gain_facts(verdict, gain),
    }


def _beside(verdict: VerdictRecord) -> tuple[tuple[str, ...], ...]:
    """Return lists from each of which one cause acts besides the named ones."""
    of_counts = {name for one in verdict.rupture_counts for name in one.explained_by}
    return tuple(names for names in verdict.sets if len(names) > 1 and not of_counts & {*names})


def sets_of(verdict: VerdictRecord) -> str:
    """Return the sets of causes that may be right, in a line; empty where there is one, or none.

    Examples
    --------
    >>> lists = [["creep"], ["pressure_loss", "film_mismatch"]]
    >>> sets_of(VerdictRecord.read({"outcome": "named", "sets": lists}))
    'creep × (pressure_loss or film_mismatch)'
    >>> sets_of(VerdictRecord.read({"outcome": "named", "sets": [["creep"]]}))
    ''
    """
    return sentences("headline", "sets", v=verdict)


def counts_of(verdict: VerdictRecord) -> tuple[str, ...]:
    """Return the rupture counts that contradict the model, and their explanation."""
    return tuple(
        sentences("headline", "counted", one=one, first=re.split(r"\. ", one.sentence)[0])
        for one in verdict.rupture_counts
        if one.contradicted
    )


def _by_counts(verdict: VerdictRecord) -> bool:
    """Return whether only rupture counts contradict the model."""
    found = [one for one in verdict.rupture_counts if one.contradicted]
    named = {name for one in found for name in one.explained_by}
    return bool(found) and _readings_agree(verdict) and set(verdict.causes) <= named


def _by_ruptures(verdict: VerdictRecord) -> bool:
    """Return whether only the study's own ruptures support the causes, which act on no reading.

    How much of the misfit of readings such a cause explains is then irrelevant.
    """
    silent = all(
        name in CATALOGUE and CATALOGUE[name].is_of_rupture_alone for name in verdict.causes
    )
    told = bool(verdict.causes) and silent and verdict.ruptures is not None
    return told and _readings_agree(verdict)


def _readings_agree(verdict: VerdictRecord) -> bool:
    p_value = verdict.misfit.p_value
    return p_value is not None and p_value > MISFIT_LEVEL


def _note(of: str, facts: Mapping[str, object]) -> str:
    return sentences("headline", f"{of}_note", **facts)


def _misfit_facts(verdict: VerdictRecord) -> dict[str, object]:
    """Return the misfit of curvatures; of stresses or other readings where there are none."""
    rms, noise, unit, kind = verdict.misfit.sizes
    size = NOTHING if rms is None else _with_unit(fixed(rms), unit)
    return {"rms": rms, "noise": noise, "unit": unit, "kind": kind, "size": size}


def _gain_facts(verdict: VerdictRecord, gain: pd.DataFrame | None) -> dict[str, str]:
    """Return errors on held-out specimens before and after; the gain where there are none."""
    rows = {str(row["model"]): row for row in rows_of(pooled(gain))}
    extended = rows.get(extended_model(gain, verdict) or "")
    unit = verdict.misfit.unit
    facts = {"before": _error(rows.get(BASE), unit), "after": _error(extended, unit), "gain": ""}
    if extended is not None and not facts["after"]:
        both = (_value(extended[name]) for name in ("elpd_diff", "elpd_diff_se"))
        facts["gain"] = plus_minus(*both, sign=True)
    return facts


def _directed(verdict: VerdictRecord) -> float | None:
    """Return the largest p-value of the test that names, over the causes that passed it."""
    entries = (verdict.candidate(cause) for cause in verdict.predicted_with or verdict.causes)
    found = (entry.naming_p_value for entry in entries if entry and entry.naming_p_value)
    return max(found, default=None)


def _best(verdict: VerdictRecord) -> Candidate | None:
    """Return the candidate that explains most; None if none was tried."""
    tried = [entry for entry in verdict.candidates if entry.explained_fraction is not None]
    return max(tried, key=lambda entry: entry.explained_fraction or 0.0, default=None)


def _certainty(verdict: VerdictRecord, facts: Mapping[str, object]) -> KeyNumber:
    if verdict.outcome is Outcome.UNEXPLAINED:
        best, note = _best(verdict), _note("best", facts)
        if best is None:
            return KeyNumber("Best candidate", NOTHING, note)
        return KeyNumber("Best candidate explains", percent(best.explained_fraction), note)
    found = [verdict.candidate(cause) for cause in verdict.causes]
    shown = [percent(_less_than_sure(entry.probability)) if entry else NOTHING for entry in found]
    by_chance = verdict.outcome is Outcome.ADEQUATE or facts["unknown"]
    value = (
        p_value(verdict.misfit.p_value, verdict.misfit.replicates)
        if by_chance
        else " / ".join(shown)
    )
    return KeyNumber("How sure", value, _note("certainty", facts))


def _less_than_sure(probability: float | None) -> float | None:
    """Return a probability below 1, however it was rounded."""
    return None if probability is None else min(probability, SURE)


def _gained(facts: Mapping[str, object]) -> KeyNumber:
    note, before, after = _note("gain", facts), str(facts["before"]), str(facts["after"])
    if facts["gain"]:
        return KeyNumber("Gain on held-out specimens", str(facts["gain"]), note)
    ends = f"{before.split(SPACE)[0]} → {after}" if before and after else after or before
    return KeyNumber("Error on held-out specimens", ends or NOTHING, note)


def _error(row: Row | None, other: str) -> str:
    """Return the error of a row of the gain with its unit; empty where it has none."""
    for score, unit in (("rmse_per_m", "1/m"), ("rmse_MPa", "MPa"), ("rmse", other)):
        if row is not None and row.get(score) is not None:
            return _with_unit(fixed(float(row[score] or 0.0)), unit)
    return ""


def _with_unit(text: str, unit: str) -> str:
    return text if unit in ("", NOTHING) else f"{text}{SPACE}{unit}"


def _sized(verdict: VerdictRecord) -> str:
    """Name the causes with the size of each: of one alone with its 90 % interval."""
    alone = len(verdict.causes) == 1
    sizes = [(cause, size_of(verdict, cause, interval=alone)) for cause in verdict.causes]
    if alone:
        return ": ".join(filter(None, (words(sizes[0][0]), sizes[0][1])))
    return listed([f"{words(cause)} ({size})" if size else words(cause) for cause, size in sizes])


def size_of(verdict: VerdictRecord, cause: str, *, interval: bool) -> str:
    """Word the first effect of a cause, which is its size; empty if it was not fitted.

    Examples
    --------
    >>> from bayesdeg.pages.record import VerdictRecord
    >>> effect = {"offset": {"mean": 14.17, "sd": 0.25, "q05": 13.76, "q95": 14.57, "unit": "kPa"}}
    >>> leak = {"cause": "pressure_offset", "effect": effect}
    >>> verdict = VerdictRecord.read({"outcome": "named", "candidates": [leak]})
    >>> size_of(verdict, "pressure_offset", interval=True).replace(SPACE, " ")
    '14.2 kPa [13.8, 14.6]'
    """
    found = verdict.candidate(cause)
    name, effect = next(iter(found.effect.items()), ("", None)) if found else ("", None)
    if effect is None or effect.mean is None:
        return ""
    unit = "" if effect.unit in ("", NOTHING) else f"{SPACE}{effect.unit}"
    said = "" if unit else f"{words(name)} "
    ends = f" [{number(effect.q05)},{SPACE}{number(effect.q95)}]"
    known = interval and effect.q05 is not None and effect.q05 != effect.q95
    return f"{said}{number(effect.mean)}{unit}{ends if known else ''}"


def fits_off_priors(verdict: VerdictRecord) -> bool:
    """Return whether the readings fit only with parameter values far outside their priors."""
    p_value = verdict.misfit.p_value
    return bool(verdict.parameters_in_question) and p_value is not None and p_value > MISFIT_LEVEL


def doubts_of(verdict: VerdictRecord) -> tuple[str, ...]:
    """Return the reasons to doubt a verdict, one sentence each.

    Examples
    --------
    >>> from bayesdeg.pages.record import VerdictRecord
    >>> question = {"parameter": "volume_ratio", "meaning": "α", "unit": "–", "median": 0.976,
    ...             "prior_low": 0.39, "prior_high": 0.85}
    >>> doubts_of(VerdictRecord.read({"outcome": "adequate", "parameters_in_question": [question]}))
    ('Volume ratio is calibrated to 0.976 (α); 99.9 % of its prior lies between 0.390 and 0.850.',)
    """
    suspects = (one.why for one in verdict.suspects)
    asked = verdict.parameters_in_question
    said = (sentences("headline", "in_question", one=one, SPACE=SPACE) for one in asked)
    whole = verdict.with_suspects
    facts = {"whole": whole, "v": verdict}
    other = [] if whole is None else [sentences("headline", "with_suspects", **facts)]
    own = () if verdict.forward_map is None else forward_map_words(verdict.forward_map)
    return (*own, *suspects, *other, *said)


def forward_map_words(one: ForwardMapEntry) -> tuple[str, ...]:
    """Say where a user's forward map fails, and how noisy it is.

    Examples
    --------
    >>> forward_map_words(ForwardMapEntry(prior_draws=400, prior_unanswered=0.0))
    ()
    """
    said = (sentences("headline", name, one=one) for name in ("unanswered", "map_noise"))
    return tuple(filter(None, said))


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


def _begun(cause: str) -> str:
    """Word a cause at the beginning of a sentence."""
    name = words(cause)
    return name[0].upper() + name[1:]


def _value(cell: float | str | None) -> float | None:
    return None if cell is None else float(cell)
