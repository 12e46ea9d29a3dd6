"""What run.json says of the emulator is what the report shows."""

from bayesdeg.inference.model import Refusals
from bayesdeg.pages.page import build_page
from bayesdeg.pages.record import RunRecord
from bayesdeg.run.run_record import emulator_facts, refusal_words
from tests.pages.html_reading import read_html, table_cells
from tests.pages.synthetic_run import write_full
from tests.run.tiny_campaign import emulator

TITLE = "Errors on finite element curves"


def page_of(tmp_path, emulator_document):
    folder = write_full(tmp_path, "named")
    document = folder.read_json("run") | {"emulator": emulator_document}
    folder.write_json("run", document)
    return build_page(tmp_path).read_text(encoding="utf-8")


def test_design_version_and_accuracy_of_the_emulator_reach_the_run_record():
    facts = emulator_facts(emulator().record).document()
    shown = RunRecord.read({"title": "a run", "emulator": facts}).emulator
    assert shown.facts["design"] == "closed form"
    assert [v for k, v in shown.facts.items() if "coarse" in k] == ["6"]
    assert [v for k, v in shown.facts.items() if "fine" in k] == ["2"]
    assert [row.quantity for row in shown.accuracy] == ["curvature"]
    assert shown.accuracy[0].coverage_90 == 0.91


def test_the_page_shows_accuracy_and_refusals(tmp_path):
    facts = emulator_facts(emulator().record).document()
    said = refusal_words(Refusals(1000, 30))
    html = page_of(tmp_path, facts | {"refusals": said})
    rows = table_cells(read_html(html), TITLE)
    cells = [cell.replace("\N{NO-BREAK SPACE}", " ") for cell in rows[-1]]
    assert cells == ["curvature", "0.25", "0.50", "1.25", "91 %"]
    text = html.replace("\N{NO-BREAK SPACE}", " ")
    assert said in text


def test_a_run_of_an_older_version_has_no_accuracy_to_show(tmp_path):
    html = page_of(tmp_path, {"error_pct": 0.8, "record": "emulator-2f9a"})
    assert "emulator-2f9a" in html
    assert TITLE not in html
