"""The table of sets of causes that may be right, on the page."""

import pandas as pd
import pytest

from bayesdeg.pages.headline import headline_of
from bayesdeg.pages.page import build_page
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.pages.tables import SETS, TABLES
from bayesdeg.pages.wording import listed
from tests.pages import synthetic_run
from tests.pages.html_reading import read_html, table_cells

ROWS = [
    ("creep+pressure_loss", "may be right", 41.2, 0.0, 1.0, "full fit"),
    ("creep+film_mismatch", "may be right", 40.1, 1.1, 3.0, "full fit"),
    ("erosion+film_mismatch", "excluded", 30.5, 10.7, 44000.0, "screening"),
]
CAPTION = "Sets of causes"
LISTS = {"sets": [["creep"], ["pressure_loss", "film_mismatch"]]}
APART = {"alternatives": [["creep", "pressure_loss"], ["creep", "film_mismatch"]]}


def page_of(folder, rows, stated):
    run = synthetic_run.write_full(folder, "named")
    run.write_table(SETS, pd.DataFrame(rows, columns=TABLES[SETS].headings))
    run.write_json("verdict", synthetic_run.verdict("named") | stated)
    return build_page(folder).read_text(encoding="utf-8")


@pytest.mark.parametrize("stated", [LISTS, APART])
def test_every_set_stands_in_the_table_with_its_odds(tmp_path, stated):
    page = page_of(tmp_path / "run", ROWS, stated)
    assert 'href="sets.csv"' in page
    rows = table_cells(read_html(page), CAPTION)
    assert [row[0] for row in rows] == [listed(row[0].split("+")) for row in ROWS]
    assert [(row[1], row[4]) for row in rows] == [(row[1], row[5]) for row in ROWS]
    assert [float(row[2]) for row in rows] == [row[2] for row in ROWS]


def test_one_set_needs_no_table(tmp_path):
    page = page_of(tmp_path / "run", ROWS[:1], {"sets": [["creep"], ["pressure_loss"]]})
    assert 'href="sets.csv"' not in page.split('id="cause"')[1].split("</section>")[0]


def test_the_headline_holds_what_acts_beside_on_readings_and_not_what_counts_show():
    lists = [["creep"], ["pressure_loss", "film_mismatch"]]
    named = {"outcome": "named", "causes": ["creep"], "sets": lists}
    both = headline_of(VerdictRecord.read(named), None).sentence
    assert "film mismatch" in both
    counts = {"p_value": 0.001, "explained_by": ["pressure_loss", "film_mismatch"]}
    of_counts = VerdictRecord.read({**named, "rupture_counts": [counts]})
    assert headline_of(of_counts, None).sentence.endswith("creep")
