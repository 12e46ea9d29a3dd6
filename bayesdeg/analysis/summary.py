"""A judgement in numbers and words, mainly for a user's forward map.

If a misfit is left, no value of a parameter is reliable, since the parameter has absorbed part of
it: a Gaussian-process discrepancy makes the interval wider, not correct
(Brynjarsdóttir and O'Hagan 2014, doi:10.1088/0266-5611/30/11/114007).
"""

from typing import Any

import numpy as np

from bayesdeg.analysis.judge import Judgement
from bayesdeg.criticism.checks.discrepancy import Misfit
from bayesdeg.criticism.decide.verdict import fraction_explained
from bayesdeg.criticism.fit.search import Names
from bayesdeg.pages.wording import worded
from bayesdeg.quantities import p_value_text

SEED = 0  # seed of the summarised draws


def summary(judgement: Judgement) -> dict[str, Any]:
    """Return outcome, misfit, every fitted set of causes, and reliable parameter values.

    Returns
    -------
    dict
        With names and numbers alone. Log Bayes factors [nats] are against the model without a
        cause; ``explained_fraction`` is None where there is no more misfit than chance gives;
        ``trusted`` has mean, sd and 90 % interval of each base parameter, in its unit, or
        None where no model that was tried may be believed.
    """
    search = judgement.search
    base, final = (step.misfit for step in judgement.steps)
    parameters, degrades = search.base.subject.table.parameters, search.base.subject.world.degrades
    return {
        "outcome": str(judgement.decision.outcome),
        "causes": list(judgement.decision.causes),
        "reasons": [worded(reason, degrades=degrades) for reason in judgement.decision.reasons],
        "favoured": sorted(judgement.chosen),
        "threshold": judgement.threshold,
        "misfit": _misfit(base),
        "misfit_left": _misfit(final),
        "explained_fraction": fraction_explained(*judgement.steps),
        "held_out": {one.cause: [one.elpd_diff, one.elpd_diff_se] for one in judgement.supported},
        "units": {p.name: p.unit for p in search.trials[judgement.chosen].subject.table.parameters}
        | {c.qualified(p.name): p.unit for c in search.causes for p in c.parameters},
        "fitted": [_fitted(judgement, names) for names in sorted(search.trials, key=sorted)],
        "trusted": {p.name: _trusted(judgement, p.name) for p in parameters},
    }


def _misfit(misfit: Misfit) -> dict[str, float]:
    return {
        "statistic": misfit.statistic,
        "p_value": misfit.p_value,
        "replicates": len(misfit.null),
    }


def _in_words(misfit: dict[str, float], unit: str = "") -> str:
    chance = p_value_text(misfit["p_value"], misfit["replicates"])
    return f"{misfit['statistic']:.1f}{unit}, {chance}"


def lines(found: dict[str, Any]) -> list[str]:
    """Return a summary in words, one line per statement."""
    units = {name: f" {unit}".removesuffix(" –") for name, unit in found["units"].items()}
    left = found["misfit_left"]
    causes = " or " if found["outcome"] == "ambiguous" else " and "
    said = f": {causes.join(found['causes'])}" if found["causes"] else ""
    out = [f"outcome: {found['outcome']}{said}"]
    out += [f"  not named: {reason}" for reason in found["reasons"]]
    out.append(
        f"misfit: {_in_words(found['misfit'], ' nats')}; "
        f"left with {_name(found['favoured'])}: {_in_words(left)}"
    )
    for one in found["fitted"]:
        sizes = (f"{n} = {m:.3g} ± {s:.2g}{units[n]}" for n, (m, s) in one["posterior"].items())
        out.append(
            f"  {_name(one['causes'])}: ln Bayes factor {one['log_bayes_factor']:+.1f}; "
            + ", ".join(sizes)
        )
    for name, (gain, error) in found["held_out"].items():
        out.append(f"held out, with {name}: log density {gain:+.1f} ± {error:.1f}")
    for name, value in found["trusted"].items():
        if value is None:
            out.append(f"{name}: unreliable, since every model leaves a misfit")
        else:
            low, high = value["interval_90"]
            out.append(f"{name}: {low:.3g} to {high:.3g}{units[name]} (90 %)")
    return out


def _fitted(judgement: Judgement, names: Names) -> dict[str, Any]:
    trial, generator = judgement.search.trials[names], np.random.default_rng(SEED)
    draws = {n: trial.named_draws(n, generator) for n in trial.subject.table.names}
    return {
        "causes": sorted(names),
        "log_bayes_factor": judgement.search.factor(names),
        "posterior": {n: [float(np.mean(d)), float(np.std(d))] for n, d in draws.items()},
    }


def _trusted(judgement: Judgement, name: str) -> dict[str, Any] | None:
    draws = judgement.draws(name, np.random.default_rng(SEED))
    if not len(draws):
        return None
    return {
        "mean": float(np.mean(draws)),
        "sd": float(np.std(draws)),
        "interval_90": np.quantile(draws, [0.05, 0.95]).tolist(),
    }


def _name(causes: list[str]) -> str:
    return " + ".join(causes) or "no cause"
