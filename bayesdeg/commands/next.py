"""``bayesdeg next``: which further experiment would best tell apart the causes in question."""

import math
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic import Field
from rich.table import Table
from rich.text import Text

from bayesdeg.console import output, say
from bayesdeg.criticism.experiments.ranking import LEAST
from bayesdeg.criticism.findings import ExperimentEntry
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.pages.left_out import OptionalStage
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.wording import NOTHING, count, fixed, listed, sentences
from bayesdeg.prediction.stored import run_in
from bayesdeg.records import FileRecord, Names

HEADINGS = (
    "experiment",
    "tells apart",
    "expected log\nBayes factor",
    "odds for\nthe truth",
    "specimens",
    "readings",
    "per\nspecimen",
)
LARGE = 1e6


class Proposals(FileRecord):
    """What ``next`` prints with ``--json``."""

    title: str
    virtual: bool
    outcome: Outcome
    causes: Names
    messages: Names = Field(description="warnings and notes")
    next_experiments: tuple[ExperimentEntry, ...]


def next_experiment(report: Path, as_json: bool, quiet: bool) -> None:
    """Do what `interface.next_experiment` says."""
    _, run, verdict = run_in(report)
    proposals, messages = verdict.next_experiments, []
    if not proposals:
        left_out = verdict.why_left_out(OptionalStage.EXPERIMENTS)
        facts = {"v": verdict, "left_out": left_out, "least": LEAST, "degrades": run.degrades}
        messages.append(sentences("answers", "nothing_proposed", **facts))
    messages += _never_told_apart(proposals)
    if as_json:
        answer = Proposals(
            title=run.title,
            virtual=run.virtual,
            outcome=verdict.outcome,
            causes=verdict.causes,
            messages=tuple(messages),
            next_experiments=proposals,
        )
        sys.stdout.write(answer.text())
        return
    if proposals:
        output().print(_table(run, verdict))
    else:
        output().print(messages[0], soft_wrap=True)
        messages = messages[1:]
    if not quiet:
        say(messages)


def odds(expected: float | None) -> str:
    """Format the odds that correspond to a log Bayes factor.

    Examples
    --------
    >>> odds(6.3), odds(0.4), odds(600.0), odds(None)
    ('545 : 1', '1.5 : 1', '> 10⁶ : 1', '–')
    """
    if expected is None:
        return NOTHING
    if expected > math.log(LARGE):
        return "> 10⁶ : 1"
    ratio = math.exp(expected)
    return f"{count(ratio) if ratio >= 10.0 else fixed(ratio, 1)} : 1"


def _never_told_apart(proposals: Sequence[ExperimentEntry]) -> Iterator[str]:
    """Say which pairs of causes no experiment is expected to tell apart."""
    best: dict[tuple[str, ...], float] = {}
    for proposal in proposals:
        for pair in proposal.pairs:
            key = tuple(sorted(pair.causes))
            best[key] = max(best.get(key, 0.0), pair.expected_log_bayes_factor or 0.0)
    for causes, expected in best.items():
        if expected < LEAST:
            yield sentences("answers", "never_told_apart", causes=causes)


def _table(run: RunRecord, verdict: VerdictRecord) -> Table:
    virtual = "; virtual experiment" if run.virtual else ""
    title = f"{run.title}\nnext experiments, the best first (verdict: {verdict.outcome}{virtual})"
    # as Text, or brackets would be read as markup
    table = Table(title=Text(title), title_justify="left", show_lines=True)
    for number, heading in enumerate(HEADINGS):
        table.add_column(Text(heading), justify="left" if number < 2 else "right")
    for p in verdict.next_experiments:
        table.add_row(
            Text(p.design),
            listed(p.separates),
            fixed(p.expected_log_bayes_factor, 1),
            odds(p.expected_log_bayes_factor),
            count(p.specimens),
            count(p.readings),
            fixed(p.per_specimen, 1),
        )
    return table
