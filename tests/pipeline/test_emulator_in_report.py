"""What run.json says of the emulator is what the report shows."""

import json

from bayesdeg.inference.model import Refusals
from bayesdeg.pipeline.record import emulator_facts, refusal_words
from bayesdeg.report.page import build_page
from bayesdeg.report.record import run_of
from tests.pipeline.tiny_campaign import emulator
from tests.report.html_reading import read_html, table_cells
from tests.report.synthetic_run import write_full


def page_of(tmp_path, emulator_document):
    folder = write_full(tmp_path, "named")
    document = folder.read_json("run") | {"emulator": emulator_document}
    folder.write_json("run", document)
    return build_page(tmp_path).read_text(encoding="utf-8")


def test_design_version_and_accuracy_of_the_emulator_reach_the_run_record():
    facts = json.loads(json.dumps(emulator_facts(emulator().record)))
    shown = run_of({"title": "a run", "emulator": facts}).emulator
    assert shown.facts["design"] == "closed form"
    assert shown.facts["curves of the coarse mesh"] == "6"
    assert shown.facts["curves of the fine mesh"] == "2"
    assert [row.quantity for row in shown.accuracy] == ["curvature"]
    assert shown.accuracy[0].coverage_90 == 0.91


def test_the_page_shows_accuracy_and_refusals(tmp_path):
    facts = emulator_facts(emulator().record)
    said = refusal_words(Refusals(1000, 30))
    html = page_of(tmp_path, facts | {"refusals": said})
    rows = table_cells(read_html(html), "Errors on finite element curves")
    cells = [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in rows[-1]]
    assert cells == ["curvature", "0.25", "0.50", "1.25", "91 %"]
    text = html.replace("\N{NO-BREAK SPACE}", " ")
    assert "refused 30 of 1000 proposals of the sampler (3 %)" in text
    assert "narrower priors in study.toml" in text


def test_a_run_of_an_older_version_has_no_accuracy_to_show(tmp_path):
    html = page_of(tmp_path, {"error_pct": 0.8, "record": "emulator-2f9a"})
    assert "emulator-2f9a" in html
    assert "Errors on finite element curves" not in html
