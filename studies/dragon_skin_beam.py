"""Stiffness of a sagging silicone beam from a motion-capture record.

The posterior of C1 from the positions of six markers, by emcee with finite element solutions; the
model errors that the record supports, those that it cannot tell apart, and why three published
moduli of the same beam differ.

Run as ``python studies/dragon_skin_beam.py [--out FOLDER] [--seed N] [--quick]``.
"""

import argparse
import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# many small matrices: threads of linear algebra cost more than they give
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import numpy as np
from dragon_skin import analysis, figures, published, scene, solutions
from dragon_skin.beam import Divisions
from dragon_skin.causes import MECHANICAL
from dragon_skin.page import embed, render
from dragon_skin.posterior import Posterior
from dragon_skin.record import REST, TIP, read, repeat_scatter
from dragon_skin.tables import show, tables
from dragon_skin.words import ASSUMPTIONS, SOURCE, TITLE, answers
from numpy.typing import NDArray
from rich.console import Console

from bayesdeg.inference.sampling import Effort as Sampling

Floats = NDArray[np.float64]

SEED = 20211121
STATED, SUPPORTED, LOAD_POINT, EVERYTHING = (
    "as stated",
    "supported",
    "supported + load point",
    "everything",
)


@dataclass(frozen=True)
class Effort:
    """Limits of the study.

    Parameters
    ----------
    meshes : tuple of divisions
        Three, rising; the map is made with the second.
    points : int
        Values of C1 that are solved.
    draws : int
        For each evidence.
    sampling : Sampling
        Of emcee.
    held_out : tuple of str
        Models that predict held-out load cases.
    """

    meshes: tuple[Divisions, Divisions, Divisions]
    points: int
    draws: int
    sampling: Sampling
    held_out: tuple[str, ...]


FULL = Effort(
    ((8, 2, 2), (12, 4, 4), (18, 6, 6)),
    6,
    1000,
    Sampling(effective=400.0, r_hat=1.01, chunk=200, longest=1200),
    (STATED, SUPPORTED, LOAD_POINT, EVERYTHING),
)
QUICK = Effort(
    ((6, 2, 2), (8, 2, 2), (12, 3, 3)),
    4,
    150,
    Sampling(effective=100.0, r_hat=1.1, chunk=80, longest=80),
    (STATED, SUPPORTED),
)


def fitted(
    record: Floats, forward: Any, generator: np.random.Generator, *, draws: int
) -> tuple[dict[str, analysis.Fit], list[dict[str, Any]]]:
    """Return the four models that are compared, and the rounds of the search."""
    base = Posterior(record, forward, (), np.ones(scene.SHAPE, dtype=bool))
    supported, rounds = analysis.search(base, generator, draws=draws)
    causes = supported.posterior.causes
    more = {LOAD_POINT: (*causes, "load_point"), EVERYTHING: (*causes, *MECHANICAL)}
    # more dimensions need more draws
    models = {
        STATED: analysis.fit(base, generator, draws=draws),
        SUPPORTED: supported,
        **{
            name: analysis.fit(
                supported.posterior.with_causes(names), generator, draws=4 * draws, near=supported
            )
            for name, names in more.items()
        },
    }
    return models, rounds


def infer(
    record: Floats, forward: Any, *, seed: int, effort: Effort
) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """Return the answers that rest on the record, and the figures."""
    seeds = np.random.SeedSequence(seed)
    generator = np.random.default_rng(seeds.spawn(1)[0])
    models, rounds = fitted(record, forward, generator, draws=effort.draws)
    one_by_one = analysis.one_by_one(models[SUPPORTED], generator, draws=effort.draws)
    held_out = analysis.hold_out(
        {name: models[name] for name in effort.held_out}, generator, draws=effort.draws
    )
    shown = (STATED, SUPPORTED, EVERYTHING)
    sampled = {n: analysis.sample(models[n], effort.sampling, seeds.spawn(1)[0]) for n in shown}
    modulus = {name: 6.0 * draws["c1"] for name, (draws, _) in sampled.items()}
    left = {n: analysis.residuals(models[n], generator) for n in (STATED, SUPPORTED)}
    at_rest = {name: r["mechanics"][:, REST, TIP] for name, r in left.items()}
    results: dict[str, Any] = {
        "posterior": {name: analysis.summarise(draws) for name, (draws, _) in sampled.items()},
        "sampling": {name: quality for name, (_, quality) in sampled.items()},
        "log_evidence": {name: f.log_evidence for name, f in models.items()},
        "log_evidence_error": {name: f.evidence.error for name, f in models.items()},
        "search": rounds,
        "one_by_one": one_by_one,
        "mechanical": analysis.sorted_out(one_by_one["added"]),
        "held_out": held_out,
        "residuals_mm": {
            name: {kind: values.tolist() for kind, values in r.items()} for name, r in left.items()
        },
        "published": {
            name: float(np.mean(modulus[EVERYTHING] < value))
            for name, value in published.MODULI.items()
        },
        "recipe": published.recipe(record, forward),
        "repeat_scatter_mm": repeat_scatter(record),
        "linearisation_rms_mm": {
            n: analysis.linearisation_error(models[n], generator) for n in shown
        },
    }
    middle = models[SUPPORTED].modulus(generator)
    drawn = {
        "Posterior of E; dashed: values published for the same beam.": figures.modulus_figure(
            modulus
        ),
        "Left: change of log evidence when a supported cause is removed (blue) or a mechanical "
        "one added (orange). Right: E with its standard deviation.": figures.causes_figure(
            one_by_one, middle
        ),
        "Observed less predicted positions of the tip markers at rest, both repeats. The supported "
        "model is shown without its free motions of the tip at rest, so the residuals are those of "
        "the mechanics.": figures.residual_figure(at_rest),
        "Height of the tip (mean of markers and repeats) in a held-out load case, with "
        "90 % bands of the prediction.": figures.held_out_figure(held_out),
    }
    return results, [{"caption": c, "image": embed(png)} for c, png in drawn.items()]


def run(out: Path, *, seed: int = SEED, effort: Effort = FULL) -> dict[str, Any]:
    """Solve, infer, and write answers.json and the page."""
    record, mesh = read(), effort.meshes[1]
    forward = solutions.build_map(mesh, effort.points)
    results, drawn = infer(record, forward, seed=seed, effort=effort)
    linearisation = results.pop("linearisation_rms_mm")
    results |= {
        "seed": seed,
        "meshes": solutions.converge(list(effort.meshes), published.COMSOL_MODULUS / 6.0),
        "comsol": solutions.against_comsol(effort.meshes[2]),
        "accuracy": {
            "map_mm": solutions.check_map(forward, mesh, np.random.default_rng(seed)),
            "linearisation_rms_mm": linearisation,
        },
    }
    results = dict(_plain(results))
    texts = answers(results)
    page = render(
        title=TITLE,
        source=SOURCE,
        answers=texts,
        figures=drawn,
        tables=tables(results),
        assumptions=ASSUMPTIONS,
        seed=seed,
        quick=effort is not FULL,
    )
    out.mkdir(parents=True, exist_ok=True)
    (out / "index.html").write_text(page, encoding="utf-8")
    text = json.dumps({"answers": texts, **results}, indent=1, ensure_ascii=False, allow_nan=False)
    (out / "answers.json").write_text(text + "\n", encoding="utf-8")
    show(results, texts, Console())
    return results


def _plain(value: Any) -> Any:
    """Return nested results as JSON knows them; what is not finite becomes null."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("reports/dragon_skin_beam"))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--quick", action="store_true", help="coarse mesh, few draws")
    arguments = parser.parse_args()
    run(arguments.out, seed=arguments.seed, effort=QUICK if arguments.quick else FULL)


if __name__ == "__main__":
    main()
