"""The verdict in plain words, and as the document that others' tools read."""

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.verdict import (
    FALSE_NAME_RATE,
    LEAST_EXPLAINED,
    Candidate,
    EffectSize,
    Outcome,
    probabilities,
)
from bayesdeg.pipeline.judge import Judgement

Json = dict[str, object]

LARGEST_LOSS = 0.05  # of simulated data sets, before the reader is warned


def verdict_document(judgement: Judgement, where: str) -> Json:
    """Return the content of ``verdict.json`` for a study with actuator readings."""
    misfit, decision = judgement.misfit, judgement.decision
    shares = probabilities([c for c in judgement.candidates if not c.why])
    return {
        "outcome": str(decision.outcome),
        "causes": list(decision.causes),
        "explanation": explain(judgement, where),
        "candidates": [_candidate(c, shares.get(c.cause)) for c in judgement.candidates],
        "confusable": [list(pair) for pair in judgement.confusable],
        "false_name_rate": FALSE_NAME_RATE,
        "misfit": {
            "rms_per_m": misfit.rms,
            "noise_per_m": misfit.noise,
            "p_value": misfit.p_value,
            "where": where,
        },
        "next_experiments": [],
    }


def unjudged_document(unjudged: dict[str, str], held_out: str = "") -> Json:
    """Return the content of ``verdict.json`` for a study without actuator readings.

    Parameters
    ----------
    unjudged : dict of str to str
        Causes, and why each cannot be judged.
    held_out : str
        What is wrong with modes of tension that were predicted only.
    """
    return {
        "outcome": str(Outcome.ADEQUATE),
        "causes": [],
        "explanation": "There are no readings of an actuator in this study, so there is no "
        "misfit of the actuator model to judge and no cause is named. "
        + (held_out or "What the material law gets right is shown with the tensile data."),
        "candidates": [
            _candidate(Candidate(n, *4 * (None,), {}, w), None) for n, w in unjudged.items()
        ],
        "confusable": [],
        "false_name_rate": None,
        "misfit": {"rms_per_m": None, "noise_per_m": None, "p_value": None, "where": ""},
        "next_experiments": [],
    }


def explain(judgement: Judgement, where: str) -> str:
    """Return one paragraph: what is wrong, why, how sure, what else it could be."""
    outcome = judgement.decision.outcome
    text = {
        Outcome.ADEQUATE: lambda: _adequate(judgement),
        Outcome.UNEXPLAINED: lambda: _unexplained(judgement, where),
        Outcome.AMBIGUOUS: lambda: _ambiguous(judgement, where),
        Outcome.NAMED: lambda: _named(judgement, where),
    }[outcome]()
    return f"{text} {_edge(judgement)}".strip()


def _adequate(judgement: Judgement) -> str:
    return (
        "The simulation agrees with the measurements within specimen scatter and reading noise "
        f"({_chance(judgement)}). No cause is named."
    )


def _unexplained(judgement: Judgement, where: str) -> str:
    judged = [c for c in judgement.candidates if c.log_bayes_factor is not None]
    text = f"{where} {_not_chance(judgement)} No cause in the catalogue accounts for it."
    if not judged:
        return text
    best = max(judged, key=lambda c: c.log_bayes_factor or 0.0)
    reasons = []
    if (best.log_bayes_factor or 0.0) < judgement.threshold:
        reasons.append(
            f"its log Bayes factor {best.log_bayes_factor:.1f} is below the "
            f"{judgement.threshold:.1f} that naming takes"
        )
    if not (best.explained_fraction or 0.0) >= LEAST_EXPLAINED:
        reasons.append(
            f"it removes only {100 * (best.explained_fraction or 0.0):.0f} % of the misfit"
        )
    if best.elpd_diff is not None and best.elpd_diff <= (best.elpd_diff_se or 0.0):
        reasons.append("held-out specimens are not predicted better with it")
    because = f": {'; '.join(reasons)}" if reasons else ""
    return f"{text} The nearest is {best.cause}{because}."


def _ambiguous(judgement: Judgement, where: str) -> str:
    names = " or ".join(judgement.decision.causes)
    return (
        f"{where} {_not_chance(judgement)} It is explained by {names}; these readings cannot tell "
        f"them apart. {_mechanisms(judgement)}"
    )


def _named(judgement: Judgement, where: str) -> str:
    best = _leader(judgement)
    size = ", ".join(_size(name, effect) for name, effect in best.effect.items())
    return (
        f"{where} {_not_chance(judgement)} The cause is {best.cause}: "
        f"{CATALOGUE[best.cause].mechanism}. Its size: {size}. With it "
        f"{100 * (best.explained_fraction or 0.0):.0f} % of the misfit is explained, and specimens "
        f"that took no part in the calibration are predicted better by {best.elpd_diff:.1f} ± "
        f"{best.elpd_diff_se:.1f} in log density. {_runner_up(judgement)}"
    ).strip()


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


def _size(name: str, effect: EffectSize) -> str:
    unit = "" if effect.unit == "–" else f" {effect.unit}"
    interval = f"90 % interval {effect.q05:.3g} to {effect.q95:.3g}"
    return f"{name.replace('_', ' ')} {effect.mean:.3g}{unit} ({interval})"


def _leader(judgement: Judgement) -> Candidate:
    return next(c for c in judgement.candidates if c.cause == judgement.decision.causes[0])


def _runner_up(judgement: Judgement) -> str:
    best = _leader(judgement)
    others = [
        c for c in judgement.candidates if c.log_bayes_factor is not None and c.cause != best.cause
    ]
    if not others:
        return ""
    rival = max(others, key=lambda c: c.log_bayes_factor or -1e9)
    gap = (best.log_bayes_factor or 0.0) - (rival.log_bayes_factor or 0.0)
    if gap < 0.0:
        share = 100 * (rival.explained_fraction or 0.0)
        return (
            f"{rival.cause} has the larger evidence, but it explains only {share:.0f} % of the "
            "misfit or does not predict held-out specimens better."
        )
    return f"The next best candidate, {rival.cause}, is {gap:.1f} behind in log Bayes factor."


def _mechanisms(judgement: Judgement) -> str:
    return " ".join(f"{name}: {CATALOGUE[name].mechanism}." for name in judgement.decision.causes)


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


def _candidate(candidate: Candidate, probability: float | None) -> Json:
    known = CATALOGUE.get(candidate.cause)
    entry: Json = {
        "cause": candidate.cause,
        "probability": probability,
        "log_bayes_factor": candidate.log_bayes_factor,
        "elpd_diff": candidate.elpd_diff,
        "elpd_diff_se": candidate.elpd_diff_se,
        "explained_fraction": candidate.explained_fraction,
        "effect": {name: vars(size) for name, size in candidate.effect.items()},
        "mechanism": known.mechanism if known else "",
    }
    if candidate.why:
        entry["why"] = candidate.why
    return entry
