"""Pages of made-up runs, built once for all tests."""

from collections.abc import Callable
from pathlib import Path

import pytest

from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.page import build_page
from tests.pages.drawn_once import remember
from tests.pages.synthetic_run import write_bare, write_full

type Built = tuple[RunFolder, str]


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Built]:
    """Build the page of a run once; gives the folder and the HTML."""
    known: dict[tuple[str, bool], Built] = {}

    def build(outcome: str, *, virtual: bool = False) -> Built:
        if (outcome, virtual) not in known:
            path: Path = tmp_path_factory.mktemp(outcome)
            if outcome == "bare":
                folder = write_bare(path, virtual=virtual)
            else:
                folder = write_full(path, outcome, virtual=virtual)
            known[outcome, virtual] = folder, build_page(path).read_text(encoding="utf-8")
        return known[outcome, virtual]

    return build


@pytest.fixture(scope="module", autouse=True)
def drawn_once():
    """Figures of pages are drawn once where they show the same."""
    with pytest.MonkeyPatch.context() as patch:
        remember(patch)
        yield
