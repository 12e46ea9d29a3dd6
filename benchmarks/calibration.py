"""Simulation-based calibration of the pipeline at the size of a study, with a figure.

Parameters are drawn from the priors, readings of films, actuators and shrinkage from the law of
the likelihood, in the tests of a study; each data set is calibrated as by `bayesdeg run` at quick
effort. If the calibration is correct, the rank of the true value among 99 posterior draws is
uniform (Talts et al. 2018, arXiv:1804.06788), that of the true log density too (Modrák et al.
2023, doi:10.1214/23-BA1404).

Outside the range of the forward map the log likelihood falls by half the square of the excess,
whatever is read there; so a pair of parameters and data is kept with just that probability.

The keys of the document:

replicates              calibrated sets of data
parameters              by name: p-value of the χ² test of uniform ranks, whether the ECDF of ranks
                        stays within the 95 % simultaneous band (Säilynoja et al. 2022,
                        doi:10.1007/s11222-022-10090-6), coverage of 50 % and 90 % intervals
outside_band            names whose ECDF leaves its band; one of twenty does by chance
outside_joint_band      those that leave the band which all together stay within with 95 %
smallest_p              of the χ² tests; of n tests 0.05/n is small
coverage_50, coverage_90  over all parameters
ecdf_outside            how many of them, and of the log density, leave the joint band
converged               share of the fits that met the criteria of their effort; all are counted
sbc_replicates_per_hour at the number of workers
details                 circumstances

    uv run python benchmarks/calibration.py --replicates 200 --workers 2 --json

A replicate that is done stays in the store: the run can be stopped at any time and goes on from
there, or be lengthened.
"""

import os
from typing import Any

# before the libraries read them
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import hashlib
import json
import multiprocessing
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from calibration_figure import draw
from calibration_ranks import chi_square, coverage, leaves
from forward_case import say
from numpy.typing import NDArray

import bayesdeg
from bayesdeg.analysis.calibrate import Fit, calibrate
from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.inference.model import JointModel, replicate
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.progress import Silent
from bayesdeg.run.stages import fingerprint

Floats = NDArray[np.float64]

STUDY = Path("studies/gelatin_actuator")
STORE = Path(".cache/calibration")
EFFORT = "quick"
DRAWS = 99  # ranks from 0 to 99
DENSITY = "log density"
LAWS = (
    *("priors.py", "material", "causes", "surrogate", "observations", "inference"),
    "analysis/calibrate.py",
)


@dataclass(frozen=True)
class Replicate:
    """One set of data, calibrated.

    Parameters
    ----------
    seed : int
        From which all of it follows.
    ranks : dict of str to int
        Number of posterior draws below the true value.
    converged : bool
        Whether the effort's criteria were met.
    r_hat, effective : float
        Largest and smallest of the parameters.
    refused : int
        Pairs of parameters and data before this one that were not kept.
    seconds : float
        That calibrating took.
    """

    seed: int
    ranks: dict[str, int]
    converged: bool
    r_hat: float
    effective: float
    refused: int
    seconds: float


@cache
def model(folder: Path) -> JointModel:
    """Return the base model of a study's films, actuators and shrinkage."""
    study = replace(read_study(folder), breaks=None, summary=None)
    return assemble(study).model


def drawn(empty: JointModel, generator: np.random.Generator) -> tuple[Floats, JointModel, int]:
    """Return a vector from the prior, data made of it, and how many pairs were not kept."""
    refused = 0
    while True:
        vector = empty.table.sample(generator, 1)
        values = empty.table.named(vector)
        with np.errstate(all="ignore"):  # what is far outside overflows, and is not kept
            drawn = replicate(empty.continued, values, generator)
            data = drawn.with_world(forward=empty.world.forward)
            excess = float(np.sum(data.data_of(Curvature).range_excess(data.state(values)) ** 2))
            kept = generator.uniform() < np.exp(-0.5 * excess)
            if kept and np.isfinite(data.log_prob(vector)[0]):
                return vector[0], data, refused
        refused += 1


def one(folder: Path, seed: int) -> Replicate:
    """Draw, simulate, calibrate, rank."""
    sequence = np.random.SeedSequence([20211124, seed])
    simulation, calibration = sequence.spawn(2)
    vector, data, refused = drawn(model(folder), np.random.default_rng(simulation))
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        fit = calibrate(
            data,
            "replicate",
            effort=EFFORTS[EFFORT],
            seed=calibration,
            checkpoints=Checkpoints(Path(scratch), str(seed)),
            progress=Silent(),
        )
    return Replicate(
        seed,
        ranks_of(fit, vector),
        fit.diagnosis.usable,
        max(fit.diagnosis.r_hat),
        min(fit.diagnosis.ess_bulk),
        refused,
        time.perf_counter() - begin,
    )


def ranks_of(fit: Fit, vector: Floats) -> dict[str, int]:
    """Return ranks among draws evenly spaced over ensembles and steps."""
    draws = fit.chain.vectors.reshape(-1, len(vector))
    density = fit.chain.log_prob.ravel()
    take = np.linspace(0, len(draws) - 1, DRAWS).round().astype(np.int64)
    below = np.sum(draws[take] < vector, axis=0)
    ranks = dict(zip(fit.model.table.names, below.tolist(), strict=True))
    true = fit.model.log_prob(vector[None])[0]
    return ranks | {DENSITY: int(np.sum(density[take] < true))}


class Store:
    """Replicates that are done, a file each, of one version of the laws and of the study."""

    def __init__(self, folder: Path, study: Path) -> None:
        self._folder = folder / key(study)
        self._folder.mkdir(parents=True, exist_ok=True)

    def load(self, seed: int) -> Replicate | None:
        path = self._folder / f"{seed}.json"
        return Replicate(**json.loads(path.read_text("utf-8"))) if path.exists() else None

    def save(self, done: Replicate) -> None:
        path = self._folder / f"{done.seed}.json"
        part = path.with_suffix(".part")
        part.write_text(json.dumps(asdict(done)), encoding="utf-8")
        part.replace(path)


def key(study: Path) -> str:
    """Return a hash of all that a replicate depends on: study, emulator, and the code of laws."""
    package = Path(bayesdeg.__file__).parent
    content = hashlib.sha256(fingerprint(read_study(study)).encode())
    for name in LAWS:
        place = package / name
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            content.update(path.read_bytes())
    content.update(f"{EFFORT} {DRAWS}".encode())
    return content.hexdigest()[:16]


def replicates(
    count: int, *, study: Path, store: Store, workers: int
) -> tuple[list[Replicate], float]:
    """Return replicates, those of the store included, and how many were made in an hour."""
    known = {seed: store.load(seed) for seed in range(count)}
    found = [done for done in known.values() if done is not None]
    missing = [seed for seed, done in known.items() if done is None]
    say(f"{len(found)} of {count} replicates are in the store")
    begin = time.perf_counter()
    for number, done in enumerate(made(study, missing, workers), start=1):
        store.save(done)
        found.append(done)
        rate = 3600.0 * number / (time.perf_counter() - begin)
        say(
            f"{len(found)}/{count}: {done.seconds:.0f} s, R-hat {done.r_hat:.3f}, "
            f"{done.effective:.0f} effective draws, {rate:.0f} an hour"
        )
    if not missing:
        rate = 3600.0 * workers / float(np.mean([done.seconds for done in found]))
    return sorted(found, key=lambda done: done.seed), rate


def made(study: Path, seeds: Sequence[int], workers: int) -> Iterator[Replicate]:
    if workers == 1 or len(seeds) < 2:
        yield from map(partial(one, study), seeds)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as executor:
        yield from executor.map(partial(one, study), seeds)


def judged(done: Sequence[Replicate]) -> dict[str, Any]:
    """Return the document's figures of ranks."""
    names = list(done[0].ranks)
    ranks = {name: np.array([d.ranks[name] for d in done]) for name in names}
    joint = 1.0 - 0.05 / len(names)
    parameters = {
        name: {
            "chi_square_p": chi_square(r, DRAWS),
            "within_band": not leaves(r, DRAWS),
            "coverage_50": coverage(r, DRAWS, 0.5),
            "coverage_90": coverage(r, DRAWS, 0.9),
        }
        for name, r in ranks.items()
    }
    everything = np.concatenate([ranks[name] for name in names if name != DENSITY])
    return {
        "replicates": len(done),
        "parameters": parameters,
        "outside_band": [name for name in names if leaves(ranks[name], DRAWS)],
        "outside_joint_band": [name for name in names if leaves(ranks[name], DRAWS, joint)],
        "ecdf_outside": sum(leaves(ranks[name], DRAWS, joint) for name in names),
        "converged": float(np.mean([d.converged for d in done])),
        "smallest_p": min(p["chi_square_p"] for p in parameters.values()),
        "coverage_50": coverage(everything, DRAWS, 0.5),
        "coverage_90": coverage(everything, DRAWS, 0.9),
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--study", type=Path, default=STUDY, help="whose tests are simulated")
    parser.add_argument("--replicates", type=int, default=200)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--store", type=Path, default=STORE)
    parser.add_argument("--figure", type=Path, help="draw the ECDFs of the ranks (PNG or SVG)")
    parser.add_argument("--json", action="store_true", help="print the document as JSON last")
    options = parser.parse_args()
    store = Store(options.store, options.study)
    done, rate = replicates(
        options.replicates, study=options.study, store=store, workers=options.workers
    )
    document = judged(done) | {
        "sbc_replicates_per_hour": rate,
        "details": {
            "study": str(options.study),
            "effort": EFFORT,
            "workers": options.workers,
            "cores": os.cpu_count(),
            "largest_r_hat": max(d.r_hat for d in done),
            "smallest_effective": min(d.effective for d in done),
            "median_seconds": float(np.median([d.seconds for d in done])),
            "pairs_not_kept": sum(d.refused for d in done),
        },
    }
    if options.figure is not None:
        ranks = {name: np.array([d.ranks[name] for d in done]) for name in done[0].ranks}
        draw(options.figure, ranks, DRAWS)
        say(f"figure: {options.figure}")
    print(json.dumps(document, indent=1) if options.json else document)


if __name__ == "__main__":
    main()
