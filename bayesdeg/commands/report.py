"""``bayesdeg report``: rebuild the page of a run folder."""

from pathlib import Path

from bayesdeg.console import errors, output
from bayesdeg.pages.left_out import Guard
from bayesdeg.pages.page import build_page


def report(folder: Path) -> None:
    """Do what `interface.report` says."""
    guard = Guard()
    output().print(f"wrote {build_page(folder, guard)}", soft_wrap=True)
    for one in guard.left_out:
        errors.print(f"left out: {one.stage}: {one.why}", soft_wrap=True)
