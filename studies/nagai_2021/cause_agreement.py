"""The first contradiction by cause: R² at 0 % below that at 5 %.

The simulation stays as it is; imagined experiments differ from it by one cause of the catalogue at
sizes from its prior, in addition to reading noise alone or with an error of D_R. Evidence is
compared with that of a D_R error alone, the paper's explanation, and split in two:

    P(R² at 0 … 25 %) = P(R² at 5 … 25 %) · P(R² at 0 % | R² at 5 … 25 %),

the second of which is what the contradiction is about.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from nagai_2021.agreement import MODELS, ordering
from nagai_2021.aimed import Evidence, evidence
from nagai_2021.causes import able, cannot_bend, size_of, values_at, weighted_quantiles, widened
from nagai_2021.explored import DEGRADED, SDS, Outcome, Setting, alter, explore

Floats = NDArray[np.float64]

BESIDE = {"alone": MODELS["noise only"], "with_degradation_error": MODELS["D_R error"]}
WITH = "with_degradation_error"
WIDTHS = {"half": 0.5, "double": 2.0}
LEADING = 3
DRAWS_TO_TELL = 200
NO_EFFECT = 1e-9
"""Changes of the readings below this are rounding [–]."""


def compare(outcome: Outcome, reference: Outcome) -> dict[str, float]:
    """Return evidence over that of the reference, and how often the published order arises."""
    whole = evidence(outcome.joint())
    factor, error = whole.over(evidence(reference.joint()))
    fresh, fresh_error = _of_fresh(outcome).over(_of_fresh(reference))
    return {
        "log_evidence": whole.log_value,
        "log_evidence_error": whole.error,
        "bayes_factor": factor,
        "bayes_factor_error": error,
        # as if what lies outside the emulator's range explained as much as the rest
        "bayes_factor_inside": factor / float(outcome.inside.mean()),
        "bayes_factor_of_fresh": fresh,
        "bayes_factor_of_fresh_error": fresh_error,
        "share_outside": float(1.0 - outcome.inside.mean()),
        **ordering(outcome.prior.sample[outcome.inside]),
    }


def judge(
    setting: Setting, cause: Cause, reference: Outcome, generator: np.random.Generator
) -> dict[str, Any]:
    """Return evidence, ordering and size of a cause alone and beside an error of D_R."""
    first = cause.parameters[0]
    found: dict[str, Any] = {"parameter": first.name, "unit": first.unit}
    found["prior"] = {
        name: float(first.law.quantile(at))
        for name, at in (("q05", 0.05), ("median", 0.5), ("q95", 0.95))
    }
    for name, model in BESIDE.items():
        outcome = explore(setting, model, generator, cause)
        size = size_of(cause, values_at(cause, outcome.scores.standard[:, SDS:]))
        weight = np.exp(outcome.joint() - outcome.joint().max())
        found[name] = {**compare(outcome, reference), "size": weighted_quantiles(size, weight)}
    return found


def changes_fresh(setting: Setting, cause: Cause, generator: np.random.Generator) -> bool:
    """Tell whether a cause changes any reading at 0 %, by draws of its size."""
    count = min(DRAWS_TO_TELL, len(setting.curves))
    scores = generator.standard_normal((count, len(cause.parameters)))
    altered = alter(setting, cause, values_at(cause, scores))
    moved = np.abs(altered.shift[:, 0]).max() + altered.scatter[:, 0].max()
    return bool(max(np.abs(altered.ratio[:, 0] - 1.0).max(), moved) > NO_EFFECT)


def answer(setting: Setting, generator: np.random.Generator) -> dict[str, Any]:
    """Return the evidence of every cause that can act, and why the others can't."""
    acting, silent = able(cannot_bend)
    base = {name: explore(setting, model, generator) for name, model in BESIDE.items()}
    reference = base[WITH]
    judged = {n: judge(setting, cause, reference, generator) for n, cause in acting.items()}
    for name, cause in acting.items():
        judged[name]["changes_fresh"] = changes_fresh(setting, cause, generator)
    order = sorted(judged, key=lambda name: -judged[name][WITH]["bayes_factor"])
    fresh = [name for name in order if judged[name]["changes_fresh"]]
    leading = [name for name in order if name in (*order[:1], *fresh[:LEADING])]
    widths = {
        name: {
            width: _beside(setting, widened(acting[name], factor), reference, generator)
            for width, factor in WIDTHS.items()
        }
        for name in leading
    }
    return {
        "without_cause": {name: compare(found, reference) for name, found in base.items()},
        "causes": {name: judged[name] for name in order},
        "prior_widths": widths,
        "cannot_act": silent,
    }


def _of_fresh(outcome: Outcome) -> Evidence:
    """Return the evidence of R² at 0 % given the others: a ratio of two on the same draws."""
    whole, degraded = outcome.joint(), outcome.joint(DEGRADED)
    above, below = evidence(whole), evidence(degraded)
    away = np.exp(whole - above.log_value) - np.exp(degraded - below.log_value)
    return Evidence(above.log_value - below.log_value, float(away.std(ddof=1) / np.sqrt(len(away))))


def _beside(
    setting: Setting, cause: Cause, reference: Outcome, generator: np.random.Generator
) -> dict[str, float]:
    return compare(explore(setting, BESIDE[WITH], generator, cause), reference)
