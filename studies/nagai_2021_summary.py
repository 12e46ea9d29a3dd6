"""What can be concluded from the published numbers of Nagai, Kurita, Shintake (2021) alone.

(a) With which probability does an error in D_R alone explain the published R²?
(b) Can the elongation limit alone explain 2 of 3 ruptures at 25 % and none below?

Run as ``python studies/nagai_2021_summary.py [--out FOLDER] [--seed N] [--quick]``.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from nagai_2021 import agreement, rupture
from nagai_2021.page import agreement_figure, embed, render, rupture_figure
from nagai_2021.published import Curves, Materials, draw, sensitivity
from nagai_2021.tables import agreement_tables, rupture_tables, show
from nagai_2021.words import AGREEMENT, RUPTURE, TITLE, agreement_answer, rupture_answer
from numpy.typing import NDArray

from bayesdeg.emulator.trained import default_surrogate
from bayesdeg.material.criteria import CRITERIA

Floats = NDArray[np.float64]

SEED = 20211124
ALONE, BOTH = "D_R error", "D_R and stiffness error"
DEGRADED = slice(1, None)


@dataclass(frozen=True)
class Effort:
    """Draws: of the material, for the variants, inner ones, and of walls per material."""

    outer: int = 8000
    variants: int = 3000
    inner: int = 48
    walls: int = 5


FULL = Effort()
QUICK = Effort(2000, 500, 32, 2)


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
        "ordering": ordering(fits[ALONE].sample),
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


def ordering(sample: Floats) -> dict[str, float]:
    """Return how often R² at 0 % falls below that at 5 %, and as far below as published."""
    gap = sample[..., 0] - sample[..., 1]
    published = agreement.TARGET[0] - agreement.TARGET[1]
    return {
        "fresh_below_5_pct": float(np.mean(gap > 0.0)),
        "as_far_below": float(np.mean(gap >= published)),
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


def run(out: Path, *, seed: int = SEED, effort: Effort = FULL) -> dict[str, Any]:
    """Answer both questions and write answers.json, the figures and the page."""
    generator = np.random.default_rng(seed)
    surrogate = default_surrogate()
    materials, curves = draw(surrogate, generator, effort.outer)
    a, figure_a = answer_agreement(materials, curves, generator, effort=effort)
    repeated = materials.take(np.tile(np.arange(effort.outer), effort.walls))
    b, figure_b = answer_rupture(rupture.draw_walls(surrogate, repeated, generator))
    a, b = {"answer": agreement_answer(a), **a}, {"answer": rupture_answer(b), **b}
    parts = [
        {**words, "answer": answer["answer"], "image": embed(figure), "tables": tables}
        for words, answer, figure, tables in (
            (AGREEMENT, a, figure_a, agreement_tables(a)),
            (RUPTURE, b, figure_b, rupture_tables(b)),
        )
    ]
    few = effort.outer < FULL.outer
    page = render(title=TITLE, parts=parts, seed=seed, draws=effort.outer, quick=few)
    answers = {"seed": seed, "draws": effort.outer, "agreement": a, "rupture": b}
    out.mkdir(parents=True, exist_ok=True)
    (out / "agreement.png").write_bytes(figure_a)
    (out / "rupture.png").write_bytes(figure_b)
    (out / "index.html").write_text(page, encoding="utf-8")
    text = json.dumps(answers, indent=1, ensure_ascii=False)
    (out / "answers.json").write_text(text + "\n", encoding="utf-8")
    show(parts)
    return answers


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
