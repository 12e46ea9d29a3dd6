"""One study, judged once: how long its fit and its verdict take, line by line in JSON.

    python benchmarks/verdict_timed.py STUDY --effort quick

The script asks nothing of its own checkout: this version of the package and the commit `OLD` of
``verdict_seconds.py`` can run it.
Worker processes are open and warm before the clock starts, as they are in ``bayesdeg run`` once
the base model was sampled, and compiled code comes from the cache if it is there.
"""

import argparse
import json
import resource
import time
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import bayesdeg
from bayesdeg.inference.density import guesses
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import approximate

try:
    from bayesdeg.analysis.calibrate import base_without_chain
    from bayesdeg.analysis.judge import JUDGE_EFFORTS, judge
    from bayesdeg.assembly.assemble import Assembly, assemble
    from bayesdeg.criticism.fit.trials import CandidateFit
    from bayesdeg.data.study import read_study
    from bayesdeg.inference.model import JointModel, near_films
    from bayesdeg.progress import Silent
    from bayesdeg.surrogate.workers import pool
except ImportError:  # where they are in the commit `OLD` of verdict_seconds.py
    from bayesdeg.criticism.trials import CandidateFit
    from bayesdeg.inference.least_squares import near_films
    from bayesdeg.measure.study import read_study
    from bayesdeg.pipeline.assemble import Assembly, assemble
    from bayesdeg.pipeline.base import base_without_chain
    from bayesdeg.pipeline.judge import JUDGE_EFFORTS, judge
    from bayesdeg.pipeline.progress import Silent

    from bayesdeg.console import pool
    from bayesdeg.inference.model import Model as JointModel

REPEATS = 3  # of a fit
WARMING = 64  # densities


def tell(**values: object) -> None:
    """Write one line: what came before stays known if the rest takes too long."""
    print(json.dumps(values), flush=True)


def warm(model: JointModel) -> None:
    """Load or compile what a density takes in this process."""
    model.log_prob(guesses(model.table, np.random.default_rng(0), WARMING))


def warm_workers(executor: Executor | None, model: JointModel, workers: int) -> None:
    """Let every worker evaluate the model; a task each, and some more for those that are late."""
    if executor is not None:
        list(executor.map(warm, [model] * (4 * workers)))


def fit_once(model: JointModel) -> float:
    """Return the seconds of one mode with its evidence."""
    generator = np.random.default_rng(0)
    start = time.perf_counter()
    laplace = approximate(model, generator, start=near_films(model, generator))
    about_mode(model, laplace, generator)
    return time.perf_counter() - start


def verdict(assembly: Assembly, base: CandidateFit, effort: str, executor: Executor | None) -> None:
    """Judge and tell what came out."""
    start, cpu = time.perf_counter(), time.process_time()
    judgement = judge(
        assembly,
        base,
        effort=JUDGE_EFFORTS[effort],
        seed=np.random.SeedSequence(2),
        progress=Silent(),
        executor=executor,
    )
    tell(
        verdict=time.perf_counter() - start,
        verdict_cpu_of_main=time.process_time() - cpu,
        outcome=str(judgement.decision.outcome),
        causes=list(judgement.decision.causes),
        tried=len(judgement.search.trials),
    )


def main() -> None:
    """Fit and judge one study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", type=Path)
    parser.add_argument("--effort", default="quick", choices=list(JUDGE_EFFORTS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--fit-only", action="store_true", help="mode and evidence, repeatedly")
    options = parser.parse_args()
    with threadpool_limits(limits=1), pool(options.workers) as executor:
        assembly = assemble(read_study(options.study))
        model = assembly.model
        tell(version=bayesdeg.__version__, package=str(Path(bayesdeg.__file__).parent))
        warm(model)
        if options.fit_only:
            fit_once(model)
            tell(fits=[fit_once(model) for _ in range(REPEATS)])
            return
        warm_workers(executor, model, options.workers)
        start = time.perf_counter()
        base = base_without_chain(model, np.random.SeedSequence(1))
        tell(
            fit=time.perf_counter() - start,
            effective=base.posterior.effective,
            parameters=len(model.table),
            candidates=len(assembly.candidates),
        )
        verdict(assembly, base, options.effort, executor)
    used = [resource.getrusage(of) for of in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    tell(user_seconds=sum(one.ru_utime for one in used))


if __name__ == "__main__":
    main()
