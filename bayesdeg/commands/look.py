"""Commands that compute nothing: ``bayesdeg check``, ``causes`` and ``report``."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from bayesdeg.actuator.forward import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import FINE
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.commands.options import StudyFolder
from bayesdeg.console import errors
from bayesdeg.emulator.trained import find
from bayesdeg.measure.study import Study, read_study
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.report.page import build_page


def check(study: StudyFolder) -> None:
    """Read and check the data only; exit code 2 and the list of faults if there are any."""
    checked = read_study(study)
    # a forward map of any geometry: nothing is solved
    assembly = assemble(checked, ExactMap(Geometry(checked.settings.dimensions), FINE))
    table = Table(title=f"{checked.name}: no faults", title_justify="left")
    for heading in ("file", "rows", "read"):
        table.add_column(heading, justify="right" if heading == "rows" else "left")
    for name, frame in _tables(checked):
        table.add_row(name, "–" if frame is None else str(frame), "" if frame else "not there")
    errors.print(table)
    for what, cost in assembly.missing:
        errors.print(f"without {what}: {cost}")
    if assembly.model.actuator is not None:
        found = find(Geometry(checked.settings.dimensions))
        if found.surrogate is None:
            errors.print(f"{found.reason}; 'bayesdeg run' trains one first", soft_wrap=True)


def causes() -> None:
    """List the catalogue: mechanism, parameters with units and priors, what reveals each cause."""
    console = Console()
    for cause in CATALOGUE.values():
        console.print(f"[bold]{cause.name}[/bold]: {cause.mechanism}")
        for p in cause.parameters:
            console.print(f"    {p.name} [{p.unit}]: {p.meaning}; prior {p.law}", markup=False)
        console.print(f"    revealed by: {cause.revealed_by}", markup=False)
        if cause.confusable_with:
            console.print(f"    can be confused with: {', '.join(cause.confusable_with)}")
        if cause.needs:
            console.print(f"    needs columns: {', '.join(cause.needs)}")


def report(
    folder: Annotated[Path, typer.Argument(help="A run folder.", metavar="REPORT")],
) -> None:
    """Rebuild the HTML report from a run folder without computing anything."""
    errors.print(f"wrote {build_page(folder)}")


def _tables(study: Study) -> Iterator[tuple[str, int | None]]:
    for name in ("moisture", "shrinkage", "tensile", "breaks", "actuator", "summary"):
        frame = getattr(study, name)
        yield (
            ("break.csv" if name == "breaks" else f"{name}.csv"),
            None if frame is None else len(frame),
        )
