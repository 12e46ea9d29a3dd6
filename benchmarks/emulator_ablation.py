"""Do derivatives and a coarse mesh pay? The emulator trained on less, against held-out curves."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from emulator_errors import compare, errors, refusals
from emulator_held_out import HeldOut
from forward_case import interleaved, say

from bayesdeg.actuator.curve import SAMPLING, Actuator, Curve, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import build_mesh
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import runs
from bayesdeg.surrogate.fit import PLANS, WHOLE, FitPlan, train
from bayesdeg.surrogate.kept import Recipe, mesh_error_of
from bayesdeg.surrogate.scaling import TrainingRange
from bayesdeg.surrogate.solutions import Run, SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate

TIMED = 1  # curves of each mesh whose derivatives are timed


@dataclass(frozen=True)
class Variant:
    """What an emulator is trained on.

    Parameters
    ----------
    coarse, fine : int
        Numbers of runs, the first of the recipe's; without coarse ones the fine stand alone.
    derivatives : bool
        Whether derivatives are used beside values.
    """

    coarse: int
    fine: int
    derivatives: bool = True


def variants(many: int, few: int) -> dict[str, Variant]:
    return {
        "as shipped": Variant(many, few),
        "half the coarse runs": Variant(many // 2, few),
        "quarter of the coarse runs": Variant(many // 4, few),
        "half the fine runs": Variant(many, few // 2),
        "values only": Variant(many, few, derivatives=False),
        "fine runs alone": Variant(0, few),
        "fine runs alone, values only": Variant(0, few, derivatives=False),
    }


def measured(
    shipped: Surrogate, store: SolutionStore, curves: Sequence[HeldOut], *, chosen: Sequence[str]
) -> dict[str, Any]:
    """Train the chosen variants, all if none; return their errors and what their runs cost."""
    recipe, geometry = Recipe(), Geometry(Dimensions())
    wanted = runs(geometry, recipe)
    many = [run for run in wanted if run.resolution == recipe.coarse_mesh]
    few = [run for run in wanted if run.resolution == recipe.fine_mesh]
    seconds = store.seconds()
    share = {
        "coarse": share_of_derivatives(geometry, recipe.coarse_mesh, many),
        "fine": share_of_derivatives(geometry, recipe.fine_mesh, few),
    }
    found: dict[str, Any] = {"time_with_derivatives_over_without": share}
    for name, variant in variants(len(many), len(few)).items():
        if chosen and name not in chosen:
            continue
        say(f"  {name}")
        parts = (many[: variant.coarse], few[: variant.fine])
        start = time.process_time()
        whole = variant == Variant(len(many), len(few))
        emulator = shipped if whole else trained(store, *parts, derivatives=variant.derivatives)
        took = time.process_time() - start
        pairs = compare(emulator, curves)
        cost = [
            sum(seconds[run.key()] for run in part) / (1.0 if variant.derivatives else ratio)
            for part, ratio in zip(parts, share.values(), strict=True)
        ]
        found[name] = {
            "coarse_runs": variant.coarse,
            "fine_runs": variant.fine,
            "derivatives": variant.derivatives,
            "core_hours": sum(cost) / 3600.0,
            "training_seconds": None if whole else took,
            "errors": errors(pairs),
            "refused_values": refusals(pairs, curves)["values"],
        }
        worst = found[name]["errors"]["curvature"]
        say(f"    {worst['p95_pct']:.3f} %, at most {worst['max_pct']:.3f} %")
    return found


def trained(
    store: SolutionStore, many: Sequence[Run], few: Sequence[Run], *, derivatives: bool
) -> Surrogate:
    """Train on stored runs; without coarse ones the fine stand alone, and correct nothing."""
    fine = _pair(store, few)
    plans: Sequence[FitPlan] = PLANS
    if not derivatives:
        plans = [replace(plan, derivatives=False) for plan in PLANS]
    return train(
        _pair(store, many) if many else fine,
        fine,
        span=TrainingRange(),
        length=few[0].geometry.dimensions.length,
        mesh_error=mesh_error_of(few[0].geometry),
        record={},
        terms=replace(WHOLE, plans=tuple(plans)),
    )


def _pair(
    store: SolutionStore, wanted: Sequence[Run]
) -> tuple[Sequence[Curve], Sequence[PathSamples]]:
    solved = [store.get(run) for run in wanted]
    samples = [solution for solution in solved if isinstance(solution, PathSamples)]
    if len(samples) < len(wanted):
        raise RuntimeError("the store lacks training runs: run 'bayesdeg emulate' first")
    return [run.curve for run in wanted], samples


def share_of_derivatives(
    geometry: Geometry, resolution: Resolution, wanted: Sequence[Run]
) -> float:
    """Return the time of curves with all derivatives over that of the same paths without."""
    actuator = Actuator(build_mesh(geometry, resolution))
    curves = [run.curve for run in wanted[:TIMED]]

    def all_of(solve: Callable[[Curve], object]) -> Callable[[], None]:
        def task() -> None:
            for curve in curves:
                solve(curve)

        return task

    tasks: Mapping[str, Callable[[], None]] = {
        "with derivatives": all_of(lambda curve: actuator.sample(curve, effort=SAMPLING)),
        "values": all_of(lambda curve: actuator.solve(curve, effort=SAMPLING)),
    }
    actuator.solve(curves[0])  # numbering and symbolic analysis, once a geometry
    times = interleaved(tasks, repeats=1)
    actuator.close()
    with_derivatives, values = (statistics.median(times[name]) for name in tasks)
    return with_derivatives / values


def table(found: Mapping[str, Any]) -> str:
    """Return the variants as lines of text."""
    lines = [f"{'trained on':32} core h   p95 %   max %  refused"]
    for name, facts in found.items():
        if not isinstance(facts, dict) or "errors" not in facts:
            continue
        error = facts["errors"]["curvature"]
        lines.append(
            f"{name:32} {facts['core_hours']:6.2f} {error['p95_pct']:7.3f} {error['max_pct']:7.3f}"
            f" {facts['refused_values']:8}"
        )
    return "\n".join(lines)
