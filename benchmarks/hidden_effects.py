"""Effects hidden in studies: rates of correct names, and of false names without an effect.

    uv run python benchmarks/hidden_effects.py --studies 300 --json

makes that many studies with the second surrogate of the fine finite element model (see
``fine_library.py``), judges each from its folder alone as ``bayesdeg run`` does at quick effort,
and holds the verdicts against what was hidden and a closed-form analysis of the same data.
Finished studies are kept in ``.cache/hidden_effects`` and not judged again. With ``--record FILE``
those in the file are not either, and the file is written anew; ``hidden_effects.jsonl`` beside this
script holds the studies of the published figures, as the commit that it came with judged them.
Studies from number 700 on hide effects that are planted by physics of a laboratory and not by the
rules of the entries (``physical_effects.py``): ``hidden_by_physics.jsonl`` holds such studies.
From number 3000 on they hide effects outside the catalogue that imitate its entries
(``physics/imitations.py``).
``--gelatin`` runs ``bayesdeg run studies/gelatin_actuator`` too, at both efforts, and adds the
seconds that its verdict and the whole run take on all cores.
"""

import argparse
import json
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from fine_library import shipped_library
from gelatin_seconds import gelatin_seconds
from hidden_record import read_record, write_record
from hidden_studies import IMITATING_DRAW, HiddenStudy, drawn_study, made
from hidden_summary import summary
from hidden_tables import markdown
from numpy.typing import NDArray
from physical_effects import SINGLE_DRAW, PhysicalStudy, drawn_by_physics, made_by_physics
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import JUDGE_EFFORTS, Judgement, judge
from bayesdeg.assembly.assemble import Assembly
from bayesdeg.assembly.reach import assemble_within_reach
from bayesdeg.criticism.fit.linear import (
    Linear,
    effects,
    linearise,
    log_bayes_factor,
    neutral_sizes,
    sensitivities,
)
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.truth import HiddenEffect, Truth
from bayesdeg.pages.wording import worded
from bayesdeg.progress import Silent

Floats = NDArray[np.float64]
Json = dict[str, Any]
Recorded = dict[tuple[int, str, int, int], Json]
Changes = Mapping[str, Floats]

STORE = Path(".cache/hidden_effects")
SEED = 6
NOISE = (
    *("stiffness_scatter", "curvature_noise", "curvature_noise_floor", "curvature_noise_length"),
    *("bend_angle_noise", "bend_angle_noise_floor", "reading_correlation"),
    *("tensile_noise", "tensile_noise_floor", "tensile_noise_length"),
)
NAMED_FROM = float(np.log(20.0))


@cache
def library() -> ForwardMap:
    """Return the second surrogate, loaded once a process."""
    return shipped_library()


def judged(study: HiddenStudy, folder: Path, *, effort: str, seed: int, draw: int = 0) -> Json:
    """Make one study, judge it from its folder, and return what was found beside the truth.

    Another `draw` judges the same readings with other random numbers.
    """
    truth, changes = _planted(study, folder, seed)
    return examined(study, folder, truth, changes, effort=effort, seed=seed, draw=draw)


def examined(
    study: HiddenStudy,
    folder: Path,
    truth: Truth,
    changes: Changes,
    *,
    effort: str,
    seed: int,
    draw: int = 0,
    assembly: Assembly | None = None,
) -> Json:
    """Judge a study from its folder, by default with all that the shipped emulator reaches."""
    start = time.perf_counter()
    with threadpool_limits(limits=1):
        assembly = assembly or assemble_within_reach(read_study(folder))
        fitting, judging = np.random.SeedSequence(study.number).spawn(2 * draw + 2)[-2:]
        base = base_without_chain(assembly.model, fitting)
        begun = time.perf_counter()
        judgement = judge(
            assembly,
            base,
            effort=JUDGE_EFFORTS[effort],
            seed=judging,
            progress=Silent(),
        )
    linear = judgement.search.base.linear
    return {
        "seed": seed,
        "number": study.number,
        "kind": study.kind,
        "design": study.design,
        "size": study.size,
        "hidden": {hidden.cause.name: dict(hidden.values) for hidden in study.effects},
        "visible": visible(judgement.search.base, study.effects, truth, changes),
        **_physics(study),
        "baseline": _baseline(linear, judgement),
        "effort": effort,
        **({"draw": draw} if draw else {}),
        "seconds_fit": begun - start,
        "seconds_verdict": time.perf_counter() - begun,
        **_found(judgement),
    }


def _planted(study: HiddenStudy, folder: Path, seed: int) -> tuple[Truth, Changes]:
    """Write the folder of a study; return what is true, and changes of readings that are known."""
    command = f"benchmarks/hidden_effects.py, study {study.number}"
    if isinstance(study, PhysicalStudy):
        return made_by_physics(study, folder, forward=library(), seed=seed, command=command)
    _, truth = made(study, folder, forward=library(), seed=seed, command=command)
    (folder / "truth.json").unlink()
    return truth, {}


def _physics(study: HiddenStudy) -> Json:
    """Return what is known of effects that are planted by physics; nothing of others."""
    if not isinstance(study, PhysicalStudy):
        return {}
    return {"physics": True, "about": [one.cause for one in study.physics if not one.exact]}


def _found(judgement: Judgement) -> Json:
    decision = judgement.decision
    effects_found = {
        c.cause: {name: size.document() for name, size in c.effect.items()}
        for c in judgement.candidates
        if c.cause in decision.causes
    }
    tops = [c for c in judgement.candidates if c.log_bayes_factor is not None][:6]
    return {
        "outcome": str(decision.outcome),
        "causes": list(decision.causes),
        "one_of": [list(names) for names in decision.one_of],
        "sets": [list(names) for names in decision.sets],
        "alternatives": [list(names) for names in decision.alternatives],
        "reasons": [worded(reason) for reason in decision.reasons],
        "p_value": judgement.misfit.p_value,
        "lost": judgement.misfit.lost,
        "p_left": judgement.left.p_value,
        "statistic": judgement.misfit.statistic,
        "left": judgement.left.statistic,
        "threshold": judgement.threshold,
        "supported": [one.cause for one in judgement.supported],
        "held_out": {c.cause: [c.elpd_diff, c.elpd_diff_se] for c in judgement.supported},
        "effects": effects_found,
        "factors": {c.cause: c.log_bayes_factor for c in tops},
        "confusable": {
            name: judgement.confusability.rivals(name) for name in judgement.confusability.names
        },
        "tried": {"+".join(sorted(n)): judgement.search.factor(n) for n in judgement.search.trials},
    }


def visible(
    base: CandidateFit,
    hidden: tuple[HiddenEffect, ...],
    truth: Truth,
    changes: Changes = MappingProxyType({}),
) -> dict[str, float]:
    """Return how large each hidden effect is after a refit of all else, in standard deviations.

    At the base fit, but with the true scatter and errors: those of the base fit have grown to make
    room for the effect. An effect is what it changes of the readings where that is known, else
    what the rule of its entry says.
    """
    true, mode = truth.named(), base.mode.copy()
    for i, parameter in enumerate(base.subject.table.parameters):
        if parameter.name in NOISE:
            z = float(parameter.law.to_unconstrained(true[parameter.name]))
            mode[i] = z if np.isfinite(z) else mode[i]
    linear = linearise(base.subject, mode, uncertain=base.uncertain)
    if not linear.is_known:
        linear = base.linear
    columns = {
        one.cause.name: linear.whiten_columns(changes[one.cause.name])
        if one.cause.name in changes
        else _column(linear, one)
        for one in hidden
    }
    sizes = {}
    for name, column in columns.items():
        others = [other for n, other in columns.items() if n != name and np.any(other)]
        basis = np.linalg.qr(np.array(others).T)[0] if others else np.zeros((len(column), 0))
        sizes[name] = float(np.linalg.norm(column - basis @ (basis.T @ column)))
    if len(columns) > 1:  # effects may cancel: then neither shows
        sizes["together"] = float(np.linalg.norm(sum(columns.values())))
    return sizes


def _column(linear: Linear, hidden: HiddenEffect) -> Floats:
    """Return the whitened effect; scaled up from a part of it where the whole is out of range."""
    values = hidden.values
    known = {p.name: values.get(p.name, p.neutral or 0.0) for p in hidden.cause.parameters}
    whole = [float(p.law.to_unconstrained(known[p.name])) for p in hidden.cause.parameters]
    neutral = neutral_sizes(hidden.cause)
    shares = np.array([1.0, 0.5, 0.25, 0.1])
    steps = neutral + shares[:, None] * (np.array(whole) - neutral)
    change = effects(linear, hidden.cause, steps) / shares[:, None]
    finite = change[np.all(np.isfinite(change), axis=1)]
    return finite[0] if len(finite) else np.zeros(change.shape[1])


def _baseline(linear: Linear, judgement: Judgement) -> Json:
    """Name by generalised least squares: the largest linear Bayes factor wins."""
    factors = {
        cause.name: float(log_bayes_factor(linear.observed, sensitivities(linear, cause)))
        for cause in judgement.search.causes
    }
    best = max(factors, key=lambda name: factors[name])
    named = best if factors[best] > NAMED_FROM else ""
    return {"named": named, "log_bayes_factor": factors[best]}


def run_all(
    numbers: list[int],
    *,
    workers: int,
    effort: str,
    seed: int,
    record: Recorded,
    draw: int = 0,
) -> Iterator[Json]:
    """Judge studies side by side; those that stand in the record or the store are read."""
    store = STORE / f"seed-{seed}" / (f"{effort}-{draw}" if draw else effort)
    store.mkdir(parents=True, exist_ok=True)
    left = []
    for number in numbers:
        path = store / f"{number}.json"
        if (seed, effort, number, draw) in record:
            yield record[seed, effort, number, draw]
        elif path.exists():
            yield json.loads(path.read_text(encoding="utf-8")) | {"seed": seed}
        else:
            left.append(number)
    with ProcessPoolExecutor(workers) as pool:
        jobs = [pool.submit(_one, number, store, effort, seed, draw) for number in left]
        try:
            for job in as_completed(jobs):
                if job.exception() is None:
                    yield job.result()
        finally:
            pool.shutdown(cancel_futures=True)
    faults = [fault for job in jobs if (fault := job.exception()) is not None]
    if faults:  # no figures without them; the others are stored
        raise BaseExceptionGroup(f"{len(faults)} studies could not be judged", faults)


def _one(number: int, store: Path, effort: str, seed: int, draw: int) -> Json:
    by_physics = SINGLE_DRAW <= number < IMITATING_DRAW
    study = (drawn_by_physics if by_physics else drawn_study)(number, seed=seed)
    found = judged(study, store / str(number), effort=effort, seed=seed, draw=draw)
    part = store / f"{number}.part"
    part.write_text(json.dumps(found), encoding="utf-8")
    part.replace(store / f"{number}.json")
    return found


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--effort", default="quick", choices=list(JUDGE_EFFORTS))
    parser.add_argument(
        "--again", type=int, default=0, help="of them judged at standard effort too"
    )
    parser.add_argument(
        "--draws", type=int, default=1, help="of the same studies, with other random numbers"
    )
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--record", type=Path, help="file of studies that were judged, to go on")
    parser.add_argument("--gelatin", action="store_true", help="time the gelatin study too")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true", help="the tables of the documentation")
    options = parser.parse_args()
    numbers = list(range(options.first, options.first + options.studies))
    record = read_record(options.record)
    how = {"workers": options.workers, "seed": options.seed, "record": record}
    found = []
    for one in run_all(numbers, effort=options.effort, **how):
        found.append(one)
        if not (options.json or options.markdown):
            said = (one["kind"], one["hidden"], "->", one["outcome"], one["causes"])
            print(len(found), *said, flush=True)
    again = list(run_all(numbers[: options.again], effort="standard", **how))
    redrawn = [
        one
        for draw in range(1, options.draws)
        for one in run_all(numbers[: options.again], effort=options.effort, draw=draw, **how)
    ]
    if options.record is not None:
        write_record(options.record, [*record.values(), *found, *again, *redrawn])
    figures = summary(found, again, redrawn)
    for timed in ("standard", "quick") if options.gelatin else ():
        figures |= gelatin_seconds(timed)
    print(markdown(figures) if options.markdown else json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
