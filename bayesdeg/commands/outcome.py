"""What a campaign and the training on it came to, as a table for the terminal."""

import csv
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from bayesdeg.actuator.status import Status
from bayesdeg.emulator.solutions import ANSWERS, Run
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.pipeline.record import emulator_facts
from bayesdeg.report.wording import fixed, percent, words


def list_failures(path: Path, ended: list[tuple[Run, Status]]) -> Path | None:
    """List the parameters of failed runs in a CSV file beside an emulator; None if none failed.

    Parameters
    ----------
    path : Path
        The emulator's file.
    ended : list of (Run, Status)
        All runs of the campaign.
    """
    listed = path.with_suffix(".failures.csv")
    rows = [
        {"status": status.name, "advice": status.advice, "run": run.key()}
        | {f"mesh_{name}": value for name, value in asdict(run.resolution).items()}
        | {"largest_load": run.curve.loads[-1] if run.curve.loads else 0.0}
        | asdict(run.curve.material)
        for run, status in ended
        if status not in ANSWERS
    ]
    if not rows:
        listed.unlink(missing_ok=True)
        return None
    with listed.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return listed


def runs_table(ended: list[tuple[Run, Status]]) -> Table:
    """Return how the runs ended, by mesh and status."""
    table = Table(title="finite element curves", title_justify="left")
    meshes = list(dict.fromkeys(run.resolution for run, _ in ended))
    table.add_column("how they ended", overflow="fold")
    for mesh in meshes:
        table.add_column(f"mesh of {mesh.along:g} mm", justify="right")
    counts = Counter((run.resolution, status) for run, status in ended)
    for status in sorted({status for _, status in ended}):
        failed = "" if status in ANSWERS else "failed: "
        numbers = [str(counts[mesh, status]) for mesh in meshes]
        table.add_row(f"{failed}{status.advice.split(':')[0].split(';')[0]}", *numbers)
    totals = [str(sum(run.resolution == mesh for run, _ in ended)) for mesh in meshes]
    table.add_section()
    table.add_row("all", *totals)
    return table


def accuracy_table(surrogate: Surrogate) -> Table:
    """Return how accurate an emulator is on curves that it was not trained on."""
    facts: dict[str, Any] = emulator_facts(surrogate.record)
    table = Table(title="emulator, on curves not trained on [%]", title_justify="left")
    table.add_column("quantity")
    for heading in ("rms", "95th percentile", "largest", "inside its 90 %"):
        table.add_column(heading, justify="right")
    for row in facts["accuracy"]:
        sizes = [fixed(row[name]) for name in ("rms_pct", "p95_pct", "max_pct")]
        table.add_row(words(row["quantity"]), *sizes, percent(row["coverage_90"]))
    return table
