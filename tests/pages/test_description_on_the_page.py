"""A misfit that no cause accounts for is described on the page: sentence, figure, tables."""

import numpy as np
import pandas as pd
import pytest

from bayesdeg.criticism.findings import DescriptionEntry
from bayesdeg.pages.page import build_page
from bayesdeg.pages.record import VerdictRecord
from tests.pages.html_reading import numbers_in, read_html, table_cells
from tests.pages.synthetic_run import write_full

SENTENCE = "The smallest term that would remove it is κ(p + b)."
DESCRIPTION = {
    "sentence": SENTENCE,
    "terms": [{"formula": "κ(p + b)", "columns": ["pressure"], "size": 4.1, "unit": "kPa"}],
    "columns": [
        {
            "column": "level",
            "share_of_misfit": 0.83,
            "kind": "curvature",
            "unit": "1/m",
            "levels": [
                {"level": "0 %", "share_of_misfit": 0.7, "excess": -0.31, "excess_pct": -2.4},
                {"level": "5 %", "share_of_misfit": 0.1, "excess": 0.04, "excess_pct": 0.2},
            ],
        }
    ],
    "p_value": 0.005,
    "tried": 465,
    "replicates": 200,
    "next_experiments": [
        {"design": "unloading", "separates": ["κ(p + b)", "κ + b"], "expected_log_bayes_factor": 3}
    ],
}
TERMS = pd.DataFrame(
    {
        "step": [1, 1],
        "status": ["taken", "fits as well"],
        "formula": ["κ(p + b)", "κ + b"],
        "columns": ["pressure", ""],
        "unit": ["kPa", "1/m"],
        "size": [4.1, 0.62],
        "q05": [3.0, np.nan],
        "q95": [5.2, np.nan],
        "behind": [0.0, 1.2],
        "share": [0.87, np.nan],
        "p_value": [0.005, np.nan],
        "elpd_diff": [9.4, np.nan],
        "elpd_diff_se": [4.0, np.nan],
    }
)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = write_full(tmp_path_factory.mktemp("described"), "unexplained")
    verdict = folder.read_verdict()
    entry = DescriptionEntry.model_validate(DESCRIPTION)
    folder.write(verdict.model_copy(update={"description": entry}))
    observations = folder.read_table("observations")
    base = observations[observations["model"] == "base"]
    readings = pd.DataFrame(
        {
            "kind": "curvature",
            "history": "loading 1 horizontal",
            "specimen_id": base["specimen_id"],
            "degradation_pct": base["degradation_pct"],
            "along": base["pressure_kPa"],
            "term": 0.01 * base["pressure_kPa"],
            "residual": base["residual_per_m"],
        }
    )
    folder.write_table("missing_terms_readings", readings)
    folder.write_table("missing_terms", TERMS)
    return read_html(build_page(folder.path).read_text(encoding="utf-8"))


def test_the_description_stands_where_the_misfit_is_shown(page):
    assert SENTENCE in page.by_id("misfit").text
    assert page.by_id("description") is not None
    figure = page.by_id("figure-missing-terms")
    assert "κ(p + b)" in figure.all("figcaption")[0].text
    assert "κ + b" not in figure.all("figcaption")[0].text  # that is not in the figure


def test_terms_and_columns_are_in_tables(page):
    taken, other = table_cells(page, "Terms that remove the misfit")
    assert (taken[0], other[0]) == ("κ(p + b)", "κ + b")
    assert numbers_in(" ".join(taken[1:3])) == [4.1, 3.0, 5.2]
    assert numbers_in(other[-1]) == [1.2]
    [row] = table_cells(page, "Where the misfit lies")
    assert (row[0], row[2]) == ("degradation rate", "0 %")
    assert numbers_in(row[1]) == [83.0]


def test_what_would_tell_terms_apart_is_told(page):
    items = [item.text for item in page.by_id("misfit").all("li")]
    assert any("unloading" in item and "κ + b" in item for item in items)


def test_a_verdict_of_an_earlier_version_has_no_description():
    assert VerdictRecord.read({"outcome": "unexplained"}).description is None
    assert "description" not in VerdictRecord.read({"outcome": "adequate"}).document()
