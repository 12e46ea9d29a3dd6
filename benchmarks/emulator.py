"""How exact and how fast is the emulator, what did it take, and does it matter for a posterior?

Times are of one core. The keys of the document:

error_p95_pct         over held-out curves of the fine mesh: the 95th percentile of the largest
                      error of the curvature in a curve, over that curve's largest curvature
error_max_pct         the largest of them; bend angle, stretch and limit pressure follow by name
coverage_90           share of held-out curvatures inside the emulator's own 90 % interval
points_per_second     curvatures with standard errors, in batches as the sampler makes them
speedup               of a curve of twelve pressures over the fine mesh
fe_runs               finite element curves that the training took
training_core_hours   what they took
training_seconds      what training on them took
parallel_efficiency   a campaign with two workers against one, for local processes and for Dask
posterior_shift       of the gelatin study: largest shift of a posterior mean by exact finite
                      elements, in posterior standard deviations; its details hold the shift by
                      one smooth exact map over all rates, with its standard error
details               circumstances of each

    uv run python benchmarks/emulator.py --json

It takes about half an hour on one core; held-out and exact curves stay in the store, so that a
second run takes some minutes. An emulator that ``run --refine`` made is given by ``--emulator``,
and judged by the same exact curves as the package's own. ``--only`` measures some parts,
``--ablation`` trains on less: without derivatives, without the coarse mesh, on fewer runs.
"""

import os
from typing import Any

# before the libraries read them
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import emulator_ablation
import emulator_campaign
import emulator_errors
import emulator_held_out
import emulator_posterior
import emulator_speed
from forward_case import machine, say

from bayesdeg.surrogate.kept import outdated
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import default_surrogate, is_refined, read_trained

Document = dict[str, Any]
STORE = Path(".cache/campaign")


def accuracy(emulator: Surrogate, store: SolutionStore, document: Document) -> Document:
    curves = emulator_held_out.held_out(store)
    pairs = emulator_errors.compare(emulator, curves)
    found = emulator_errors.errors(pairs)
    limit = emulator_errors.limits(emulator, [(h.curve, h.solution.limit_load) for h in curves])
    named: dict[str, Any] = {"": found["curvature"], "bend_angle_": found["bend_angle"]}
    for name, spread in (named | {"stretch_": found["peak_stretch"], "limit_": limit}).items():
        for kind in ("p95", "max"):
            document[f"{name}error_{kind}_pct"] = spread.get(f"{kind}_pct")
    covered = emulator_errors.coverage(pairs)
    document["coverage_90"] = covered["curvature"]
    return {
        "errors": found,
        "by_causes_at_work": emulator_errors.by_causes(pairs),
        "coverage_90_of_interpolation_error": covered,
        "coverage_90_with_mesh_error": emulator_errors.coverage(pairs, with_mesh_error=True),
        "refusals": emulator_errors.refusals(pairs, curves),
        "limit_pressure": limit,
        "left_out_of_training": json.loads(emulator.record)["accuracy"],
    }


def speed(emulator: Surrogate, store: SolutionStore, document: Document) -> Document:
    rates = emulator_speed.points_per_second(emulator)
    gain = emulator_speed.speedup(emulator_held_out.held_out(store), rates["base"])
    document["points_per_second"], document["speedup"] = rates["base"].processor, gain["ratio"]
    return {
        "batch": [emulator_speed.WALKERS, emulator_speed.SPECIMENS, emulator_speed.PRESSURES],
        "points_per_second": {name: asdict(rate) for name, rate in rates.items()},
        "speedup": gain,
    }


def training(emulator: Surrogate, store: SolutionStore, document: Document) -> Document:
    facts = emulator_speed.training(store, emulator)
    document["fe_runs"], document["training_core_hours"] = facts["runs"], facts["core_hours"]
    document["training_seconds"] = facts.get("training_seconds")
    return facts


def campaign(_: Surrogate, __: SolutionStore, document: Document) -> Document:
    document["parallel_efficiency"], facts = emulator_campaign.parallel_efficiency()
    return facts


def main() -> None:
    options = _options()
    emulator = read_trained(options.emulator) if options.emulator else default_surrogate()
    if old := outdated(emulator.record):
        raise SystemExit(f"the emulator {old}")

    def posterior(emulator: Surrogate, store: SolutionStore, document: Document) -> Document:
        document["posterior_shift"], facts = emulator_posterior.posterior_shift(
            emulator,
            store,
            exact_draws=options.exact_draws,
            located_by=default_surrogate() if is_refined(emulator.record) else None,
        )
        return facts

    def ablation(emulator: Surrogate, store: SolutionStore, _: Document) -> Document:
        curves = emulator_held_out.held_out(store)
        return emulator_ablation.measured(emulator, store, curves, chosen=options.ablation)

    parts: dict[str, Callable[[Surrogate, SolutionStore, Document], Document]] = {
        "accuracy": accuracy,
        "speed": speed,
        "training": training,
        "campaign": campaign,
        "posterior": posterior,
    }
    if options.ablation is not None:
        parts["ablation"] = ablation
    document: Document = {}
    details: Document = {"machine": machine()}
    for name, part in parts.items():
        if options.only is None or name in options.only or name == "ablation":
            say(name)
            details[name] = part(emulator, SolutionStore(options.store), document)
    if options.json:
        print(json.dumps(document | {"details": details}, indent=1))
        return
    for key, value in document.items():
        print(f"{key:24} {_readable(value)}")
    if "ablation" in details:
        print(emulator_ablation.table(details["ablation"]))


def _readable(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_readable(part)}" for name, part in value.items())
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the whole document")
    parser.add_argument("--store", type=Path, default=STORE, help="finite element solutions")
    parser.add_argument("--emulator", type=Path, help="by default the one of the package")
    parser.add_argument(
        "--only",
        nargs="*",
        choices=("accuracy", "speed", "training", "campaign", "posterior"),
        help="parts to measure",
    )
    parser.add_argument(
        "--ablation",
        nargs="*",
        choices=tuple(emulator_ablation.variants(4, 2)),
        help="train on less, too: all kinds of less, or those named",
    )
    parser.add_argument(
        "--exact-draws", type=int, default=2, help="exact curves at each degradation rate"
    )
    return parser.parse_args()


if __name__ == "__main__":
    main()
