"""``bayesdeg causes``: the catalogue of causes."""

from rich.text import Text

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.console import console


def causes() -> None:
    """Do what `interface.causes` says."""
    printed = console()
    for cause in CATALOGUE.values():
        printed.print(Text.assemble((cause.name, "bold"), f": {cause.mechanism}"))
        for p in cause.parameters:
            printed.print(f"    {p.name} [{p.unit}]: {p.meaning}; prior {p.law}")
        printed.print(f"    revealed by: {cause.revealed_by}")
        if cause.confusable_with:
            printed.print(f"    can be confused with: {', '.join(cause.confusable_with)}")
        if cause.needs:
            printed.print(f"    needs columns: {', '.join(cause.needs)}")
