"""The headline of a report: the verdict in one sentence, two reasons and three numbers.

The sentences are in ``templates/headline.j2``; this module prepares their facts.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import pandas as pd

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.findings import Candidate
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.pages.record import ForwardMapEntry, VerdictRecord
from bayesdeg.pages.summaries import BASE, Row, extended_model, pooled, rows_of
from bayesdeg.pages.wording import (
    NOTHING,
    SPACE,
    begun,
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
SURE = 0.99999  # largest probability shown, however it was rounded: more than 99.9 %


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
    misfit = KeyNumber("Misfit of the base model", str(facts["size"]), _note("misfit", facts))
    counted = counts_of(verdict)
    if verdict.judged:
        numbers = [misfit, _certainty(verdict, facts), _gained(facts)]
        of_readings = [first_sentence(verdict.misfit.where), sentences("headline", "made", **facts)]
        if facts["ruptures"]:
            of_readings.reverse()
        lede = [*counted, *of_readings] if facts["by_counts"] else [*of_readings, *counted]
    else:
        numbers, lede = [misfit], [*counted, first_sentence(verdict.explanation)]
    said = sentences("headline", "sentence", **facts)
    return Headline(BADGES[verdict.outcome], said, tuple(numbers), tuple(filter(None, lede)))


def _facts(verdict: VerdictRecord, gain: pd.DataFrame | None) -> Mapping[str, object]:
    """Return the facts for the templates."""
    found = [verdict.candidate(cause) for cause in verdict.causes]
    fractions = [one.explained_fraction for one in found if one]
    tested = map(verdict.candidate, verdict.predicted_with or verdict.causes)
    passed = [one.naming_p_value for one in tested if one and one.naming_p_value]
    of_counts = {name for one in verdict.rupture_counts for name in one.explained_by}
    lists = [names for names in verdict.sets if len(names) > 1 and not of_counts & {*names}]
    by_ruptures = _by_ruptures(verdict)
    # curvatures; stresses or other readings where there are none
    rms, noise, unit, kind = verdict.misfit.sizes
    # errors on held-out specimens before and after; the gain in density where there are none
    rows = {str(row["model"]): row for row in rows_of(pooled(gain))}
    extended = rows.get(extended_model(gain, verdict) or "", {})
    after, gained = _error(extended, verdict.misfit.unit), ""
    if extended and not after:
        ends = (extended[name] for name in ("elpd_diff", "elpd_diff_se"))
        gained = plus_minus(*(None if end is None else float(end) for end in ends), sign=True)
    return {
        "v": verdict,
        "SPACE": SPACE,
        "sized": _sized(verdict) if verdict.causes else "",
        "either": sentences("headline", "possible", v=verdict),
        "first": begun(words(verdict.causes[0])) if verdict.causes else "",
        "beside": lists,
        "off_priors": fits_off_priors(verdict),
        "by_counts": by_ruptures or _by_counts(verdict),
        "ruptures": verdict.ruptures if by_ruptures else None,
        "share": max((one for one in fractions if one is not None), default=None),
        "best": _best(verdict),
        "directed": max(passed, default=None),
        "unknown": bool(found) and all(one and one.probability is None for one in found),
        "among": any(one.probability is None for one in verdict.candidates),
        "rms": rms,
        "noise": noise,
        "unit": unit,
        "kind": kind,
        "size": NOTHING if rms is None else _with_unit(fixed(rms), unit),
        "before": _error(rows.get(BASE, {}), verdict.misfit.unit),
        "after": after,
        "gain": gained,
    }


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
    return bool(found) and verdict.misfit.is_within_chance and set(verdict.causes) <= named


def _by_ruptures(verdict: VerdictRecord) -> bool:
    """Return whether only the study's own ruptures support the causes, which act on no reading.

    How much of the misfit of readings such a cause explains is then irrelevant.
    """
    silent = all(
        name in CATALOGUE and CATALOGUE[name].is_of_rupture_alone for name in verdict.causes
    )
    told = bool(verdict.causes) and silent and verdict.ruptures is not None
    return told and verdict.misfit.is_within_chance


def _note(of: str, facts: Mapping[str, object]) -> str:
    return sentences("headline", f"{of}_note", **facts)


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
    if verdict.outcome is Outcome.ADEQUATE or facts["unknown"]:
        value = p_value(verdict.misfit.p_value, verdict.misfit.replicates)
    else:
        found = [verdict.candidate(cause) for cause in verdict.causes]
        known = [None if one is None else one.probability for one in found]
        value = " / ".join(percent(None if one is None else min(one, SURE)) for one in known)
    return KeyNumber("How sure", value, _note("certainty", facts))


def _gained(facts: Mapping[str, object]) -> KeyNumber:
    note, before, after = _note("gain", facts), str(facts["before"]), str(facts["after"])
    if facts["gain"]:
        return KeyNumber("Gain on held-out specimens", str(facts["gain"]), note)
    ends = f"{before.split(SPACE)[0]} → {after}" if before and after else after or before
    return KeyNumber("Error on held-out specimens", ends or NOTHING, note)


def _error(row: Row, other: str) -> str:
    """Return the error of a row of the gain with its unit; empty where it has none."""
    for score, unit in (("rmse_per_m", "1/m"), ("rmse_MPa", "MPa"), ("rmse", other)):
        if row.get(score) is not None:
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
    return bool(verdict.parameters_in_question) and verdict.misfit.is_within_chance


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
    doubts = [one.why for one in verdict.suspects]
    if verdict.forward_map is not None:
        doubts = [*forward_map_words(verdict.forward_map), *doubts]
    if verdict.with_suspects is not None:
        facts = {"whole": verdict.with_suspects, "v": verdict}
        doubts.append(sentences("headline", "with_suspects", **facts))
    for one in verdict.parameters_in_question:
        doubts.append(sentences("headline", "in_question", one=one, SPACE=SPACE))
    return tuple(doubts)


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
