"""Judged studies in one file, the data behind the published figures."""

import argparse
import json
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

Json = dict[str, Any]
Judge = Callable[[int, Path, int], Json]
"""From a study's number, an empty folder and a seed to what was found."""

LEFT_OUT = ("tried", "factors", "supported", "statistic", "left")  # no figure is made of these


def read_record(path: Path | None) -> dict[tuple[int, str, int, int], Json]:
    """Return recorded studies by seed, effort, number and draw; none where there is no file."""
    if path is None or not path.exists():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    return {_key(one): one for one in map(json.loads, lines)}


def write_record(path: Path, studies: Iterable[Json]) -> None:
    """Write studies to a file, one a line, in the order of seed, effort, number and draw."""
    once = {_key(one): _short(one) for one in studies}
    lines = (json.dumps(one, ensure_ascii=False) for _, one in sorted(once.items()))
    part = path.with_suffix(".part")
    part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    part.replace(path)


def _key(one: Json) -> tuple[int, str, int, int]:
    return one["seed"], one["effort"], one["number"], one.get("draw", 0)


def _short(one: Json) -> Json:
    """Return what figures are made of; of rivals, those of what was hidden."""
    kept = {key: _rounded(value) for key, value in one.items() if key not in LEFT_OUT}
    rivals = one["confusable"]
    return kept | {"confusable": {n: rivals[n] for n in one["hidden"] if n in rivals}}


def _rounded(value: object) -> object:
    """Return numbers with six digits."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    return [_rounded(inner) for inner in value] if isinstance(value, list) else value


def judged_studies(judge: Judge, store: Path, *, studies: int, seed: int, about: str) -> list[Json]:
    """Judge studies as the command line says, side by side; return what was found of each.

    Studies in the record are not judged again. Those that fail are told and left out.

    Parameters
    ----------
    judge : callable
        Judges one study.
    store : Path
        Where their folders go.
    studies, seed : int
        By default.
    about : str
        Of the benchmark.
    """
    parser = argparse.ArgumentParser(description=about.split("\n\n")[0])
    parser.add_argument("--studies", type=int, default=studies)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=seed)
    parser.add_argument("--record", type=Path, help="file of studies that were judged, to go on")
    parser.add_argument("--json", action="store_true", help="print the figures alone")
    options = parser.parse_args()
    record = read_record(options.record)
    numbers = set(range(options.first, options.first + options.studies))
    known = [one for one in record.values() if one["seed"] == options.seed]
    found = [one for one in known if one["number"] in numbers]
    with ProcessPoolExecutor(options.workers) as executor:
        jobs = {
            executor.submit(judge, number, store / f"{options.seed}-{number}", options.seed): number
            for number in sorted(numbers - {one["number"] for one in found})
        }
        for job in as_completed(jobs):
            if (fault := job.exception()) is not None:
                print(f"study {jobs[job]} failed: {fault!r}", flush=True)
                continue
            one = job.result()
            found.append(one)
            if options.record is not None:
                write_record(options.record, [*record.values(), *found])
            if not options.json:
                hidden = "+".join(one["hidden"])
                said = (one["number"], one["kind"], hidden, "->", one["outcome"], one["causes"])
                print(*said, flush=True)
    return found
