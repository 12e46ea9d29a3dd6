"""Counts of ruptures that contradict the model stand at the top, with a table below."""

import json

import pandas as pd
import pytest

from bayesdeg.pages.headline import headline_of
from bayesdeg.pages.page import build_page
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.pages.summaries import extended_model
from tests.pages.html_reading import read_html
from tests.pages.synthetic_run import write_full

SAID = "Counts of ruptures contradict the model: 2 of 18 actuators burst."
LEVEL = {
    "degradation_pct": 25.0,
    "pressure_kPa": 240.0,
    "tested": 3,
    "ruptured": 2,
    "probability": 1 / 3000,
    "probability_q05": 1 / 3000,
    "probability_q95": 0.2,
    "count_probability": 1 / 3000,
}
COUNTS = {
    "source": "summary.csv",
    "levels": [LEVEL],
    "p_value": 0.001,
    "draws": 3000,
    "contradicted": True,
    "explained_by": ["flaw_embrittlement", "dry_embrittlement"],
    "sentence": SAID,
}


def verdict(outcome, causes=(), *, p_value=0.4, **changes):
    return VerdictRecord.read(
        {
            "outcome": outcome,
            "causes": list(causes),
            "misfit": {"rms_per_m": 0.5, "noise_per_m": 0.5, "p_value": p_value},
            "rupture_counts": [COUNTS | changes],
        }
    )


@pytest.mark.parametrize(
    ("outcome", "causes", "words"),
    [
        ("unexplained", (), "no cause"),
        ("named", ("flaw_embrittlement",), "explained by flaw embrittlement"),
        ("ambiguous", ("flaw_embrittlement", "dry_embrittlement"), "cannot identify"),
    ],
)
def test_a_contradiction_by_counts_alone_is_the_headline(outcome, causes, words):
    found = headline_of(verdict(outcome, causes), None)
    assert "ruptures do not" in found.sentence
    assert words in found.sentence
    assert found.lede[0].startswith(SAID)


def test_beside_a_misfit_of_the_readings_it_stands_after_what_these_say():
    one = verdict("named", ("creep",), p_value=0.001)
    where = one.misfit.model_copy(update={"where": "It bends less."})
    found = headline_of(one.model_copy(update={"misfit": where}), None)
    assert "explained by creep" in found.sentence
    assert found.lede[0] == where.where
    assert found.lede[-1].startswith(SAID)


def test_counts_that_are_expected_are_not_at_the_top():
    found = headline_of(verdict("adequate", contradicted=False, explained_by=[]), None)
    assert not any(one.startswith(SAID) for one in found.lede)
    assert "ruptures" not in found.sentence


def test_readings_are_compared_with_the_model_of_the_causes_that_they_show():
    gain = pd.DataFrame({"model": ["base", "base+creep"]})
    both = verdict("named", ("creep", "flaw_embrittlement"), p_value=0.001)
    assert extended_model(gain, both) == "base+creep"
    assert extended_model(gain, verdict("named", ("flaw_embrittlement",))) is None


def test_the_page_has_a_table_in_which_nothing_is_smaller_than_the_draws_know(tmp_path):
    write_full(tmp_path, "named")
    path = tmp_path / "verdict.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(content | {"rupture_counts": [COUNTS]}), encoding="utf-8")
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    text = page.by_id("rupture").text.replace("\N{NO-BREAK SPACE}", " ")
    assert "Published counts" in text
    assert "1 in 3000 to 20 %" in text
    assert SAID in page.by_id("verdict").text.replace("\N{NO-BREAK SPACE}", " ")
