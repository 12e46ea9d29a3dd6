"""``bayesdeg causes``: the catalogue of causes."""

from rich.console import Console

from bayesdeg.causes.catalogue import CATALOGUE


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
