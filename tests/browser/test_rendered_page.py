import json
import re
import struct
import subprocess
from pathlib import Path

import pytest

from bayesdeg.pages.page import build_page
from tests.browser.chromium import CHROMIUM, NEEDED, SWITCHES
from tests.pages.html_reading import read_html
from tests.pages.synthetic_run import write_bare, write_full

pytestmark = NEEDED

FLAGS = [
    *("--headless", *SWITCHES, "--disable-extensions", "--hide-scrollbars"),
    "--enable-logging=stderr",
]

# Appended to a copy of the page; what it measures is read from the dumped tree.
PROBE = """<script>addEventListener("load", () => {
  const say = (name, value) => document.body.setAttribute("data-" + name, value);
  const box = (element) => element.getBoundingClientRect();
  const visible = [...document.querySelectorAll("main *")].filter((e) => box(e).height > 0);
  say("first", visible.find((e) => e.matches("h1, h2, figure, table")).tagName);
  say("verdict-bottom", box(document.querySelector("dl.keys")).bottom);
  say("page-width", document.documentElement.scrollWidth);
  say("window-width", innerWidth);
  say("figures", [...document.querySelectorAll("figure svg")].filter(
    (svg) => box(svg).width > 200 && box(svg).height > 100).length);
  const wide = [...document.querySelectorAll(".scroll, figure .canvas")].filter(
    (part) => part.scrollWidth > part.clientWidth + 1);
  say("wide", wide.length);
  say("cues", document.querySelectorAll(".cue.shown").length);
  say("uncued", wide.filter((part) => !part.previousElementSibling.matches(".cue.shown")).length);
  say("ink", getComputedStyle(document.body).color);
  say("tick", getComputedStyle(document.querySelector("svg text") || document.body).fill);
  dispatchEvent(new Event("beforeprint"));
  say("closed-in-print", document.querySelectorAll("details:not([open])").length);
  dispatchEvent(new Event("afterprint"));
  say("open-after-print", document.querySelectorAll("details[open]").length);
});</script>"""


POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy"[^>]*>')


def chromium(page: Path, *options: str, profile: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [CHROMIUM, *FLAGS, f"--user-data-dir={profile}", *options, page.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )


def complaints(run: subprocess.CompletedProcess[str]) -> list[str]:
    return [line for line in run.stderr.splitlines() if "CONSOLE" in line]


def measured(page: Path, profile: Path, width: int) -> tuple[dict[str, str], list[str]]:
    probed = page.with_name("probed.html")
    text = page.read_text(encoding="utf-8").replace("</body>", PROBE + "</body>")
    # the page's own policy refuses any script but its own, as a test below shows
    probed.write_text(POLICY.sub("", text), encoding="utf-8")
    run = chromium(probed, f"--window-size={width},900", "--dump-dom", profile=profile)
    return read_html(run.stdout).all("body")[0].attributes, complaints(run)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("named")
    write_full(folder, "named", virtual=True)
    return build_page(folder)


def test_complaints_of_a_page_are_noticed(tmp_path):
    bad = tmp_path / "bad.html"
    bad.write_text("<!DOCTYPE html><title>x</title><script>no.such.thing</script>")
    assert complaints(chromium(bad, "--dump-dom", profile=tmp_path / "profile"))


def test_a_wide_window_shows_the_verdict_first_and_without_scrolling(page, tmp_path):
    found, problems = measured(page, tmp_path, 1280)
    assert problems == []
    assert found["data-first"] == "H1"
    assert float(found["data-verdict-bottom"]) < 900
    assert int(found["data-page-width"]) <= int(found["data-window-width"])
    assert found["data-figures"] == "12"
    assert found["data-closed-in-print"] == "0"
    assert found["data-open-after-print"] == "0"
    assert found["data-tick"] == found["data-ink"]
    assert int(found["data-wide"]) < 3
    assert found["data-cues"] == found["data-wide"]


def test_a_narrow_window_does_not_scroll_sideways(page, tmp_path):
    found, problems = measured(page, tmp_path, 420)
    assert problems == []
    assert int(found["data-window-width"]) < 600
    assert int(found["data-page-width"]) <= int(found["data-window-width"])
    assert found["data-figures"] == "12"
    assert int(found["data-wide"]) > 10
    assert found["data-cues"] == found["data-wide"]
    assert found["data-uncued"] == "0"


def test_the_page_of_a_study_without_actuator_data_renders(tmp_path):
    write_bare(tmp_path / "run")
    found, problems = measured(build_page(tmp_path / "run"), tmp_path / "profile", 1280)
    assert problems == []
    assert found["data-first"] == "H1"
    assert found["data-figures"] == "0"


def test_no_script_but_the_page_s_own_runs_in_it(page, tmp_path):
    """Not even one that came in with a text, nor anything from outside."""
    foreign = (
        "<script>document.body.dataset.foreign = 1</script>"
        '<img src="https://example.org/x.png" onerror="document.body.dataset.foreign = 2">'
    )
    text = page.read_text(encoding="utf-8")
    hostile = page.with_name("hostile.html")
    hostile.write_text(text.replace("</body>", foreign + "</body>"), encoding="utf-8")
    run = chromium(hostile, "--dump-dom", profile=tmp_path)
    body = read_html(run.stdout).all("body")[0]
    assert "data-foreign" not in body.attributes
    assert any("Content Security Policy" in line for line in complaints(run))
    assert [one for one in body.every() if one.attributes.get("class") == "copy"]


SORT = """<script>addEventListener("load", () => {
  const table = [...document.querySelectorAll("table")].find((t) => t.querySelector("button.sort"));
  const header = [...table.tHead.rows[0].cells].find((h) => h.matches(".num"));
  const read = () => [...table.tBodies[0].rows].map((row) => row.cells[header.cellIndex].innerText);
  header.querySelector("button").click();
  document.body.dataset.upwards = JSON.stringify(read());
  header.querySelector("button").click();
  document.body.dataset.downwards = JSON.stringify(read());
  document.body.dataset.sort = header.getAttribute("aria-sort");
});</script>"""


def test_tables_are_sorted_by_a_press_of_their_headers(page, tmp_path):
    text = POLICY.sub("", page.read_text(encoding="utf-8"))
    probed = page.with_name("sorted.html")
    probed.write_text(text.replace("</body>", SORT + "</body>"), encoding="utf-8")
    run = chromium(probed, "--dump-dom", profile=tmp_path)
    assert complaints(run) == []
    found = read_html(run.stdout).all("body")[0].attributes
    upwards, downwards = (
        [
            float(re.sub(r"[^0-9.+-]", "", cell.replace("−", "-").split(" ")[0]) or "nan")
            for cell in cells
        ]
        for cells in (json.loads(found["data-upwards"]), json.loads(found["data-downwards"]))
    )
    known = [number for number in upwards if number == number]
    assert len(known) > 1
    assert known == sorted(known)
    assert [number for number in downwards if number == number] == known[::-1]
    assert found["data-sort"] == "descending"


def test_a_screenshot_can_be_taken(page, tmp_path):
    picture = tmp_path / "page.png"
    options = (f"--screenshot={picture}", "--window-size=1000,700")
    run = chromium(page, *options, profile=tmp_path / "profile")
    assert complaints(run) == []
    assert struct.unpack(">II", picture.read_bytes()[16:24]) == (1000, 700)
    assert picture.stat().st_size > 20_000
