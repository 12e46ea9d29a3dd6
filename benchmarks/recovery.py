"""Does the pipeline recover what is true, and stay silent where nothing is hidden?

Virtual experiments without a hidden effect, each with material laws drawn anew, go through the
pipeline as `bayesdeg run` has it. Curvatures come from a second surrogate of a finer mesh
(benchmarks/fine_library.py), films from the closed form; the pipeline sees only the study folder.

    uv run python benchmarks/recovery.py --studies 20 --json
"""

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TypedDict

import numpy as np
from fine_library import shipped_library

from bayesdeg.actuator.mesh import FINE
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.data.settings import SamplingOptions, Settings
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.experiment import Design, run_experiment
from bayesdeg.laboratory.truth import drawn_truth
from bayesdeg.laboratory.writing import Provenance, study_files
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.pages.folder import POSTERIOR_BASE, RunFolder
from bayesdeg.progress import Silent
from bayesdeg.run.stages import fingerprint, run_study


def design() -> Design:
    """Return the design of the paper up to 200 kPa: above, softer draws balloon."""
    full = Design()
    return replace(full, actuator=full.actuator[full.actuator["pressure_kPa"] <= 200.0])


class Recovered(TypedDict):
    """What a study came to."""

    seed: int
    inside: dict[str, bool]
    outcome: str
    causes: list[str]
    p_value: float | None
    seconds: float


def one(seed: int) -> Recovered:
    start = time.perf_counter()
    generator = np.random.default_rng(seed)
    forward = shipped_library()
    while True:  # a draw whose actuator balloons before 240 kPa makes another study than was asked
        truth = drawn_truth(generator)
        experiment = run_experiment(design(), truth, forward=forward, generator=generator)
        if experiment.tables["actuator"]["ruptured"].sum() == 0:
            break
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(title=f"recovery {seed}", sampling=SamplingOptions("quick"))
        provenance = Provenance("benchmarks/recovery.py", seed, vars(FINE))
        texts = study_files(experiment, settings, provenance=provenance)
        for name, text in texts.items():
            if name != "truth.json":
                (Path(folder) / name).write_text(text, encoding="utf-8")
        study = read_study(Path(folder))
        target = Path(folder) / "run"
        verdict = run_study(
            study,
            RunFolder(target),
            Checkpoints(target / "checkpoints", fingerprint(study)),
            progress=Silent(),
        )
        posterior = RunFolder(target).read_posterior(POSTERIOR_BASE)["posterior"]
    true = {
        "c1_at_0": truth.c1[0],
        "c1_at_25": truth.c1[-1],
        "volume_ratio": truth.volume_ratio,
    }
    inside = {}
    for name, value in true.items():
        low, high = np.quantile(posterior[name].to_numpy(), [0.05, 0.95])
        inside[name] = bool(low <= value <= high)
    return {
        "seed": seed,
        "inside": inside,
        "outcome": verdict.outcome,
        "causes": list(verdict.causes),
        "p_value": verdict.misfit.p_value,
        "seconds": time.perf_counter() - start,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.studies)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.workers, mp_context=context) as executor:
        results = []
        for result in executor.map(one, seeds):
            results.append(result)
            print(len(results), result, file=sys.stderr, flush=True)
    names = results[0]["inside"]
    summary = {
        "studies": len(results),
        "covered_90": {n: sum(r["inside"][n] for r in results) for n in names},
        "outcomes": {o: sum(r["outcome"] == o for r in results) for o in map(str, Outcome)},
        "median_seconds": float(np.median([r["seconds"] for r in results])),
        "results": results,
    }
    print(json.dumps(summary, indent=1) if options.json else summary)


if __name__ == "__main__":
    main()
