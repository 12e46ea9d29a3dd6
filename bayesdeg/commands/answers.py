"""Common parts of commands that use a stored posterior: reading numbers, printing answers."""

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

from bayesdeg.console import output, say
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.files import spreadsheet_safe, written
from bayesdeg.pipeline import forecast
from bayesdeg.pipeline.posterior import Posterior
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.soil import Level
from bayesdeg.records import FileRecord, Names, Scalar, is_absent
from bayesdeg.report.folder import RunFolder
from bayesdeg.report.wording import number

Floats = NDArray[np.float64]

MOST_ROWS = 5000


def stored_run(report: Path, cause: str | None, *, base: bool, emulator: Path | None) -> Posterior:
    """Return a finished run as it is asked for: averaged, with one cause, or its base model.

    Raises
    ------
    typer.BadParameter
        If both a cause and the base model are requested.
    BayesdegError
        If the folder is not that of a finished run, or the cause is none of those that the run
        could not tell apart.
    """
    if base and cause is not None:
        raise typer.BadParameter("give --base or --cause, not both: the base model has no cause")
    stored = forecast.read_stored(report, base=base, emulator=emulator)
    return stored if cause is None else stored.with_cause(cause)


def numbers(texts: Sequence[str], option: str, unit: str, *, low: float, high: float) -> Floats:
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
    found = [
        value
        for text in texts
        for part in text.split(",")
        for value in (_range(part, option) if ":" in part else [_number(part, option)])
    ]
    for value in found:
        if not (low <= value <= high and math.isfinite(value)):
            upper = f" and not above {high:g}" if math.isfinite(high) else ""
            raise typer.BadParameter(
                f"{option} {value:g} {unit} is out of range; give numbers not below {low:g}{upper}"
            )
    return np.unique(np.array(found))


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError as fault:
        raise typer.BadParameter(
            f"{option} {text!r} is not a number; write 100, or 50,100, or 0:240:20"
        ) from fault


def _range(text: str, option: str) -> list[float]:
    parts = [_number(part, option) for part in text.split(":")]
    if len(parts) != 3 or not all(map(math.isfinite, parts)):
        raise typer.BadParameter(
            f"{option} {text!r} is not a range; write first:last:step, such as 0:240:20"
        )
    first, last, step = parts
    if not (step > 0.0 and last >= first):
        raise typer.BadParameter(
            f"{option} {text!r} is an empty range; the step must be above 0 and the last number "
            "not below the first"
        )
    count = math.floor((last - first) / step + 1e-9) + 1
    if count > MOST_ROWS:
        raise typer.BadParameter(
            f"{option} {text!r} has {count} numbers, more than {MOST_ROWS}; use a wider step"
        )
    return [first + step * i for i in range(count)]


def refuse_risk(risk: float) -> None:
    """Refuse a risk that is not between 0 and 1.

    Raises
    ------
    typer.BadParameter
        If it is not above 0 and below 1.
    """
    if not 0.0 < risk < 1.0:
        raise typer.BadParameter(
            f"--risk {risk:g} is out of range; give a probability above 0 and below 1, such as 0.05"
        )


def refuse_too_many(*asked: Sized, most: int = MOST_ROWS) -> None:
    """Refuse more rows than anyone would read.

    Raises
    ------
    typer.BadParameter
        If there are more than the limit.
    """
    rows = math.prod(len(values) for values in asked)
    if rows > most:
        raise typer.BadParameter(
            f"{rows} combinations requested, more than {most}; request fewer at a time"
        )


def inputs_of(texts: Sequence[str], wanted: Sequence[str]) -> dict[str, Floats]:
    """Return columns of inputs: every combination of the listed values.

    Parameters
    ----------
    texts : sequence of str
        Options as given: ``height_m=1,2``.
    wanted : sequence of str
        Names of the inputs, all of which must be given.

    Raises
    ------
    typer.BadParameter
        If one is missing, unknown or not a number.

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


def seed_of(stored: Posterior, given: int | None) -> np.random.SeedSequence:
    """Return the seed of an answer as in the Python functions: the user's, or else the run's."""
    return forecast.answer_seed((stored.run.seed or 0) if given is None else given)


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


def print_json(
    stored: Posterior,
    table: pd.DataFrame,
    messages: Sequence[str],
    units: dict[str, str],
    summary: Mapping[str, float | None] | None = None,
) -> None:
    """Print an answer as JSON.

    Parameters
    ----------
    stored : Posterior
        Of which model and run it is.
    table : DataFrame
        The answer; missing values become null.
    messages : sequence of str
        Warnings and notes.
    units : dict
        Units by column.
    summary : mapping, optional
        Numbers that belong to no row.
    """
    rows = [
        {name: None if pd.isna(value) else value for name, value in row.items()}
        for row in table.to_dict("records")
    ]
    answer = Answer(
        title=stored.run.title,
        virtual=stored.run.virtual,
        model=stored.name,
        outcome=stored.verdict.outcome,
        units={name: unit for name, unit in units.items() if name in table},
        messages=tuple(messages),
        summary=summary or {},
        rows=tuple({str(name): cell for name, cell in row.items()} for row in rows),
    )
    sys.stdout.write(answer.text())


def delivered(
    stored: Posterior,
    table: pd.DataFrame,
    messages: Sequence[str],
    units: dict[str, str],
    *,
    out: Path | None,
    quiet: bool,
    as_json: bool,
    summary: Mapping[str, float | None] | None = None,
) -> bool:
    """Write the answer if requested, print its messages, and print it as JSON if requested.

    Returns
    -------
    bool
        Whether nothing is left to be shown.
    """
    if out is not None:
        write_csv(out, table)
    if not quiet:
        say(messages)
    if as_json:
        print_json(stored, table, messages, units, summary)
    return as_json


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


def show_rows(stored: Posterior, table: pd.DataFrame, units: Mapping[str, str]) -> None:
    """Print a table of numbers, each column with its unit."""
    names = [str(name) for name in table]
    heads = (f"{name}\n[{units[name]}]" if units.get(name) else name for name in names)
    printed = empty_table(stored, list(heads))
    for row in table.itertuples(index=False):
        printed.add_row(
            *(
                "–" if pd.isna(cell) else number(cell) if isinstance(cell, float) else str(cell)
                for cell in row
            )
        )
    output().print(printed)


def needed(given: list[str] | None, option: str, **own: list[str] | None) -> list[str]:
    """Return the value of an option for actuators.

    Raises
    ------
    typer.BadParameter
        If it is missing, or an option for a user's forward map is given.
    """
    for name, value in own.items():
        if value:
            raise typer.BadParameter(
                f"--{name} is only for your own forward map; this run is of films or actuators"
            )
    if not given:
        raise typer.BadParameter(f"{option} is missing")
    return given


def levels_of(
    report: Path, degradation: list[str] | None, hours: list[str] | None, seed: int | None
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
        if not degradation and _degrades(report):
            raise typer.BadParameter("--degradation is missing; give it, or --hours in the soil")
        rates = numbers(degradation or ["0"], "--degradation", "%", low=0.0, high=100.0)
        return forecast.levels_at(degradation=rates, hours=None, soil=None, seed=seed)
    times = numbers(hours, "--hours", "h", low=0.0, high=math.inf)
    soil = forecast.soil_of(report)
    seed = RunFolder(report).read_run().seed if seed is None else seed
    return forecast.levels_at(degradation=None, hours=times, soil=soil, seed=seed)


def _degrades(report: Path) -> bool:
    return RunFolder(report).read_run().degrades if report.is_dir() else True


def refuse_others(conditions: ServiceConditions, **given: object) -> None:
    """Refuse options of actuators for a user's forward map.

    Raises
    ------
    typer.BadParameter
        Naming the option.
    """
    if conditions != PROMPT:
        raise typer.BadParameter(
            f"{', '.join(conditions.changed)} is only for actuators, not for a study with its own "
            "forward map"
        )
    for name, value in given.items():
        if value:
            raise typer.BadParameter(
                f"--{name} is only for actuators, not for a study with its own forward map; give "
                "--x NAME=VALUES"
            )


def answer(
    stored: Posterior,
    table: pd.DataFrame,
    units: dict[str, str],
    *,
    out: Path | None,
    as_json: bool,
) -> None:
    """Print the answer of a user's forward map, and write it if requested."""
    if out is not None:
        write_csv(out, table)
    if as_json:
        print_json(stored, table, (), units)
    else:
        show_rows(stored, table, units)
