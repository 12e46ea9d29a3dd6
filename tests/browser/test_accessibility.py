"""Reports as an automatic checker of accessibility (axe-core) sees them, in a real browser."""

from functools import cache
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe

from bayesdeg.criticism.outcome import Outcome
from bayesdeg.pages.page import build_page
from tests.browser.chromium import NEEDED
from tests.marks import long_unless
from tests.pages.synthetic_run import write_bare, write_full

ROOT = Path(__file__).parents[2]
PUBLISHED = [ROOT / "reports" / name / "index.html" for name in ("gelatin_actuator", "treloar")]
OPEN = "document.querySelectorAll('details').forEach(one => { one.open = true; })"

pytestmark = NEEDED


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Return the page of an outcome, of an unjudged run, or a published one."""
    top = tmp_path_factory.mktemp("pages")
    published = {path.parent.name: path for path in PUBLISHED}

    @cache
    def made(name):
        if name in published:
            return published[name]
        if name == "bare":
            write_bare(top / name)
        else:
            write_full(top / name, name, virtual=name == Outcome.NAMED)
        return build_page(top / name)

    return made


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
        long_unless((name, shape) in PLAIN, name, *shape)
        for name in NAMES
        for shape in (WIDE, NARROW)
    ],
)
def test_a_report_has_no_finding(page, browser, name, width, scheme):
    """Contrast AA, landmarks, headers of tables, names of controls, alternative texts."""
    assert not findings(browser, page(name), width=width, scheme=scheme)


def test_the_checker_finds_what_is_wrong(page, browser, tmp_path):
    sound = page("bare").read_text(encoding="utf-8")
    pale = sound.replace("--muted: #", "--muted: #fdfdfc; --unused: #")
    spoilt = pale.replace("<main>", '<main><svg role="img"></svg>')
    (tmp_path / "spoilt.html").write_text(spoilt, encoding="utf-8")
    found = findings(browser, tmp_path / "spoilt.html", width=1300, scheme="light")
    assert {"color-contrast", "svg-img-alt"} <= {name for name, _ in found}
