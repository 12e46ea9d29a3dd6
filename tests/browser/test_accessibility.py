"""Reports as an automatic checker of accessibility (axe-core) sees them, in a real browser."""

from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe

from bayesdeg.criticism.outcome import Outcome
from bayesdeg.pages.page import build_page
from tests.browser.chromium import NEEDED
from tests.pages.synthetic_run import write_bare, write_full

ROOT = Path(__file__).parents[2]
PUBLISHED = [ROOT / "reports" / name / "index.html" for name in ("gelatin_actuator", "treloar")]
OPEN = "document.querySelectorAll('details').forEach(one => { one.open = true; })"

pytestmark = NEEDED


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """A page of every outcome, one of an unjudged run, and those that are published."""
    top = tmp_path_factory.mktemp("pages")
    made = {}
    for outcome in Outcome:
        write_full(top / outcome.value, outcome.value, virtual=outcome is Outcome.NAMED)
        made[outcome.value] = build_page(top / outcome.value)
    write_bare(top / "bare")
    made["bare"] = build_page(top / "bare")
    return made | {path.parent.name: path for path in PUBLISHED}


def findings(browser, path, *, width, scheme):
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, reduced_motion="reduce"
    )
    page = context.new_page()
    page.goto(path.as_uri())
    page.evaluate(OPEN)
    found = Axe().run(page).response["violations"]
    context.close()
    return {(one["id"], one["impact"]): one["nodes"][0]["html"] for one in found}


NAMES = [*(outcome.value for outcome in Outcome), "bare", *(p.parent.name for p in PUBLISHED)]
WIDE, NARROW = (1300, "light"), (390, "dark")
# a plain run checks a page at full width and two others on a narrow screen
PLAIN = {("treloar", WIDE), ("ambiguous", NARROW), ("bare", NARROW)}


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    [
        pytest.param(name, *shape, marks=() if (name, shape) in PLAIN else pytest.mark.long)
        for name in NAMES
        for shape in (WIDE, NARROW)
    ],
)
def test_a_report_has_no_finding(pages, browser, name, width, scheme):
    """Contrast AA, landmarks, headers of tables, names of controls, alternative texts."""
    assert not findings(browser, pages[name], width=width, scheme=scheme)


def test_the_checker_finds_what_is_wrong(pages, browser, tmp_path):
    sound = pages["bare"].read_text(encoding="utf-8")
    pale = sound.replace("--muted: #", "--muted: #fdfdfc; --unused: #")
    spoilt = pale.replace("<main>", '<main><svg role="img"></svg>')
    (tmp_path / "spoilt.html").write_text(spoilt, encoding="utf-8")
    found = findings(browser, tmp_path / "spoilt.html", width=1300, scheme="light")
    assert {"color-contrast", "svg-img-alt"} <= {name for name, _ in found}
