"""Hidden ruptures: are probabilities of rupture right, and are flaws named where there are some?

    uv run python benchmarks/rupture.py --studies 120 --json

Each study is virtual (``rupture_studies.py``): walls break at the weakest integration point of a
finer mesh, and in every other study actuators have flaws besides. From its folder alone it is
judged as ``bayesdeg run --effort quick`` does. Further actuators of the same truth, which nobody
has seen, are inflated until they burst, beside what is predicted. Finished studies are kept in
``.cache/rupture``, and ``rupture.jsonl`` beside this script holds those of the published figures
(``--record FILE`` reads and writes it).

Keys: ``reliability_error``, the largest difference of observed and predicted share of ruptures
below a pressure drawn at random, over tenths of the predicted probability with 30 cases and more;
``brier`` and ``brier_base_rate`` of the same; ``burst_coverage_90``, how often the pressure of a
rupture lies in its 90 % interval, where what outlived the test has a random place in the rest of
the predicted law; ``flaws_named`` of the studies with flaws in which four actuators or more burst
that would have borne 20 kPa more without; ``flaws_false`` where there are none. Unless ``--quick``
is given: ``weibull_p95_pct`` of ``rupture_measures.py``, ``life_coverage_90`` of ``lifetime.py``,
``update_seconds`` of ``update.py``, run one after another.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from concurrent.futures import as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rupture_fields import LARGEST, STORE, field_of, path_of
from rupture_figure import draw
from rupture_studies import STEP, RuptureStudy, drawn_study, inflated, made, write_study
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.mesh import FINE
from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import JUDGE_EFFORTS, Judgement, judge
from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.display import shown
from bayesdeg.inference.importance import improved
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.laboratory.writing import TRUTH_FILE, Provenance
from bayesdeg.prediction.conditions import ServiceConditions
from bayesdeg.prediction.predictive import rupture_table
from bayesdeg.progress import Silent
from bayesdeg.surrogate.workers import WorkerProcesses

Floats = NDArray[np.float64]
Json = dict[str, Any]

SEED = 41
WORLDS = 8
FLAWS = "flaw_embrittlement"
RATES, FURTHER = 2, 15  # further actuators: recorded rates of a level, and how many of each
EARLY = 4  # actuators that burst early, from which on flaws should be named
DRAWS = 1000  # of the posterior, for predicted probabilities
ENOUGH = 300.0  # effective ones
TENTHS, FEWEST = 10, 30
INSIDE = (0.05, 0.95)
OTHERS = {
    "weibull_p95_pct": ("rupture_measures.py", "--curves", "40", "--fine", "0"),
    "life_coverage_90": ("lifetime.py", "--burials", "120"),
    "update_seconds": ("update.py",),
}


def judged(number: int, worlds: list[int]) -> Json:
    """Make one study, judge it from its folder, and hold its predictions against new actuators."""
    study = drawn_study(number, worlds, seed=SEED, flawed=number % 2 == 1)
    generator, begun = np.random.default_rng((SEED, number, 1)), time.perf_counter()
    experiment, _ = made(study, generator)
    provenance = Provenance(f"benchmarks/rupture.py, study {number}", number, vars(FINE))
    with tempfile.TemporaryDirectory() as name, threadpool_limits(limits=1):
        write_study(Path(name), study, experiment, provenance)
        (Path(name) / TRUTH_FILE).unlink()
        assembly = assemble(read_study(Path(name)))
        fitting, judging = np.random.SeedSequence(number).spawn(2)
        judgement = judge(
            assembly,
            base_without_chain(assembly.model, fitting),
            effort=JUDGE_EFFORTS["quick"],
            seed=judging,
            progress=Silent(),
        )
        final = _sampled(judgement, generator)
        cases = further(study, final, generator)
    return {
        "number": number,
        "world": study.world,
        "modulus": study.modulus,
        "elongation": list(study.truth.elongation),
        "flaws": None if study.flaws is None else asdict(study.flaws),
        "seconds": round(time.perf_counter() - begun, 1),
        "effective": final.effective,
        **_seen(experiment.actuators),
        **_found(judgement),
        "cases": cases,
    }


class Sampled(NamedTuple):
    """The final model, with draws of its posterior and how many independent ones they are worth."""

    model: JointModel
    chain: Chain
    effective: float


def _sampled(judgement: Judgement, generator: np.random.Generator) -> Sampled:
    """Draw from the model that predictions are made with, by importance sampling about its mode."""
    trial = judgement.search.trials[frozenset(judgement.predicted_with)]
    found = trial.posterior
    if found.effective < ENOUGH:
        again = improved(trial.subject, found, generator, enough=ENOUGH)
        found = max(found, again, key=lambda one: one.effective)
    vectors = found.resample(generator, DRAWS)[None, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(1))
    return Sampled(trial.subject, chain, found.effective)


def _seen(actuators: pd.DataFrame) -> Json:
    largest = actuators["degradation_pct"].map(LARGEST)
    burst = actuators["burst_kPa"] <= largest
    early = burst & (actuators["burst_without_flaws_kPa"] > actuators["burst_kPa"] + STEP)
    return {"tested": len(actuators), "burst": int(burst.sum()), "early": int(early.sum())}


def _found(judgement: Judgement) -> Json:
    rupture = judgement.rupture
    return {
        "outcome": str(judgement.decision.outcome),
        "causes": list(judgement.decision.causes),
        "predicted_with": list(judgement.predicted_with),
        "p_value": judgement.misfit.p_value,
        "rupture_p_value": None if rupture is None else rupture.p_value,
        "factors": {
            c.cause: c.log_bayes_factor
            for c in judgement.candidates
            if c.log_bayes_factor is not None
        },
    }


def further(
    study: RuptureStudy, final: Sampled, generator: np.random.Generator
) -> list[list[float]]:
    """Inflate further actuators; return what was predicted of each beside what happened.

    A row an actuator: degradation rate [%], predicted probability to have burst at a pressure that
    was drawn, whether it had, and the place of its own rupture in the predicted law.
    """
    found = []
    for level in LARGEST:
        field = field_of(study.world, level)
        error = study.truth.degradation_sd * generator.standard_normal(RATES)
        recorded = np.maximum(level + error, 0.0) if level > 0.0 else np.zeros(RATES)
        pressure = np.linspace(0.0, LARGEST[level], 41)
        law = _predicted(final, recorded, pressure, level > 0.0, generator, study)
        for row in law:
            actuators = inflated(study, level, field, FURTHER, generator)
            for burst in actuators.burst:
                at = generator.uniform(0.25, 1.0) * LARGEST[level]
                expected = float(np.interp(at, pressure, row))
                place = float(np.interp(min(burst, LARGEST[level]), pressure, row))
                if burst > LARGEST[level] and np.isfinite(place):
                    place = float(generator.uniform(place, 1.0))
                found.append([level, round(expected, 5), float(burst <= at), round(place, 5)])
    return found


def _predicted(
    final: Sampled,
    rates: Floats,
    pressure: Floats,
    degraded: bool,
    generator: np.random.Generator,
    study: RuptureStudy,
) -> Floats:
    """Return the predicted probability to have burst by each pressure, (n_rates, n_pressures)."""
    sd = study.truth.degradation_sd if degraded else 0.0
    table = rupture_table(
        final.model,
        final.chain,
        generator,
        degradation=rates,
        pressure=pressure[1:],
        draws=DRAWS,
        conditions=ServiceConditions(degradation_sd=sd),
    )
    law = table["probability"].to_numpy().reshape(len(rates), -1)
    return np.column_stack([np.zeros(len(rates)), np.maximum.accumulate(law, axis=1)])


def summary(studies: list[Json]) -> Json:
    """Return the figures of all studies."""
    cases = np.array([row for one in studies for row in one["cases"]])
    known = np.all(np.isfinite(cases), axis=1)
    _, expected, happened, place = cases[known].T
    base = float(happened.mean())
    tenths = _reliability(expected, happened)
    flawed = [one for one in studies if one["flaws"] and one["early"] >= EARLY]
    smooth = [one for one in studies if not one["flaws"]]
    inside = (place >= INSIDE[0]) & (place <= INSIDE[1])
    share = [np.mean(inside[k]) for k in _by_study(studies, known)]
    return {
        "reliability_error": max(abs(row["observed"] - row["predicted"]) for row in tenths),
        "reliability": tenths,
        "brier": float(np.mean((expected - happened) ** 2)),
        "brier_base_rate": base * (1.0 - base),
        "burst_coverage_90": float(inside.mean()),
        "burst_coverage_90_error": float(np.std(share, ddof=1) / np.sqrt(len(share))),
        "earlier_than_interval": float(np.mean(place < INSIDE[0])),
        "later_than_interval": float(np.mean(place > INSIDE[1])),
        "flaws_named": _share(flawed, lambda one: one["causes"] == [FLAWS]),
        "flaws_among_named": _share(flawed, lambda one: FLAWS in one["causes"]),
        "flaws_visible": len(flawed),
        "flaws_false": _share(smooth, lambda one: FLAWS in one["causes"]),
        "anything_false": _share(smooth, lambda one: bool(one["causes"])),
        "studies": len(studies),
        "without_flaws": len(smooth),
        "actuators": len(expected),
        "unanswered": int((~known).sum()),
        "median_seconds": float(np.median([one["seconds"] for one in studies])),
    }


def figure(path: Path, studies: list[Json]) -> None:
    """Draw reliability, with errors over studies, and the places of ruptures."""
    number = np.repeat(np.arange(len(studies)), [len(one["cases"]) for one in studies])
    cases = np.array([row for one in studies for row in one["cases"]])
    known = np.all(np.isfinite(cases), axis=1)
    number, (_, expected, happened, place) = number[known], cases[known].T
    tenth = np.minimum((expected * TENTHS).astype(int), TENTHS - 1)
    points = []
    for k in range(TENTHS):
        here = tenth == k
        if here.sum() < FEWEST:
            continue
        gap = happened[here] - expected[here]
        by_study = np.bincount(number[here], gap, minlength=len(studies))
        error = np.sqrt(np.sum((by_study - here.sum() * gap.mean() / len(studies)) ** 2))
        points.append((expected[here].mean(), happened[here].mean(), error / here.sum()))
    centre, observed, errors = np.array(points).T
    draw(path, centre, observed, errors, place)


def _by_study(studies: list[Json], known: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    ends = np.cumsum([len(one["cases"]) for one in studies])
    number = np.searchsorted(ends, np.flatnonzero(known), side="right")
    return [np.flatnonzero(number == k) for k in np.unique(number)]


def _share(studies: list[Json], holds: Any) -> float | None:
    return float(np.mean([holds(one) for one in studies])) if studies else None


def _reliability(expected: Floats, happened: Floats) -> list[Json]:
    tenth = np.minimum((expected * TENTHS).astype(int), TENTHS - 1)
    rows = []
    for k in range(TENTHS):
        here = tenth == k
        if here.sum() >= FEWEST:
            rows.append(
                {
                    "tenth": k + 1,
                    "cases": int(here.sum()),
                    "predicted": float(expected[here].mean()),
                    "observed": float(happened[here].mean()),
                }
            )
    return rows


def kept(number: int, worlds: list[int], record: dict[int, Json]) -> Json:
    """Return a judged study, from the record or the store where it is there."""
    file = STORE / "studies" / f"{number}.json"
    if number in record:
        return record[number]
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        part = file.with_suffix(".part")
        part.write_text(json.dumps(judged(number, worlds)), encoding="utf-8")
        part.replace(file)
    known: Json = json.loads(file.read_text(encoding="utf-8"))
    return known


def run_studies(count: int, workers: int, record: dict[int, Json]) -> list[Json]:
    """Judge studies, several side by side; needs the fields unless all are recorded."""
    missing = [number for number in range(count) if number not in record]
    worlds = [w for w in range(WORLDS) if all(path_of(w, level).exists() for level in LARGEST)]
    if missing and len(worlds) < WORLDS:
        sys.exit(f"solve fields first: python benchmarks/rupture_fields.py --worlds {WORLDS}")
    found = dict(record)
    with WorkerProcesses(workers) as executor, shown(quiet=False) as progress:
        progress.stage("hidden ruptures", len(missing))
        asked = {executor.submit(kept, number, worlds, record): number for number in missing}
        for done in as_completed(asked):
            found[asked[done]] = done.result()
            progress.advance()
    return [found[number] for number in range(count)]


def read_record(path: Path) -> dict[int, Json]:
    """Return recorded studies by number."""
    if not path.exists():
        return {}
    rows = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return {int(row["number"]): row for row in rows}


def of_others() -> Json:
    """Run the benchmarks of the measure, of lives and of updates, and return their figures."""
    found = {}
    for key, (script, *options) in OTHERS.items():
        command = [sys.executable, f"benchmarks/{script}", *options, "--json"]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        found[key] = json.loads(done.stdout)[key]
    return found


def main() -> None:
    """Judge the studies and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--studies", type=int, default=120)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true", help="ruptures alone")
    parser.add_argument("--figure", type=Path, help="file of a reliability diagram")
    parser.add_argument("--record", type=Path, help="file that judged studies are kept in")
    given = parser.parse_args()
    record = {} if given.record is None else read_record(given.record)
    studies = run_studies(given.studies, given.workers, record)
    if given.record is not None:
        lines = [json.dumps(one, separators=(",", ":")) for one in studies]
        given.record.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if given.figure is not None:
        figure(given.figure, studies)
    document = summary(studies) | ({} if given.quick else of_others())
    print(json.dumps(document, indent=1) if given.json else document)


if __name__ == "__main__":
    main()
