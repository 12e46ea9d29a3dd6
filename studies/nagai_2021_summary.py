"""Conclusions from the published numbers of Nagai, Kurita, Shintake (2021) alone.

First: how do the conclusions depend on the assumed reading error?
(a) What is the probability that an error in D_R alone explains the published R²?
(b) Can the elongation limit alone explain 2 of 3 ruptures at 25 % and none below?
(c) Which causes of the catalogue can explain R² lower at 0 % than at 5 %?
(d) Which causes can explain the ruptures?

Run as ``python studies/nagai_2021_summary.py [--out FOLDER] [--seed N] [--quick]``.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from nagai_2021 import (
    agreement,
    cause_agreement,
    cause_rupture,
    cause_words,
    explored,
    noise,
    rupture,
)
from nagai_2021.page import agreement_figure, embed, render, rupture_figure
from nagai_2021.published import Curves, Materials, draw, sensitivity
from nagai_2021.tables import (
    agreement_tables,
    cause_agreement_tables,
    cause_rupture_tables,
    noise_tables,
    rupture_tables,
    show,
)
from nagai_2021.words import (
    AGREEMENT,
    NOISE,
    RUPTURE,
    TITLE,
    agreement_answer,
    noise_answer,
    rupture_answer,
)
from numpy.typing import NDArray

from bayesdeg.material.strength import CRITERIA
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import default_surrogate

Floats = NDArray[np.float64]

SEED = 20211124
ALONE, BOTH = "D_R error", "D_R and stiffness error"
DEGRADED = slice(1, None)


@dataclass(frozen=True)
class Effort:
    """Draws: of the material, for the variants, inner ones, and of walls per material.

    For causes: draws and inner ones of three rounds, and of walls per material.
    """

    outer: int = 8000
    variants: int = 3000
    inner: int = 48
    walls: int = 5
    rounds: tuple[tuple[int, int], ...] = ((1500, 24), (1500, 32), (3500, 48))
    cause_walls: int = 2


FULL = Effort()
QUICK = Effort(2000, 500, 32, 2, ((200, 16), (200, 24), (300, 32)), 1)


def answer_agreement(
    materials: Materials, curves: Curves, generator: np.random.Generator, *, effort: Effort
) -> tuple[dict[str, Any], bytes]:
    """Return the answer to (a), and its figure."""
    fits = {
        name: agreement.fit(curves, model, generator, inner=effort.inner)
        for name, model in agreement.MODELS.items()
    }
    some = Curves(curves.log_curvature[: effort.variants], curves.growth[: effort.variants])
    variants = {}
    for words, changes in agreement.VARIANTS.items():
        changed = (
            fits
            if not changes
            else {
                name: agreement.fit(
                    some, agreement.variant(model, changes), generator, inner=effort.inner
                )
                for name, model in agreement.MODELS.items()
            }
        )
        variants[words] = compare(changed)
    both_ways = agreement.required_error(some)
    required = np.nanmean(both_ways, axis=-1)
    misfit = agreement.absolute_misfit(curves)
    models = variants["as stated"]
    result = {
        "probability_degradation_error_alone": models[ALONE]["probability"],
        "range": _span([models[ALONE]["probability"] for models in variants.values()]),
        "models": models,
        "variants": variants,
        "required_degradation_error_points": _by_level(required),
        "sensitivity_pct_per_point": _by_level(sensitivity(materials)),
        "misfit_per_m": _by_level(misfit),
        "ordering": agreement.ordering(fits[ALONE].sample),
    }
    samples = {name: resample(fit, generator) for name, fit in fits.items()}
    return result, agreement_figure(samples, required)


def compare(fits: dict[str, agreement.Fit]) -> dict[str, dict[str, float]]:
    """Return evidence and probability, at equal prior odds, of each model."""
    whole = {name: fit.log_evidence() for name, fit in fits.items()}
    degraded = {name: fit.log_evidence(DEGRADED) for name, fit in fits.items()}
    probability, without = (
        dict(zip(fits, _softmax([e[0] for e in evidence.values()]), strict=True))
        for evidence in (whole, degraded)
    )
    return {
        name: {
            "log_evidence": whole[name][0],
            "log_evidence_error": whole[name][1],
            "bayes_factor": float(np.exp(whole[name][0] - whole[ALONE][0])),
            "probability": probability[name],
            "probability_without_fresh": without[name],
        }
        for name in fits
    }


def resample(fit: agreement.Fit, generator: np.random.Generator, count: int = 20_000) -> Floats:
    """Draw ln(1 − R²) of imagined experiments under the posterior of a model."""
    rows = generator.choice(len(fit.sample), size=count, p=fit.weights())
    return fit.sample[rows, generator.integers(fit.sample.shape[1], size=count)]


def answer_rupture(walls: rupture.Walls) -> tuple[dict[str, Any], bytes]:
    """Return the answer to (b), and its figure."""
    chances = {h: rupture.probability_of_counts(walls, h) for h in rupture.HYPOTHESES}
    start = chances[rupture.Hypothesis()][0]
    result = {
        "hypotheses": {
            str(h): {
                "probability": value,
                "monte_carlo_error": error,
                "bayes_factor": value / start,
                "burst_probability": rupture.burst_probability(walls, h).mean(axis=0).tolist(),
            }
            for h, (value, error) in chances.items()
        },
        "probability_limit_alone": _span(_chosen(chances, concentration=False, flaws=False)),
        "probability_with_concentration": _span(_chosen(chances, concentration=True, flaws=False)),
        "probability_with_flaws": _span(_chosen(chances, concentration=False, flaws=True)),
        "probability_with_both": _span(_chosen(chances, concentration=True, flaws=True)),
        "required_factor": {c: _by_level(rupture.required_factor(walls, c)) for c in CRITERIA},
        "none_below_at_that_factor": {c: rupture.none_below(walls, c) for c in CRITERIA},
    }
    return result, rupture_figure(walls, {str(h): value for h, (value, _) in chances.items()})


def answer_causes(
    surrogate: Surrogate,
    materials: Materials,
    curves: Curves,
    generator: np.random.Generator,
    *,
    effort: Effort,
    models: dict[str, dict[str, float]],
) -> tuple[list[dict[str, Any]], dict[str, Any], dict[str, Any]]:
    """Return the dependence on the reading error, and the answers to (c) and (d)."""
    setting = explored.set_up(surrogate, materials, curves, generator, rounds=effort.rounds)
    of_agreement = cause_agreement.answer(setting, generator)
    repeated = materials.take(np.tile(np.arange(len(materials)), effort.cause_walls))
    shared = cause_rupture.share(surrogate, repeated, generator)
    of_rupture = cause_rupture.answer(shared, generator)
    some = Curves(curves.log_curvature[: effort.variants], curves.growth[: effort.variants])
    beside = {name: found[cause_agreement.WITH] for name, found in of_agreement["causes"].items()}
    by_noise = noise.dependence(
        setting,
        some,
        generator,
        compare=compare,
        inner=effort.inner,
        assumed={"models": models, "causes": noise.factors_of(beside)},
    )
    return by_noise, of_agreement, of_rupture


def run(out: Path, *, seed: int = SEED, effort: Effort = FULL) -> dict[str, Any]:
    """Answer all questions and write answers.json, the figures and the page."""
    generator = np.random.default_rng(seed)
    surrogate = default_surrogate()
    materials, curves = draw(surrogate, generator, effort.outer)
    a, figure_a = answer_agreement(materials, curves, generator, effort=effort)
    repeated = materials.take(np.tile(np.arange(effort.outer), effort.walls))
    b, figure_b = answer_rupture(rupture.draw_walls(surrogate, repeated, generator))
    by_noise, c, d = answer_causes(
        surrogate, materials, curves, generator, effort=effort, models=a["models"]
    )
    first = {"answer": noise_answer(by_noise), "by_noise": by_noise}
    a, b = {"answer": agreement_answer(a, by_noise), **a}, {"answer": rupture_answer(b), **b}
    c = {"answer": cause_words.agreement_answer(c, by_noise), **c}
    d = {"answer": cause_words.rupture_answer(d), **d}
    parts = [
        {**NOISE, **_part(first, noise_tables(by_noise))},
        {**AGREEMENT, **_part(a, agreement_tables(a)), "image": embed(figure_a)},
        {**RUPTURE, **_part(b, rupture_tables(b)), "image": embed(figure_b)},
        {
            **cause_words.AGREEMENT_OF_CAUSES,
            **_part(c, cause_agreement_tables(c)),
            "texts": cause_words.agreement_texts(c),
        },
        {
            **cause_words.RUPTURE_OF_CAUSES,
            **_part(d, cause_rupture_tables(d)),
            "texts": cause_words.rupture_texts(d),
        },
    ]
    answers = {"seed": seed, "draws": effort.outer, "reading_noise": first}
    answers |= {"agreement": a, "rupture": b}
    answers |= {"agreement_by_cause": c, "rupture_by_cause": d}
    page = render(
        title=TITLE,
        parts=parts,
        seed=seed,
        draws=effort.outer,
        quick=effort.outer < FULL.outer,
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / "agreement.png").write_bytes(figure_a)
    (out / "rupture.png").write_bytes(figure_b)
    (out / "index.html").write_text(page, encoding="utf-8")
    text = json.dumps(answers, indent=1, ensure_ascii=False)
    (out / "answers.json").write_text(text + "\n", encoding="utf-8")
    show(parts)
    return answers


def _part(answer: dict[str, Any], tables: list[dict[str, Any]]) -> dict[str, Any]:
    return {"answer": answer["answer"], "tables": tables}


def _by_level(values: Floats) -> dict[str, list[float]]:
    quantiles = np.nanquantile(values, (0.05, 0.5, 0.95), axis=0)
    return dict(zip(("q05", "median", "q95"), quantiles.tolist(), strict=True))


def _chosen(
    chances: dict[rupture.Hypothesis, tuple[float, float]], *, concentration: bool, flaws: bool
) -> list[float]:
    return [
        value
        for h, (value, _) in chances.items()
        if h.concentration == concentration and h.flaws == flaws
    ]


def _span(values: Sequence[float]) -> list[float]:
    return [min(values), max(values)]


def _softmax(logs: Sequence[float]) -> list[float]:
    weights = np.exp(np.array(logs) - max(logs))
    shares: list[float] = (weights / weights.sum()).tolist()
    return shares


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("reports/nagai_2021_summary"))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--quick", action="store_true", help="few draws, in seconds")
    arguments = parser.parse_args()
    run(arguments.out, seed=arguments.seed, effort=QUICK if arguments.quick else FULL)


if __name__ == "__main__":
    main()
