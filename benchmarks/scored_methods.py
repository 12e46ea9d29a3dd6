"""bayesdeg, closed-form least squares and Kennedy–O'Hagan, scored on one set of hidden effects.

    uv run python benchmarks/hidden_dataset.py --studies 96 --seed 97 --physics 3 \
        --out .cache/scored/studies --truths .cache/scored/truths.jsonl
    uv run python benchmarks/scored_methods.py --studies .cache/scored/studies \
        --truths .cache/scored/truths.jsonl --record benchmarks/scored --json

lets each method answer each study from its folder alone, and scores it as ``bayesdeg score`` does.
bayesdeg judges as ``bayesdeg run`` does at quick effort; the other two are in ``other_methods.py``.
Answers are kept in ``.cache/scored/answers`` and not asked for again. ``--record FOLDER`` copies
truths and answers there, one file a method, which is what the published tables are made of:
``--record benchmarks/scored`` alone scores what is recorded, ``--markdown`` prints the tables.
"""

import argparse
import hashlib
import json
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from hidden_tables import as_table
from other_methods import METHODS as OTHERS
from other_methods import FittedStudy, fit_study
from threadpoolctl import threadpool_limits

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import JUDGE_EFFORTS, judge
from bayesdeg.assembly.assemble import assemble
from bayesdeg.commands.score import StatedVerdict
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.hidden import (
    HiddenAnswer,
    HiddenTruth,
    StatedSize,
    lines_of,
    read_answers,
    read_truths,
)
from bayesdeg.laboratory.score import Score, ScoredShare, score
from bayesdeg.run.record import verdict_document

STORE = Path(".cache/scored/answers")
TRUTHS = "truths.jsonl"
WORDS = {
    "bayesdeg": "bayesdeg, quick effort",
    "closed_form": "closed-form least squares",
    "kennedy_ohagan": "Kennedy–O'Hagan",
}
#: Shares of the published table, in its order.
SHOWN = (
    *("plain_right", "plain_alone", "single_right", "physics_right", "two_right", "two_alone"),
    *("said_false", "none_adequate", "none_said", "outside_unexplained", "outside_said"),
    "of_several",
)


def judged(folder: Path) -> HiddenAnswer:
    """Return what bayesdeg says of a study, as ``bayesdeg run`` does at quick effort."""
    study = read_study(folder)
    assembly = assemble(study)
    fitting, judging = np.random.SeedSequence(study.settings.seed).spawn(2)
    base = base_without_chain(assembly.model, fitting)
    found = judge(assembly, base, effort=JUDGE_EFFORTS["quick"], seed=judging)
    document = verdict_document(found, "", explanation="not scored").document()
    return StatedVerdict.read(document).answer(folder.name)


def answered(method: str, folder: Path) -> tuple[HiddenAnswer, float]:
    """Return a method's answer on a study and the seconds it took; read it if it is kept."""
    # by the content: another data set has other studies of the same names
    content = b"".join(path.read_bytes() for path in sorted(folder.iterdir()))
    key = hashlib.sha256(content).hexdigest()[:16]
    path = STORE / method / f"{folder.name}-{key}.json"
    if path.exists():
        kept = json.loads(path.read_text(encoding="utf-8"))
        return HiddenAnswer.read(kept["answer"]), kept["seconds"]
    fitted, seconds = (None, 0.0) if method == "bayesdeg" else _fit(folder)
    start = time.perf_counter()
    with threadpool_limits(limits=1):
        answer = judged(folder) if fitted is None else OTHERS[method](fitted)
    seconds += time.perf_counter() - start
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    kept = {"seconds": seconds, "answer": answer.document()}
    part.write_text(json.dumps(kept), encoding="utf-8")
    part.replace(path)
    return answer, seconds


@lru_cache(maxsize=1)
def _fit(folder: Path) -> tuple[FittedStudy, float]:
    """Return the base model that two methods start from, and the seconds that it took."""
    start = time.perf_counter()
    found = fit_study(folder)
    return found, time.perf_counter() - start


def answers_of(
    methods: Sequence[str], studies: Sequence[Path], workers: int
) -> tuple[dict[str, tuple[HiddenAnswer, ...]], dict[str, float]]:
    """Return the answers of methods on all studies, and the median seconds of each."""
    ask = partial(_answers, tuple(methods))
    if workers == 1:
        found = [ask(folder) for folder in studies]
    else:
        with ProcessPoolExecutor(workers) as pool:
            found = list(pool.map(ask, studies))
    answers, seconds = {}, {}
    for place, method in enumerate(methods):
        answers[method] = tuple(row[place][0] for row in found)
        seconds[method] = float(np.median([row[place][1] for row in found]))
    return answers, seconds


def _answers(methods: tuple[str, ...], folder: Path) -> list[tuple[HiddenAnswer, float]]:
    return [answered(method, folder) for method in methods]


def recorded(folder: Path) -> tuple[tuple[HiddenTruth, ...], dict[str, tuple[HiddenAnswer, ...]]]:
    """Return truths and answers of a record, by method."""
    truths = read_truths((folder / TRUTHS).read_bytes(), TRUTHS)
    answers = {}
    for method in WORDS:
        path = folder / f"{method}.jsonl"
        if path.exists():
            answers[method] = read_answers(path.read_bytes(), path.name)
    return truths, answers


def write_record(
    folder: Path, truths: tuple[HiddenTruth, ...], answers: dict[str, tuple[HiddenAnswer, ...]]
) -> None:
    """Write truths and answers, one file a method."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / TRUTHS).write_text(lines_of(truths), encoding="utf-8")
    for method, given in answers.items():
        (folder / f"{method}.jsonl").write_text(
            lines_of(_short(answer) for answer in given), encoding="utf-8"
        )


def _short(answer: HiddenAnswer) -> HiddenAnswer:
    """Return an answer with six digits, and without probabilities that are next to nothing."""
    chances = {n: _digits(p) for n, p in answer.probabilities.items() if (p or 0.0) >= 5e-4}
    sizes = {
        name: StatedSize(mean=_digits(one.mean), q05=_digits(one.q05), q95=_digits(one.q95))
        for name, one in answer.sizes.items()
    }
    p_value = _digits(answer.p_value)
    changes = {"probabilities": chances, "sizes": sizes, "p_value": p_value}
    return answer.model_copy(update=changes)


def _digits(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.6g}")


def markdown(scores: dict[str, Score]) -> str:
    """Return the table of shares with their intervals, and the isolability matrix of each."""
    heads = ("what", "of", *(WORDS[method] for method in scores))
    first = next(iter(scores.values()))
    rows: list[tuple[object, ...]] = [
        ("**credit**, all studies", first.studies, *(_cell(s.credit) for s in scores.values()))
    ]
    for name in SHOWN:
        shares = [found.share(name) for found in scores.values()]
        rows.append((shares[0].meaning, shares[0].studies, *map(_cell, shares)))
    rows.append(("causes stated per hidden cause, if right", "", *map(_said, scores.values())))
    rows.append(("sizes inside their 90 % intervals", "", *map(_inside, scores.values())))
    rows.append(("Brier score (base rates)", "", *map(_brier, scores.values())))
    parts = [as_table(heads, rows)]
    for method, found in scores.items():
        counts = {
            hidden: {said: number or 0.0 for said, number in row.items()}
            for hidden, row in found.matrix.items()
        }
        lines: list[tuple[object, ...]] = [
            (f"`{hidden}`" if " " not in hidden else hidden, int(sum(row.values())), _counts(row))
            for hidden, row in counts.items()
        ]
        parts.append(f"### {WORDS[method]}\n\n" + as_table(("hidden", "studies", "said"), lines))
    return "\n\n".join(parts)


def _cell(part: ScoredShare) -> str:
    if not part.studies:
        return ""
    return f"{part.share:.2f} ({part.low:.2f}–{part.high:.2f})"


def _said(found: Score) -> str:
    return "" if found.causes_said is None else f"{found.causes_said:.2f}"


def _inside(found: Score) -> str:
    if found.sizes is None:
        return "not stated"
    share = found.sizes.inside_90
    return f"{_cell(share)} of {share.studies}"


def _brier(found: Score) -> str:
    own = found.probabilities
    return "" if own is None else f"{own.brier:.2f} ({own.brier_of_base_rates:.2f})"


def _counts(row: dict[str, float]) -> str:
    return ", ".join(f"{name} {n:.0f}" for name, n in sorted(row.items(), key=lambda i: -i[1]))


def main() -> None:
    """Score the methods."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=Path, help="folder of a data set; else what is recorded")
    parser.add_argument("--truths", type=Path)
    parser.add_argument(
        "--first", type=int, help="only so many, in their order, which is by chance"
    )
    parser.add_argument("--methods", nargs="*", default=list(WORDS), choices=list(WORDS))
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--record", type=Path, help="folder of truths and answers")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true", help="the tables of the documentation")
    options = parser.parse_args()
    if (options.studies is None) != (options.truths is None):
        parser.error("give --studies and --truths together")
    if options.studies is None and options.record is None:
        parser.error("give --studies and --truths, or --record")
    seconds: dict[str, float] = {}
    if options.studies is None:
        truths, answers = recorded(options.record)
    else:
        truths = read_truths(options.truths.read_bytes(), str(options.truths))[: options.first]
        folders = [options.studies / truth.study for truth in truths]
        answers, seconds = answers_of(options.methods, folders, options.workers)
        if options.record is not None:
            write_record(options.record, truths, answers)
    scores = {method: score(given, truths, method) for method, given in answers.items()}
    if options.markdown:
        print(markdown(scores))
        return
    figures = {method: found.document() for method, found in scores.items()}
    if options.json:
        print(json.dumps({"scores": figures, "seconds": seconds}, indent=1))
        return
    for method, found in scores.items():
        print(f"{WORDS[method]}: credit {_cell(found.credit)}, {seconds.get(method, 0.0):.1f} s")


if __name__ == "__main__":
    main()
