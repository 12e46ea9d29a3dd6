"""``bayesdeg update``: add further actuator readings to a finished run."""

import sys
from collections.abc import Mapping
from pathlib import Path

from pydantic import Field
from rich.table import Table
from rich.text import Text

from bayesdeg import api
from bayesdeg.console import output, say
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.record import RunRecord, UpdateEntry
from bayesdeg.pages.wording import fixed, number, sentences
from bayesdeg.records import FileRecord, Names, Scalar
from bayesdeg.run.update import Update, most_moved


class UpdateAnswer(FileRecord):
    """What ``update`` prints with ``--json``."""

    title: str
    virtual: bool
    outcome: Outcome = Field(description="of the earlier run: it was not updated")
    folder: str = Field(description="the new run folder")
    messages: Names = Field(description="warnings and notes")
    update: UpdateEntry
    parameters: tuple[Mapping[str, Scalar], ...] = Field(
        description="mean and sd before and after, and the shift in standard deviations before"
    )


def update(
    report: Path,
    new: Path,
    out: Path | None,
    emulator: Path | None,
    seed: int | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Do what `interface.update` says."""
    found = api.update(
        report, new, out=out, emulator=emulator, seed=seed, progress=False if quiet else None
    )
    run = RunFolder(found.folder).read_run()
    if as_json:
        rows = found.moved.to_dict("records")
        answer = UpdateAnswer(
            title=run.title,
            virtual=run.virtual,
            outcome=RunFolder(found.folder).read_verdict().outcome,
            folder=str(found.folder),
            messages=found.messages,
            update=found.entry,
            parameters=tuple({str(name): cell for name, cell in row.items()} for row in rows),
        )
        sys.stdout.write(answer.text())
        return
    output().print(_table(found, run))
    output().print(f"updated run: {found.folder}", soft_wrap=True)
    if not quiet:
        say([sentences("run", "taken_in", one=found.entry.posteriors["final"])])
        say([*found.messages, f"its page: bayesdeg report {found.folder}"])


def _table(found: Update, run: RunRecord) -> Table:
    virtual = " (virtual experiment)" if run.virtual else ""
    title = f"{run.title}{virtual}\nparameters that moved most"
    # as Text, or brackets would be read as markup
    table = Table(title=Text(title), title_justify="left")
    for heading in ("parameter", "unit", "before", "after", "shift\n[sd]"):
        left = heading in ("parameter", "unit")
        table.add_column(Text(heading), justify="left" if left else "right", no_wrap=True)
    for row in most_moved(found.moved).to_dict("records"):
        table.add_row(
            Text(str(row["parameter"])),
            Text(str(row["unit"])),
            f"{number(row['mean_before'])} ± {number(row['sd_before'], 2)}",
            f"{number(row['mean'])} ± {number(row['sd'], 2)}",
            fixed(row["shift_sd"], 2, sign=True),
        )
    return table
