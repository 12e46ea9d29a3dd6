import math
import re
from dataclasses import replace

import pandas as pd
import pytest

from bayesdeg.errors import BayesdegError
from bayesdeg.pages.drawing import Shown
from bayesdeg.pages.headline import headline_of
from bayesdeg.pages.left_out import Guard
from bayesdeg.pages.page import FIGURES as DRAWN
from bayesdeg.pages.page import build_page, render
from bayesdeg.pages.record import UpdateEntry
from bayesdeg.pages.summaries import by_level, several_levels
from bayesdeg.pages.tables import TABLES, Tables
from tests.marks import long_unless
from tests.pages.html_reading import numbers_in, read_html, table_cells
from tests.pages.synthetic_run import write_bare, write_full

MARK = "Before the update."
OUTCOMES = {
    "adequate": ("Adequate", "No misfit beyond the noise"),
    "named": (
        "Cause named",
        "The misfit is explained by degraded skin: skin stiffening 0.800 [0.630, 0.970]",
    ),
    "ambiguous": ("Ambiguous", "cannot identify its cause: erosion or degradation misread"),
    "unexplained": ("Unexplained", "no cause in the catalogue accounts for it"),
    "not_judged": ("Not judged", "The simulation could not be judged on this data"),
}
FULL = list(OUTCOMES)
FIGURES = [
    "bands",
    "residuals",
    "null",
    "gain",
    "rupture",
    "elongation",
    "constants",
    "prior-sensitivity",
    "prior-curvature",
    "prior-stress",
    "leave-one-out",
    "tensile",
]
SECTIONS = [
    "verdict",
    "curvature",
    "next",
    "misfit",
    "cause",
    "gain",
    "rupture",
    "posterior",
    "tensile",
    "data",
    "methods",
    "provenance",
]


def close(text: str, value: float, *, within: float) -> bool:
    return any(abs(found - value) <= within for found in numbers_in(text))


@pytest.mark.parametrize("outcome", [*FULL, "bare"])
def test_the_page_is_whole_and_needs_nothing_outside_itself(built, outcome):
    folder, html = built(outcome)
    page = read_html(html)
    assert html.startswith("<!DOCTYPE html>")
    for element in page.every():
        for name in ("src", "href", "xlink:href", "srcset", "action", "data"):
            target = element.attributes.get(name, "#")
            plain_doi = element.tag == "a" and target.startswith("https://doi.org/")
            beside = element.tag == "a" and (folder.path / target).is_file()
            assert plain_doi or beside or target.startswith(("#", "data:")), (element.tag, target)
    assert not re.search(r"@import|url\((?!#)", html)
    ids = [e.attributes["id"] for e in page.every() if "id" in e.attributes]
    assert len(ids) == len(set(ids))
    for link in page.all("a"):
        target = link.attributes["href"]
        assert not target.startswith("#") or target[1:] in ids


@pytest.mark.parametrize("outcome", FULL)
def test_every_figure_and_table_has_its_number_and_the_file_it_is_made_from(built, outcome):
    folder, html = built(outcome)
    page = read_html(html)
    figures = [figure.all("figcaption")[0] for figure in page.all("figure")]
    tables = [table.all("caption")[0] for table in page.all("table")]
    for kind, captions in (("Figure", figures), ("Table", tables)):
        numbers = [caption.all("b")[0].text for caption in captions]
        assert numbers == [f"{kind} {i + 1}." for i in range(len(captions))]
        for caption in captions:
            linked = [link.attributes["href"] for link in caption.all("a")]
            assert linked, caption.text
            assert all((folder.path / name).is_file() for name in linked)


@pytest.mark.parametrize("outcome", FULL)
def test_the_verdict_leads_in_plain_words(built, outcome):
    _, html = built(outcome)
    page = read_html(html)
    badge, sentence = OUTCOMES[outcome]
    main = page.all("main")[0]
    sections = main.all("section")
    assert [section.attributes["id"] for section in sections] == SECTIONS
    assert [heading.text for heading in page.all("h1")] == [sections[0].all("h1")[0].text]
    assert sentence in page.all("h1")[0].text
    first = sections[0].all("span")[0]
    name = "unjudged" if outcome == "not_judged" else outcome
    assert (first.attributes["class"], first.text) == (f"badge {name}", badge)
    assert sentence in page.all("title")[0].text


def test_the_key_numbers_are_those_of_the_files(built):
    folder, html = built("named")
    verdict, gain = folder.read_verdict(), folder.read_table("gain")
    keys = read_html(html).by_id("verdict").all("dl")[0].all("dd")
    misfit, sure, gained = (key.text for key in keys)
    assert gained.count("→") == 1
    assert "elpd" not in gained  # one gain in log density, beside the cause
    assert close(misfit, verdict.misfit.rms_per_m, within=0.005)
    assert close(misfit, verdict.misfit.noise_per_m, within=0.005)
    assert "p < 0.001" in misfit
    assert close(sure, 100 * verdict.candidates[0].probability, within=0.5)
    assert close(sure, 100 * verdict.false_name_rate, within=0.05)
    rows = gain[gain["degradation_pct"] == "all"].set_index("model")
    assert close(gained, rows.loc["base", "rmse_per_m"], within=0.005)
    assert close(gained, rows.loc["base+degraded_skin", "rmse_per_m"], within=0.005)


def test_only_a_named_cause_is_said_to_have_gained_something(built):
    for outcome in ("adequate", "ambiguous", "unexplained"):
        assert "→" not in read_html(built(outcome)[1]).by_id("verdict").text


@pytest.mark.parametrize("outcome", FULL)
def test_only_an_ambiguous_page_says_with_which_cause_it_predicts(built, outcome):
    page = read_html(built(outcome)[1])
    said = "Predicted with erosion, one of several causes that cannot be told apart: erosion or"
    for section in ("curvature", "rupture"):
        assert (said in page.by_id(section).text) is (outcome == "ambiguous")
    assert ("may predict differently" in page.text) is (outcome == "ambiguous")


@pytest.mark.parametrize("outcome", ["named", "ambiguous"])
def test_a_cause_found_by_the_directed_test_alone_is_not_said_to_explain_a_misfit(built, outcome):
    verdict = built(outcome)[0].read_verdict()
    weak = verdict.model_copy(
        update={"misfit": verdict.misfit.model_copy(update={"p_value": 0.63})}
    )
    strong, headline = headline_of(verdict, None), headline_of(weak, None)
    assert headline.sentence != strong.sentence
    note = headline.numbers[0].note.replace("\N{NO-BREAK SPACE}", " ")
    assert "p = 0.63" in note
    assert note.count("p = ") == 2
    assert strong.numbers[0].note.count("p\N{NO-BREAK SPACE}") == 1


def test_the_candidates_are_those_of_the_verdict(built):
    folder, html = built("named")
    verdict, page = folder.read_verdict(), read_html(html)
    rows = table_cells(page, "Causes tried") + table_cells(page, "Less likely")
    judged = [entry for entry in verdict.candidates if entry.probability is not None]
    assert len(rows) == len(judged)
    for cells, entry in zip(rows, judged, strict=True):
        assert cells[0].startswith(entry.cause.replace("_", " "))
        assert close(cells[1], max(100 * entry.probability, 0.1), within=0.5)
        assert close(cells[2], entry.log_bayes_factor, within=0.05)
        chance = entry.naming_p_value
        assert cells[3] == "–" if chance is None else close(cells[3], chance, within=0.0005)
        assert close(cells[4], entry.elpd_diff, within=0.05)
        assert close(cells[4], entry.elpd_diff_se, within=0.05)
        assert close(cells[5], 100 * entry.explained_fraction, within=0.5)
        for effect in entry.effect.values():
            for value in (effect.mean, effect.q05, effect.q95):
                assert close(cells[6], value, within=0.006 * abs(value))
            assert effect.unit == "–" or effect.unit in cells[6]
    unjudged = table_cells(page, "Causes that these data say nothing about")
    silent = [entry for entry in verdict.candidates if entry.why]
    assert [row[1] for row in unjudged] == [entry.why for entry in silent]
    assert [row[0] for row in unjudged] == ["Mullins", "humidity drift"]


def test_the_tables_are_those_of_the_files(built):
    folder, html = built("named")
    page = read_html(html)
    gain = folder.read_table("gain")
    pooled = gain[gain["degradation_pct"] == "all"]
    for cells, (_, row) in zip(
        table_cells(page, "Prediction of held-out specimens, all"), pooled.iterrows(), strict=True
    ):
        assert close(cells[1], row["rmse_per_m"], within=0.005)
        assert close(cells[3], row["r_squared"], within=0.0005)
        assert close(cells[5], 100 * row["coverage_90"], within=0.5)
        assert row["model"] == "base" or close(cells[6], row["elpd_diff"], within=0.05)
    levels = folder.read_table("levels")
    base = levels[levels["model"] == "base"].set_index("degradation_pct")
    for cells in table_cells(page, "Fit by degradation rate")[:-1]:
        row = base.loc[f"{numbers_in(cells[0])[0]:.1f}"]
        assert close(cells[2], row["r_squared"], within=0.0005)
        assert close(cells[4], row["published_r_squared"], within=0.0005)
        assert close(cells[5], row["rms_per_m"], within=0.005)
    parameters = folder.read_table("parameters")
    for cells, (_, row) in zip(
        table_cells(page, "90 % intervals"), parameters.iterrows(), strict=True
    ):
        assert cells[0].startswith(row["parameter"])
        for value in (row["q05"], row["q50"], row["q95"]):
            assert close(cells[4], value, within=0.006 * abs(value))


@pytest.mark.parametrize("outcome", FULL)
def test_every_figure_can_be_read_without_seeing_it(built, outcome):
    page = read_html(built(outcome)[1])
    figures = page.all("figure")
    with_gain = outcome in ("named", "ambiguous")
    expected = [name for name in FIGURES if with_gain or name != "gain"]
    assert [f.attributes["id"] for f in figures] == [f"figure-{name}" for name in expected]
    for figure in figures:
        (svg,) = figure.all("svg")
        assert svg.attributes["role"] == "img"
        assert len(svg.attributes["aria-label"]) > 30
        assert figure.all("figcaption")[0].text


@pytest.mark.parametrize("outcome", FULL)
def test_every_table_has_a_caption_and_headers(built, outcome):
    for table in read_html(built(outcome)[1]).all("table"):
        assert table.all("caption")[0].text
        heads = table.all("thead")[0].all("th")
        assert all(head.attributes["scope"] == "col" and head.text for head in heads)
        for row in table.all("tbody")[0].all("tr"):
            assert row.all("th")[0].attributes["scope"] == "row"
            assert len(row.all("th") + row.all("td")) == len(heads)


def test_a_virtual_experiment_is_marked_on_the_page_and_on_every_figure(built):
    page = read_html(built("ambiguous", virtual=True)[1])
    banner = next(e for e in page.every() if e.attributes.get("class") == "banner")
    assert banner.text.lower().startswith("virtual experiment")
    assert "a stiff skin" in banner.text
    figures = page.all("figure")
    assert len(figures) == len(FIGURES)
    for figure in figures:
        written = [text.text for text in figure.all("text")]
        assert "virtual experiment" in written
        assert ". Virtual experiment. " in figure.all("figcaption")[0].text[:40]


def test_a_real_experiment_is_not_marked_as_virtual(built):
    assert "virtual experiment" not in read_html(built("ambiguous")[1]).all("body")[0].text.lower()


def test_the_note_of_a_real_study_is_on_the_page(tmp_path):
    folder = write_full(tmp_path, "ambiguous")
    folder.write_json("run", folder.read_json("run") | {"note": "Read by hand at 24 °C."})
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    (note,) = [e for e in page.every() if e.attributes.get("aria-label") == "Note"]
    assert note.text.split()[0] == "Note"
    assert "Read by hand" in note.text


@pytest.mark.parametrize(
    ("parameters", "said"), [(("paper_stiffness",), True), (("c1_at_0",), False)]
)
def test_a_layer_is_spoken_of_where_there_is_one(tmp_path, parameters, said):
    folder = write_full(tmp_path, "ambiguous")
    folder.write_json("run", folder.read_json("run") | {"model": {"parameters": parameters}})
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    assert ("stiff layer" in page.by_id("methods").text) == said


def test_an_optional_check_that_could_not_be_made_is_said_where_it_would_be(built):
    """It is no fault of the run: nothing of it stands at the top."""
    page = read_html(built("named")[1])
    assert "predictive draws" in page.by_id("gain").text
    assert "predictive draws" not in page.by_id("verdict").text


def test_a_study_without_actuator_data_is_not_called_adequate(built):
    page = read_html(built("bare")[1])
    assert page.by_id("verdict").all("span")[0].text == "Not judged"
    assert "adequate" not in page.all("main")[0].text.lower()
    for section in ("misfit", "curvature", "tensile"):
        assert absent(page.by_id(section))
    assert page.all("figure") == []


def absent(section):
    """Return how often a section says that something is not there."""
    return sum("absent" in e.attributes.get("class", "") for e in section.every())


# the section that says that a table is not there
MISSING = {
    "observations": "misfit",
    "levels": "misfit",
    "gain": "gain",
    "bands": "curvature",
    "rupture": "rupture",
    "elongation": "rupture",
    "constants": "posterior",
    "parameters": "posterior",
    "tensile": "tensile",
}


def page_of(folder, names):
    """Return the page of a run that has no other tables."""
    frames = folder.read_tables().frames
    kept = Tables({name: frame for name, frame in frames.items() if name in names})
    return read_html(render(Shown(folder.read_verdict(), folder.read_run(), kept)))


def test_what_is_missing_is_said_in_its_place(built):
    folder, _ = built("named")
    page = page_of(folder, ())
    for section in MISSING.values():
        assert absent(page.by_id(section))


@pytest.mark.parametrize(
    "name",
    [long_unless(n in ("bands", "gain"), n) for n in MISSING],
)
def test_one_missing_table_takes_nothing_else_away(built, name):
    folder, _ = built("named")
    slim = {"tensile", "constants", "bands", "observations"}
    page = page_of(folder, set(TABLES) - ({name} if name in slim else {name} | slim))
    every = page_of(folder, set(TABLES) - (set() if name in slim else slim))
    before, after = (absent(one.by_id(MISSING[name])) for one in (every, page))
    assert after == before + 1
    assert page.by_id("verdict").text


def test_how_wrong_a_held_out_mode_is_stands_above_the_figure(built):
    section = read_html(built("named")[1]).by_id("tensile")
    callout = next(e for e in section.every() if e.attributes.get("class") == "callout")
    assert callout.text.count("Equibiaxial") == 1
    assert callout.text.count("rms with the") == 2  # of the base model and of the final one
    assert "Uniaxial" not in callout.text


def test_measured_against_predicted_comes_first_also_of_films_alone(built):
    folder, _ = built("named")
    page = page_of(folder, {"tensile"})
    (figure,) = page.all("figure")
    assert figure.attributes["id"] == "figure-tensile"
    assert figure in page.by_id("curvature").all("figure")


def test_caveats_and_provenance_are_stated(built):
    folder, html = built("named")
    page = read_html(html)
    methods, provenance = page.by_id("methods").text, page.by_id("provenance").text
    assert "mass loss" in methods
    assert "volume ratio" in methods
    for words in ("20211124", "numpy", "2.5.5", "9f2c" * 16, "8 min 32 s", "outside training"):
        assert words in provenance
    assert 1204311.0 in numbers_in(provenance)
    assert folder.read_run().missing[0].cost in page.by_id("data").text


def test_texts_of_the_study_cannot_inject_markup(tmp_path):
    folder = write_bare(tmp_path)
    folder.write_json("run", {"title": "<script>alert(1)</script> & Co", "virtual": False})
    html = build_page(tmp_path).read_text(encoding="utf-8")
    page = read_html(html)
    assert len(page.all("script")) == 1
    assert "<script>alert(1)</script> & Co" in page.all("title")[0].text


def test_a_folder_without_a_verdict_is_refused(tmp_path):
    with pytest.raises(BayesdegError, match=r"verdict\.json is missing"):
        build_page(tmp_path)


def test_a_posterior_that_may_not_be_used_is_said_beside_the_verdict(tmp_path):
    folder = write_bare(tmp_path)
    found = {"usable": False, "sentence": "The ensembles disagree; sample longer."}
    folder.write_json("run", {"title": "t", "convergence": {"base": found}})
    verdict = read_html(build_page(tmp_path).read_text(encoding="utf-8")).by_id("verdict").text
    assert found["sentence"] in verdict
    assert "base model" in verdict


DOUBT = "actuator.csv, specimen 'A10-2', column pressure_kPa: is 10.1 times <that> of the others"
QUESTION = {
    "parameter": "volume_ratio",
    "meaning": "volume of the part over that of its mould",
    "unit": "–",
    "median": 0.976,
    "prior_low": 0.39,
    "prior_high": 0.85,
}


@pytest.mark.parametrize(
    ("outcome", "found", "in_title", "said"),
    [
        ("adequate", {"suspects": [{"why": DOUBT}]}, True, DOUBT),
        ("named", {"suspects": [{"why": DOUBT}]}, False, DOUBT),
        (
            "unexplained",
            {"parameters_in_question": [QUESTION], "misfit": {"p_value": 0.4}},
            True,
            "0.976",
        ),
    ],
)
def test_what_is_in_doubt_stands_at_the_top(built, tmp_path, outcome, found, in_title, said):
    folder = write_full(tmp_path / "run", outcome)
    verdict = folder.read_json("verdict")
    found = found | {"misfit": verdict["misfit"] | found.get("misfit", {})}
    folder.write_json("verdict", verdict | found)
    page = read_html(build_page(folder.path).read_text(encoding="utf-8")).by_id("verdict")
    usual = read_html(built(outcome)[1]).all("h1")[0].text
    assert (page.all("h1")[0].text != usual) is in_title
    assert said in page.by_id("doubts").text


def test_where_nothing_is_in_doubt_nothing_is_said_of_it(built):
    assert 'id="doubts"' not in built("adequate")[1]


def test_a_gain_without_curvature_is_given_in_elpd(built):
    folder, _ = built("named")
    gain = folder.read_table("gain").assign(rmse_per_m=math.nan)
    shown = headline_of(folder.read_verdict(), gain).numbers[2]
    assert close(shown.value, 39.5, within=0.05)
    assert close(shown.value, 6.1, within=0.05)
    assert "1/m" not in shown.value


def test_what_would_have_been_decided_is_shown_as_each_model_has_it(tmp_path):
    folder = write_full(tmp_path, "named")
    rows = [
        ("base", 10.0, 4.1, 81.0, 86.0, 92.0, 75.0, 0.31, 42),
        ("base+degraded_skin", 10.0, 4.1, 70.0, 73.5, 78.0, 76.0, math.nan, 60),
    ]
    names = TABLES["decisions"].headings
    folder.write_table("decisions", pd.DataFrame(rows, columns=names))
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    shown = table_cells(page, "Pressure for half of the largest curvature")
    (before, after), (cells,) = rows, shown
    assert [numbers_in(cell) for cell in cells[:5]] == [
        [before[1]],
        [before[2]],
        [before[4], before[3], before[5]],
        [after[4], after[3], after[5]],
        [after[4] - before[4]],
    ]
    assert numbers_in(cells[5]) == [31.0]
    assert numbers_in(cells[6]) == []


def test_the_least_probability_of_rupture_is_that_of_each_model(tmp_path):
    """One in 42 is the floor of a model that knows of 42 specimens, whatever another knows of."""
    folder = write_full(tmp_path, "named")
    rows = [
        ("base", 10.0, 4.1, 81.0, 86.0, 92.0, 75.0, 1.0 / 42.0, 42),
        ("base+degraded_skin", 10.0, 4.1, 70.0, 73.5, 78.0, 76.0, 1.0 / 60.0, 60),
    ]
    columns = TABLES["decisions"].headings
    folder.write_table("decisions", pd.DataFrame(rows, columns=columns))
    content = folder.read_json("run") | {"model": {"rupture_checks": 60}}
    folder.write_json("run", content)
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    (cells,) = table_cells(page, "Pressure for half of the largest curvature")
    assert [" ".join(cell.split()) for cell in cells[5:7]] == [
        "less than 1 in 42",
        "less than 1 in 60",
    ]


def test_held_out_modes_of_tension_are_shown_one_by_one(tmp_path):
    folder = write_full(tmp_path, "named")
    rows = [
        (model, mode, 30.0, gain, error, error, 0.9, 0.5, 0.9)
        for model, gain, error in (("base", 0.0, 0.201), ("base+degraded_skin", 3.6, 0.05))
        for mode in ("uniaxial", "equibiaxial")
    ]
    names = TABLES["gain_modes"].headings
    folder.write_table("gain_modes", pd.DataFrame(rows, columns=names))
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    shown = table_cells(page, "Prediction of each mode of tension from the others")
    assert [row[0] for row in shown] == ["equibiaxial", "equibiaxial", "uniaxial", "uniaxial"]
    assert [numbers_in(row[3]) for row in shown] == [[0.201], [0.05]] * 2


def test_of_causes_that_could_not_be_judged_no_probability_is_told(built):
    folder, _ = built("ambiguous")
    verdict = folder.read_verdict()
    unknown = tuple(c.model_copy(update={"probability": None}) for c in verdict.candidates)
    sure = headline_of(verdict.model_copy(update={"candidates": unknown}), None).numbers[1]
    assert "nothing" in sure.note
    assert sure.value.startswith("p")


def test_scores_by_degradation_rate_are_shown_where_there_are_several(tmp_path):
    folder = write_full(tmp_path, "named")
    gain = folder.read_table("gain")
    assert len(several_levels(gain)) == len(by_level(gain))
    rate = gain["degradation_pct"].iloc[1]
    assert several_levels(gain[gain["degradation_pct"].isin([rate, "all"])]) is None
    assert several_levels(None) is None


# ---- what was left out


LEFT_OUT = [{"stage": "bands.csv", "why": "It could not be computed (ValueError: <odd>)."}]


@pytest.fixture
def incomplete(tmp_path):
    folder = write_full(tmp_path / "run", "named")
    (tmp_path / "run" / "bands.csv").unlink()
    folder.write_json("verdict", folder.read_json("verdict") | {"left_out": LEFT_OUT})
    return folder


def test_what_was_left_out_stands_at_the_top_and_in_its_place(incomplete):
    page = read_html(build_page(incomplete.path).read_text(encoding="utf-8"))
    box = page.by_id("verdict").by_id("left-out")
    assert f"bands.csv: {LEFT_OUT[0]['why']}" in box.text
    assert "left out" in page.by_id("curvature").text


def test_a_figure_that_fails_is_left_out_of_the_page_alone(incomplete, monkeypatch):
    def broken(*_):
        raise RuntimeError("no ink")

    figure = DRAWN["residuals"]
    monkeypatch.setitem(DRAWN, "residuals", replace(figure, draw=broken))
    with pytest.raises(RuntimeError, match="no ink"):
        build_page(incomplete.path)
    guard = Guard(strict=False)
    page = read_html(build_page(incomplete.path, guard).read_text(encoding="utf-8"))
    assert guard.stages == ("figure residuals",)
    [left_out] = guard.left_out
    assert f"figure residuals: {left_out.why}" in page.by_id("left-out").text
    assert "(RuntimeError: no ink)" in left_out.why
    assert page.by_id("figure-tensile")


def test_figures_that_failed_before_and_are_drawn_now_are_not_left_out(incomplete):
    entry = {"stage": "figure residuals", "why": "It could not be computed."}
    verdict = incomplete.read_json("verdict")
    incomplete.write_json("verdict", verdict | {"left_out": [entry]})
    html = build_page(incomplete.path).read_text(encoding="utf-8")
    assert 'id="left-out"' not in html


def test_a_verdict_that_was_left_out_is_not_called_adequate(incomplete):
    verdict = incomplete.read_json("verdict") | {"outcome": "not_judged", "causes": []}
    verdict["left_out"] = [{"stage": "verdict", "why": "It broke."}]
    verdict["next_experiments"] = []
    incomplete.write_json("verdict", verdict)
    page = read_html(build_page(incomplete.path).read_text(encoding="utf-8"))
    assert page.by_id("verdict").all("span")[0].text == "Not judged"
    assert "adequate" not in page.by_id("verdict").text.lower()


def test_the_tests_themselves_are_strict():
    with pytest.raises(ValueError, match="seven"):
        Guard().attempt("bands.csv", float, "seven")


def test_what_is_of_the_run_before_an_update_is_marked(tmp_path):
    """But for what readings of actuators do not change, such as the course of films."""
    folder = write_full(tmp_path, "named")
    kept = ("verdict.json", "leave_one_out.csv", "gain.csv", "measured.csv")
    update = UpdateEntry(run="before", times=1, specimens=("n1",), readings=3, as_before=kept)
    plain = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    folder.write(folder.read_run().model_copy(update={"update": update}))
    page = read_html(build_page(tmp_path).read_text(encoding="utf-8"))
    captions = [one.text for tag in ("caption", "figcaption") for one in page.all(tag)]
    for files, marked in (
        (("verdict.json", "leave_one_out.csv", "gain.csv"), True),
        (("measured.csv", "bands.csv", "decisions.csv", "parameters.csv"), False),
    ):
        found = [text for text in captions if any(file in text for file in files)]
        assert found
        assert all((MARK in text) == marked for text in found)
    assert MARK in page.by_id("next").text
    assert MARK not in plain.text
