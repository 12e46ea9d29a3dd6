"""Speed of a converged posterior.

Of the gelatin study's base model with all its data, in seconds of the processor, in one process
with one thread; but ``fit_seconds`` by the clock on the wall. The keys of the document:

ess_per_second          smallest bulk effective sample size over all parameters, per second of
                        sampling to the criteria of standard effort, fitting of moves included
loop_ratio              ess_per_second over that of emcee as it comes: its default move, one walker
                        at a time, started in the posterior
loop_ratio_same_moves   seconds of a step of an ensemble, one walker at a time as emcee asks
                        ordinarily, over that with all at once: the same moves, the same chain
nuts_ratio              ess_per_second over that of numpyro's NUTS on the same density, started in
                        the posterior with its covariance, after adaptation; gradients by
                        differences in one batch, as the forward map is not written in jax
logprob_per_second      joint log densities of all data, in batches of a whole ensemble
fit_seconds             mode, evidence and chain to the criteria of standard effort, with two
                        processes, their start included
sbc_replicates_per_hour data drawn anew and calibrated (benchmarks/calibration.py), on one core
details                 circumstances of each

    uv run python benchmarks/inference.py --json

It takes some minutes. ``--only`` measures some parts.
"""

import os

# before the libraries read them
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import json
import multiprocessing
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import calibration
import inference_sampling
import numpy as np
from forward_case import machine, say
from inference_sampling import Sampled
from numpy.typing import NDArray

from bayesdeg.analysis.calibrate import calibrate
from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import Evidence, approximate
from bayesdeg.inference.model import JointModel, near_films
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.pages.wording import worded
from bayesdeg.progress import Silent

Document = dict[str, object]
Floats = NDArray[np.float64]

STUDY = Path("studies/gelatin_actuator")
BATCHES = (1, 16, 64, 256)


@dataclass(frozen=True)
class Case:
    """The gelatin study's base model; its chain is sampled when it is first asked for."""

    model: JointModel

    @cached_property
    def start(self) -> Evidence:
        generator = np.random.default_rng(0)
        near = near_films(self.model, generator)
        laplace = approximate(self.model, generator, start=near)
        return about_mode(self.model, laplace, generator)

    @cached_property
    def sampled(self) -> Sampled:
        return inference_sampling.sampled(self.model, self.start, EFFORTS["standard"])


def density(case: Case, document: Document) -> Document:
    walkers = case.sampled.chain.vectors.shape[2]
    rates = {size: rate(case, size) for size in (*BATCHES, walkers)}
    document["logprob_per_second"] = rates[walkers]
    return {"batch": walkers, "parameters": len(case.model.table), "by_batch": rates}


def rate(case: Case, size: int, *, seconds: float = 1.0) -> float:
    """Return densities a second of the median of repeated batches of posterior draws."""
    vectors = case.sampled.chain.vectors
    flat = vectors.reshape(-1, vectors.shape[-1])
    batch = flat[np.linspace(0, len(flat) - 1, size).astype(np.int64)]
    case.model.log_prob(batch)
    taken: list[float] = []
    while sum(taken) < seconds or len(taken) < 5:
        begin = time.process_time()
        case.model.log_prob(batch)
        taken.append(time.process_time() - begin)
    return size / float(np.median(taken))


def sampling(case: Case, document: Document) -> Document:
    done = case.sampled
    document["ess_per_second"] = done.rate
    effective = done.chain.effective()
    return {
        "seconds": done.seconds,
        "kept": list(done.chain.vectors.shape),
        "smallest_effective": float(effective.min()),
        "slowest": case.model.table.names[int(np.argmin(effective))],
        "largest_r_hat": float(done.chain.r_hat().max()),
        "densities_per_effective_draw": densities_per_effective_draw(case),
    }


def densities_per_effective_draw(case: Case) -> float:
    chain = case.sampled.chain
    return chain.refusals.proposed / float(chain.effective().min())


def loop(case: Case, document: Document) -> Document:
    found = inference_sampling.loop(case.model, case.sampled.chain)
    each = inference_sampling.default_moves(case.model, case.sampled.chain)
    ordinary = each / float(str(found["seconds_a_step_of_one_at_a_time"]))
    document["loop_ratio_same_moves"] = found["ratio"]
    document["loop_ratio"] = case.sampled.rate / ordinary
    return found | {"ess_per_second_of_emcee_as_it_comes": ordinary}


def nuts(case: Case, document: Document) -> Document:
    found = inference_sampling.nuts(case.model, case.sampled.chain, draws=150)
    document["nuts_ratio"] = case.sampled.rate / float(str(found["ess_per_second"]))
    gradients = float(str(found["gradients_per_effective_draw"]))
    ours = densities_per_effective_draw(case)
    return found | {"ratio_if_a_gradient_cost_four_densities": 4.0 * gradients / ours}


def fit(case: Case, document: Document) -> Document:
    context = multiprocessing.get_context("spawn")
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, ProcessPoolExecutor(2, context) as executor:
        done = calibrate(
            case.model,
            "base",
            effort=EFFORTS["standard"],
            seed=np.random.SeedSequence(2),
            checkpoints=Checkpoints(Path(folder), "benchmark"),
            progress=Silent(),
            executor=executor,
        )
        document["fit_seconds"] = time.perf_counter() - begin
    return {
        "criteria_met": done.diagnosis.usable,
        "largest_r_hat": max(done.diagnosis.r_hat),
        "smallest_effective": min(done.diagnosis.ess_bulk),
        "sentence": worded(done.diagnosis),
    }


def replicates(_: Case, document: Document) -> Document:
    begin = time.process_time()
    done = [calibration.one(calibration.STUDY, seed) for seed in range(3)]
    document["sbc_replicates_per_hour"] = 3600.0 * len(done) / (time.process_time() - begin)
    wall = [d.seconds for d in done]
    return {"wall_seconds": wall, "converged": sum(d.converged for d in done)}


PARTS: dict[str, Callable[[Case, Document], Document]] = {
    "density": density,
    "sampling": sampling,
    "loop": loop,
    "nuts": nuts,
    "fit": fit,
    "replicates": replicates,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the whole document")
    parser.add_argument("--only", nargs="*", choices=tuple(PARTS), help="parts to measure")
    options = parser.parse_args()
    case = Case(assemble(read_study(STUDY)).model)
    document: Document = {}
    details: Document = {"machine": machine()}
    for name, part in PARTS.items():
        if options.only is None or name in options.only:
            say(name)
            details[name] = part(case, document)
    if options.json:
        print(json.dumps(document | {"details": details}, indent=1))
        return
    for key, value in document.items():
        print(f"{key:24} {value:.4g}")


if __name__ == "__main__":
    main()
