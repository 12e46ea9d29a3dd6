"""Common parts of commands that ask a finished run: reading numbers, printing answers."""

import math
import sys
from collections.abc import Mapping, Sequence, Sized
from pathlib import Path

import numpy as np
import pandas as pd
import typer
from numpy.typing import NDArray
from pydantic import Field
from rich.table import Table
from rich.text import Text

from bayesdeg.commands.options import Asking
from bayesdeg.console import output, say
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.files import spreadsheet_safe, written
from bayesdeg.inference.own_map import own_map_of
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.output import output_file
from bayesdeg.pages.wording import number
from bayesdeg.prediction import own
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.forecast import Forecast, levels_after
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.prediction.soil import Level, known_levels
from bayesdeg.prediction.stored import read_stored, soil_of
from bayesdeg.records import FileRecord, Names, Scalar, is_absent

Floats = NDArray[np.float64]
Texts = list[str]

MOST_ROWS = 5000


def posterior_asked(report: Path, asking: Asking) -> Posterior:
    """Return the posterior of a finished run: averaged, with one cause, or of its base model.

    A file that the answer cannot be written to is refused first.

    Raises
    ------
    typer.BadParameter
        If both a cause and the base model are requested.
    BayesdegError
        If the folder is not that of a finished run, or the cause is none of those that the run
        could not tell apart.
    """
    if asking.out is not None:
        output_file(asking.out)
    if asking.base and asking.cause is not None:
        raise typer.BadParameter("give --base or --cause, not both: the base model has no cause")
    stored = read_stored(report, base=asking.base, emulator=asking.emulator)
    return stored if asking.cause is None else stored.with_cause(asking.cause)


def seed_of(stored: Posterior, asking: Asking) -> int:
    """Return the seed of an answer: the user's, or else the run's."""
    return (stored.run.seed or 0) if asking.seed is None else asking.seed


def numbers(texts: Texts, option: str, unit: str, *, low: float, high: float) -> Floats:
    """Return the numbers listed by an option, sorted and without duplicates.

    Parameters
    ----------
    texts : sequence of str
        Numbers, lists ``0,10``, or ranges ``first:last:step`` that include their ends.
    option, unit : str
        For messages.
    low, high : float
        Limits.

    Raises
    ------
    typer.BadParameter
        If one is not a number or is outside the limits.

    Examples
    --------
    >>> numbers(["0:100:50", "70,0"], "--pressure", "kPa", low=0.0, high=np.inf).tolist()
    [0.0, 50.0, 70.0, 100.0]
    """

    def single(text: str) -> float:
        try:
            return float(text)
        except ValueError as fault:
            raise typer.BadParameter(
                f"{option} {text!r} is not a number; write 100, or 50,100, or 0:240:20"
            ) from fault

    def several(text: str) -> list[float]:
        parts = [single(part) for part in text.split(":")]
        if len(parts) != 3 or not all(map(math.isfinite, parts)):
            raise typer.BadParameter(
                f"{option} {text!r} is not a range; write first:last:step, such as 0:240:20"
            )
        first, last, step = parts
        if not (step > 0.0 and last >= first):
            raise typer.BadParameter(
                f"{option} {text!r} is an empty range; the step must be above 0 and the last "
                "number not below the first"
            )
        count = math.floor((last - first) / step + 1e-9) + 1
        if count > MOST_ROWS:
            raise typer.BadParameter(
                f"{option} {text!r} has {count} numbers, more than {MOST_ROWS}; use a wider step"
            )
        return [first + step * i for i in range(count)]

    parts = [part for text in texts for part in text.split(",")]
    found = [v for part in parts for v in (several(part) if ":" in part else [single(part)])]
    for value in found:
        if not (low <= value <= high and math.isfinite(value)):
            upper = f" and not above {high:g}" if math.isfinite(high) else ""
            raise typer.BadParameter(
                f"{option} {value:g} {unit} is out of range; give numbers not below {low:g}{upper}"
            )
    return np.unique(np.array(found))


def refuse_risk(risk: float) -> None:
    """Refuse a risk that is not between 0 and 1."""
    if not 0.0 < risk < 1.0:
        raise typer.BadParameter(
            f"--risk {risk:g} is out of range; give a probability above 0 and below 1, such as 0.05"
        )


def refuse_too_many(*asked: Sized, most: int = MOST_ROWS) -> None:
    """Refuse more rows than anyone would read."""
    rows = math.prod(len(values) for values in asked)
    if rows > most:
        raise typer.BadParameter(
            f"{rows} combinations requested, more than {most}; request fewer at a time"
        )


def levels_of(
    report: Path, degradation: Texts | None, hours: Texts | None, seed: int | None
) -> tuple[Level, ...]:
    """Return the requested degradation rates, given directly or by hours in the soil.

    In a study in which nothing degrades it is 0 unless another is given.

    Raises
    ------
    typer.BadParameter
        If neither or both are given, or one is out of range.
    BayesdegError
        If the study has no course of degradation.
    """
    if degradation and hours:
        raise typer.BadParameter("give --degradation or --hours, not both")
    if not hours:
        degrades = not report.is_dir() or RunFolder(report).read_run().degrades
        if not degradation and degrades:
            raise typer.BadParameter("--degradation is missing; give it, or --hours in the soil")
        rates = numbers(degradation or ["0"], "--degradation", "%", low=0.0, high=100.0)
        return known_levels(rates)
    times, soil = numbers(hours, "--hours", "h", low=0.0, high=math.inf), soil_of(report)
    return levels_after(
        times, soil, int((RunFolder(report).read_run().seed if seed is None else seed) or 0)
    )


# ---- a user's own forward map


def is_own(report: Path) -> bool:
    """Return whether a folder is of a run with a user's forward map."""
    return report.is_dir() and bool(RunFolder(report).read_run().forward)


def needed(given: Texts | None, option: str, **own_options: Texts | None) -> Texts:
    """Return the value of an option for actuators, which may not be missing.

    Options for a user's forward map are refused.
    """
    for name, value in own_options.items():
        if value:
            raise typer.BadParameter(
                f"--{name} is only for your own forward map; this run is of films or actuators"
            )
    if not given:
        raise typer.BadParameter(f"{option} is missing")
    return given


def inputs_of(texts: Texts, wanted: Texts) -> dict[str, Floats]:
    """Return columns of inputs: every combination of the listed values ``NAME=VALUES``.

    Raises
    ------
    typer.BadParameter
        If a wanted input is missing, or one is unknown or not a number.

    Examples
    --------
    >>> inputs_of(["b=5", "a=1:2:1"], ["a", "b"])
    {'a': array([1., 2.]), 'b': array([5., 5.])}
    """
    given: dict[str, Floats] = {}
    for text in texts:
        name, equals, values = text.partition("=")
        if not equals or name not in wanted:
            raise typer.BadParameter(
                f"--x {text!r}: write NAME=VALUES, NAME being one of {', '.join(wanted)}"
            )
        given[name] = numbers([values], f"--x {name}", "", low=-math.inf, high=math.inf)
    missing = [name for name in wanted if name not in given]
    if missing:
        raise typer.BadParameter(f"--x {missing[0]}=... is missing; the study's function needs it")
    refuse_too_many(*given.values())
    grid = np.meshgrid(*(given[name] for name in wanted), indexing="ij")
    return {name: column.ravel() for name, column in zip(wanted, grid, strict=True)}


def ask_own(
    report: Path,
    asking: Asking,
    x: Texts | None,
    reading: Texts | None = None,
    *,
    inverse: bool,
    conditions: ServiceConditions,
    **of_actuators: Texts | None,
) -> bool:
    """Answer with a user's forward map: predict, or find the input for a reading.

    Returns False, with nothing done, for a run of films or actuators. Options of actuators are
    refused.
    """
    if not is_own(report):
        return False
    if conditions != PROMPT:
        raise typer.BadParameter(
            f"{', '.join(conditions.changed)} is only for actuators, not for a study with its own "
            "forward map"
        )
    for name, value in {**of_actuators, "cause": asking.cause}.items():
        if value:
            raise typer.BadParameter(
                f"--{name} is only for actuators, not for a study with its own forward map; give "
                "--x NAME=VALUES"
            )
    stored = posterior_asked(report, asking)
    block = own_map_of(stored.model).readings[0]
    seed = seed_of(stored, asking)
    if not inverse:
        found = own.predict(stored, inputs_of(x or [], list(block.x)), seed)
    else:
        if not reading:
            raise typer.BadParameter("--reading is missing")
        wanted = numbers(reading, "--reading", block.unit, low=-np.inf, high=np.inf)
        at = inputs_of(x or [], list(block.x))
        several = [name for name, column in at.items() if len(np.unique(column)) > 1]
        if several != list(at)[:1]:
            raise typer.BadParameter(
                f"give a range for --x {next(iter(at))}, and one value for each other input"
            )
        found = own.control(stored, wanted, at, seed)
    table = found.table.drop(columns="unit")
    if not delivered(stored, Forecast(table, found.units), asking):
        names = [str(name) for name in table]
        heads = (f"{n}\n[{found.units[n]}]" if found.units.get(n) else n for n in names)
        printed = empty_table(stored, list(heads))
        for row in table.itertuples(index=False):
            printed.add_row(
                *(
                    "–" if pd.isna(cell) else number(cell) if isinstance(cell, float) else str(cell)
                    for cell in row
                )
            )
        output().print(printed)
    return True


# ---- printing


class Answer(FileRecord):
    """What ``predict``, ``control`` and ``lifetime`` print with ``--json``."""

    title: str
    virtual: bool
    model: str = Field(
        description="the model by its causes: base, base+pressure_offset; averaged: base+creep or "
        "base+mullins"
    )
    outcome: Outcome = Field(description="of the run")
    units: Mapping[str, str] = Field(description="by column of the rows")
    messages: Names = Field(description="warnings and notes")
    summary: Mapping[str, Scalar] = Field(
        default={}, exclude_if=is_absent, description="for lifetime: times in hours"
    )
    rows: tuple[Mapping[str, Scalar], ...]


def delivered(stored: Posterior, answer: Forecast, asking: Asking) -> bool:
    """Write the answer if requested, print its messages, and print it as JSON if requested.

    Missing values become null. Returns whether nothing is left to be shown.
    """
    table, headline = answer.table, (answer.headline,) if answer.headline else ()
    # the headline follows the table; in JSON it is among the messages
    messages = (*headline, *answer.messages) if asking.as_json else answer.messages
    if asking.out is not None:
        write_csv(asking.out, table)
    if not asking.quiet:
        say(messages)
    if asking.as_json:
        printed = Answer(
            title=stored.run.title,
            virtual=stored.run.virtual,
            model=stored.name,
            outcome=stored.verdict.outcome,
            units={name: unit for name, unit in answer.units.items() if name in table},
            messages=messages,
            summary=answer.summary,
            rows=tuple(
                {str(name): None if pd.isna(cell) else cell for name, cell in row.items()}
                for row in table.to_dict("records")
            ),
        )
        sys.stdout.write(printed.text())
    return asking.as_json


def write_csv(path: Path, table: pd.DataFrame) -> None:
    """Write a table as CSV.

    Raises
    ------
    ResumableError
        If the file cannot be written, as when the disk is full.
    """
    with written(path) as part:
        table.map(spreadsheet_safe).to_csv(part, index=False, encoding="utf-8")


def empty_table(stored: Posterior, headings: Sequence[str], addition: str = "") -> Table:
    """Return a table for the terminal, titled with its run and model."""
    run = stored.run
    virtual = "; virtual experiment" if run.virtual else ""
    title = f"{run.title}\n{stored.name} (verdict: {stored.verdict.outcome}{virtual}){addition}"
    # as Text, or units in brackets would be read as markup
    table = Table(title=Text(title), title_justify="left")
    for heading in headings:
        table.add_column(Text(heading), justify="right", no_wrap=True)
    return table
