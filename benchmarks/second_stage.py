"""Choose the further runs of the emulator's design: where its first stage is least certain.

Reads the solved runs of the first stage from the campaign's store (solving what is missing), and
writes ``bayesdeg/emulator/second_stage.json``, which the design then uses for every geometry.

    uv run python benchmarks/second_stage.py --coarse 64 --fine 24
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

from bayesdeg.actuator.curve import Curve, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.data.settings import Dimensions
from bayesdeg.emulator.campaign import complete, runs
from bayesdeg.emulator.design import SECOND_STAGE, Question, candidates, likely, most_informative
from bayesdeg.emulator.fit import PLANS
from bayesdeg.emulator.kept import Recipe
from bayesdeg.emulator.regression import Observed, Prior, observe, rows_of
from bayesdeg.emulator.scaling import TrainingRange
from bayesdeg.emulator.solutions import SolutionStore
from bayesdeg.emulator.terms import Family
from bayesdeg.emulator.trained import default_surrogate


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
