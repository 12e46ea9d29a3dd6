"""Choose the further runs of the emulator's design: where its first stage is least certain.

Reads the solved runs of the first stage from the campaign's store (solving what is missing), and
writes ``bayesdeg/surrogate/second_stage.json``, which the design then uses for every geometry.

    uv run python benchmarks/second_stage.py --coarse 64 --fine 24

The posterior variance of a linear fit depends on where runs were made, not on their results; times
the squared errors found there it gives the error of a prediction. A run at row r lowers the
variance at row j by K_rj²/(1 + K_rr), K the covariance of the predictions.
"""

import argparse
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import complete, runs
from bayesdeg.surrogate.coordinates import Coordinates, coordinates
from bayesdeg.surrogate.design import SECOND_STAGE, SHARES, candidates, likely
from bayesdeg.surrogate.fit import PLANS
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.regression import (
    DERIVATIVE_WEIGHT,
    Observed,
    Prior,
    half_ranges,
    observe,
    rows_of,
)
from bayesdeg.surrogate.scaling import Place, TrainingRange
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.terms import Family, Terms, feature_gradients, features
from bayesdeg.surrogate.trained import default_surrogate

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Question:
    """A linear fit to be improved by additional runs.

    Parameters
    ----------
    orders : array, shape (n_terms, 13)
        Its terms.
    prior : Prior
        Prior of its coefficients.
    normal : array, shape (n_terms, n_terms)
        Σ AᵢᵀAᵢ of the runs so far, columns scaled by the prior.
    errors : Terms
        ln of squared relative errors of the first output.
    """

    orders: Indices
    prior: Prior
    normal: Floats
    errors: Terms


def most_informative(
    question: Question,
    candidates: Sequence[Curve],
    count: int,
    *,
    likely: Sequence[Curve],
    span: TrainingRange,
    on_pick: Callable[[int], None] = lambda index: None,
) -> list[int]:
    """Choose candidates to solve sequentially, each given those before.

    A candidate is judged by the sum of the gains of its single readings; once chosen, its readings
    and derivatives count together.

    Parameters
    ----------
    question : Question
        The fit, and the runs so far.
    candidates : sequence of Curve
        Possible runs.
    count : int
        Number of runs to choose.
    likely : sequence of Curve
        Draws from the prior, over which the predictive variance is averaged.
    span : TrainingRange
        Range of the emulator.
    on_pick : callable, optional
        Called with the index of each.
    """
    scales = question.prior.scales(question.orders)
    normal = question.normal + question.prior.noise**2 * np.eye(len(scales))
    places = [_places(curve, span) for curve in candidates]
    targets = np.vstack([_places(curve, span).points for curve in likely])
    sizes = np.exp(features(question.errors.orders, targets) @ question.errors.coefficients[0])
    weights = np.tile(np.square(SHARES), len(likely)) * sizes
    offered = scales * features(question.orders, np.vstack([p.points for p in places]))
    wanted = scales * features(question.orders, targets)
    picked: list[int] = []
    for _ in range(count):
        factor = cholesky(normal, lower=True)
        at, to = (solve_triangular(factor, rows.T, lower=True) for rows in (offered, wanted))
        lowered = np.square(at.T @ to) @ weights / (1.0 + np.sum(at * at, axis=0))
        gain = lowered.reshape(len(candidates), -1).sum(axis=1)
        gain[picked] = 0.0
        best = int(np.argmax(gain))
        picked.append(best)
        on_pick(best)
        # the rows that the run would add: values and derivatives
        place, shares = places[best], np.array(SHARES)[:, None]
        slopes = feature_gradients(question.orders, place.points)
        sizes = DERIVATIVE_WEIGHT * half_ranges(span)
        along = np.einsum("npt,npk->nkt", slopes, place.jacobian) * sizes[None, :, None]
        weighted = (shares[..., None] * along).reshape(-1, len(question.orders))
        values = shares * features(question.orders, place.points)
        rows = np.vstack([values, weighted]) * scales
        normal += rows.T @ rows
    return picked


def _places(curve: Curve, span: TrainingRange) -> Coordinates:
    place = Place.of(curve.material)
    loads = np.array(SHARES) * curve.loads[-1] / place.modulus
    found = coordinates(np.column_stack([loads, np.tile(place.values, (len(loads), 1))]))
    found.points[:, 0] = np.minimum(found.points[:, 0], 1.0)
    return found


def question(observed: list[Observed], family: Family, prior: Prior) -> Question:
    orders, span = family.orders, TrainingRange()
    scales = prior.scales(orders)
    scaled = [rows_of(run, orders, outputs=[0], span=span).matrix * scales for run in observed]
    normal = sum((one.T @ one for one in scaled[1:]), scaled[0].T @ scaled[0])
    return Question(orders, prior, normal, default_surrogate().error)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--coarse", type=int, default=64, help="further runs of the coarse mesh")
    parser.add_argument("--fine", type=int, default=24, help="further runs of the fine mesh")
    parser.add_argument("--store", type=Path, default=Path(".cache/campaign"))
    chosen = parser.parse_args()
    recipe, span = replace(Recipe(), further=False), TrainingRange()
    wanted = runs(Geometry(Dimensions()), recipe)
    solved = complete(wanted, SolutionStore(chosen.store))
    observed: list[tuple[Curve, Observed | None]] = [
        (run.curve, observe(run.curve, found, span=span, length=50.0))
        for run, found in zip(wanted, solved, strict=True)
        if isinstance(found, PathSamples)
    ]
    many, few = observed[: recipe.coarse_runs], observed[recipe.coarse_runs :]
    plan, pool = PLANS[0], candidates(span)
    coarse = most_informative(
        question([o for _, o in many if o is not None], plan.family, plan.prior),
        pool,
        chosen.coarse,
        likely=likely(span),
        span=span,
        on_pick=lambda index: print(f"coarse {index}: {pool[index].material}", flush=True),
    )
    twins = [curve for curve, _ in many[recipe.fine_runs :]] + [pool[k] for k in coarse]
    fine = most_informative(
        question([o for _, o in few if o is not None], plan.correction, plan.correction_prior),
        twins,
        chosen.fine,
        likely=likely(span),
        span=span,
        on_pick=lambda index: print(f"fine {index}: {twins[index].material}", flush=True),
    )
    made = "uv run python benchmarks/second_stage.py"
    content = {"command": f"{made} --coarse {chosen.coarse} --fine {chosen.fine}"}
    picks = {"coarse": coarse, "fine": fine}
    SECOND_STAGE.write_text(json.dumps(content | picks) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
