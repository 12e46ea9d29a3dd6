"""``bayesdeg score``: how well a method identifies the effects hidden in a set of studies."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
from pydantic import Field
from rich.table import Table
from rich.text import Text

from bayesdeg.commands.answers import write_csv
from bayesdeg.commands.options import MATRIX, PICTURE, SCORE
from bayesdeg.console import output, say
from bayesdeg.criticism.findings import Candidate
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.errors import Fault, StudyError
from bayesdeg.files import RUN_MB, STUDY_MB, parse_json, read_bytes, reason, write_text
from bayesdeg.laboratory.hidden import (
    SAYING,
    HiddenAnswer,
    Sets,
    StatedSize,
    read_answers,
    read_truths,
    wrong_answer,
)
from bayesdeg.laboratory.score import Score, ScoredShare, score
from bayesdeg.pages.figures.isolability import isolability_svg
from bayesdeg.pages.output import claimed, refuse_study
from bayesdeg.pages.record import MisfitEntry
from bayesdeg.pages.wording import NOTHING, fixed, words
from bayesdeg.records import Names, Record

VERDICT = "verdict.json"


class StatedVerdict(Record):
    """The scored parts of a ``verdict.json``."""

    outcome: Outcome
    causes: Names = ()
    one_of: tuple[Names, ...] = ()
    sets: tuple[Names, ...] = Field(
        default=(), description="lists from each of which one cause acts, if any"
    )
    alternatives: tuple[Names, ...] = Field(
        default=(), description="sets of causes, if not combinations from lists"
    )
    candidates: tuple[Candidate, ...] = ()
    misfit: MisfitEntry = MisfitEntry()

    def stated_sets(self) -> Sets:
        """Return the lists from each of which one cause acts; without any, lists of the causes."""
        if self.sets or self.outcome not in SAYING:
            return self.sets
        if self.outcome is Outcome.AMBIGUOUS:
            return (self.causes, *self.one_of)
        return (*((cause,) for cause in self.causes), *self.one_of)

    def answer(self, study: str) -> HiddenAnswer:
        """Return the verdict as an answer."""
        sets = self.stated_sets()
        alternatives = () if self.sets or self.outcome not in SAYING else self.alternatives
        sets = () if alternatives else sets
        stated = {name for names in (*sets, *alternatives) for name in names}
        tried = [one for one in self.candidates if one.probability is not None]
        return HiddenAnswer(
            study=study,
            outcome=self.outcome,
            sets=sets,
            alternatives=alternatives,
            p_value=self.misfit.p_value,
            sizes={
                f"{one.cause}.{name}": StatedSize(mean=e.mean, q05=e.q05, q95=e.q95)
                for one in tried
                if one.cause in stated
                for name, e in one.effect.items()
                if e.q05 is not None and e.q95 is not None
            },
            probabilities={one.cause: one.probability for one in tried},
        )


def score_answers(answers: Path, truths: Path, out: Path | None, as_json: bool) -> None:
    """Do what `interface.score_answers` says."""
    hidden = read_truths(_content(truths), str(truths))
    if answers.is_dir():
        given = tuple(_of_runs(answers))
    else:
        given = read_answers(_content(answers), str(answers))
    found = score(given, hidden, str(answers))
    if out is not None:
        _write(found, out)
    if as_json:
        sys.stdout.write(found.text())
    else:
        _show(found)


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path, most_mb=STUDY_MB)
    except OSError as fault:
        problem = f"cannot be read ({reason(fault)})"
        raise StudyError([Fault(str(path), problem, "name an existing file")]) from fault


def _of_runs(folder: Path) -> Iterator[HiddenAnswer]:
    """Yield the answers of run folders; raise all faults together."""
    faults: list[Fault] = []
    for run in sorted(path for path in folder.iterdir() if path.is_dir()):
        path = run / VERDICT
        try:
            content = parse_json(read_bytes(path, most_mb=RUN_MB))
            answer = StatedVerdict.read(content).answer(run.name)
        except OSError as fault:
            problem = f"cannot be read ({reason(fault)})"
            faults.append(Fault(str(path), problem, "finish the run, or remove its folder"))
        except ValueError as fault:
            faults.append(Fault(str(path), str(fault), "repeat the run"))
        else:
            faults += wrong_answer(answer, str(path))
            yield answer
    if faults:
        raise StudyError(faults)


def _write(found: Score, out: Path) -> None:
    refuse_study(out)
    with claimed(out):
        write_text(out / SCORE, found.text())
        write_csv(out / MATRIX, matrix_table(found))
        write_text(out / PICTURE, isolability_svg(found))
    say([f"wrote {SCORE}, {MATRIX} and {PICTURE} in {out}"])


def matrix_table(found: Score) -> pd.DataFrame:
    """Return the isolability matrix, one row per cell, with 95 % intervals."""
    return pd.DataFrame(
        {
            "hidden": hidden,
            "said": column,
            "count": cell.count,
            "studies": cell.studies,
            "share": cell.share,
            "low": cell.low,
            "high": cell.high,
        }
        for hidden, column, cell in found.cells()
    )


def _show(found: Score) -> None:
    printed = output()
    table = Table(title=f"score of {found.studies} studies", title_justify="left")
    for heading in ("what", "of", "share", "95 % interval"):
        table.add_column(heading, justify="left" if heading == "what" else "right")
    sizes = [found.sizes.inside_90] if found.sizes else []
    for one in (found.credit, *found.shares, *sizes):
        if one.studies:
            table.add_row(Text(one.meaning), str(one.studies), fixed(one.share), _interval(one))
    printed.print(table)
    for line in _besides(found):
        printed.print(line, soft_wrap=True)
    matrix = Table(title="hidden alone, and the answers", title_justify="left")
    matrix.add_column("hidden")
    matrix.add_column("said", overflow="fold")
    for hidden, row in found.matrix.items():
        counts = sorted(row.items(), key=lambda item: -(item[1] or 0.0))
        matrix.add_row(words(hidden), ", ".join(f"{words(n)} {c:.0f}" for n, c in counts))
    printed.print(matrix)


def _interval(one: ScoredShare) -> str:
    return f"{fixed(one.low)} to {fixed(one.high)}"


def _besides(found: Score) -> Iterator[str]:
    said = NOTHING if found.causes_said is None else fixed(found.causes_said)
    yield f"causes stated per hidden cause, if right: {said}"
    if found.sizes is not None:
        yield f"median width of 90 % intervals over size: {fixed(found.sizes.relative_width)}"
    if found.probabilities is not None:
        own = found.probabilities
        yield f"Brier score: {fixed(own.brier)}; of base rates: {fixed(own.brier_of_base_rates)}"
