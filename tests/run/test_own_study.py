"""A study folder of one's own forward map: what is read, what is refused and where, and a run."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import bayesdeg as bd
from bayesdeg.analysis.model_kind import kind_of
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reading import read_study
from bayesdeg.cli import app
from bayesdeg.inference.model import CountedDensity, Refusals
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.headline import doubts_of, forward_map_words
from bayesdeg.pages.wording import SPACE
from bayesdeg.prediction.stored import bends_actuators
from bayesdeg.run.stages import fingerprint

FALL_TIMES = Path(__file__).parents[2] / "studies" / "fall_times"
SETTINGS = """seed = 3
[forward]
function = "model.py:length"
[parameters]
k = { law = "lognormal", median = 2.0, sigma = 1.0, unit = "mm/N", meaning = "of the spring" }
[reading]
name = "length_mm"
unit = "mm"
[sampling]
effort = "quick"
"""
MODEL = """def length(values, x):
    return values["k"][:, None] * x["force_N"]
"""
FUNCTION = ("study.toml", None, "forward.function")
CAUSE = """import bayesdeg as bd

def shifted(length, recorded, effect):
    return length + effect["length"]

CAUSE = bd.Cause(
    "offset", bd.Stage.READING,
    (bd.Parameter("length", bd.Normal(0, 0.5), "mm", "added to all", 0.0),),
    "the scale does not begin at zero", {"length": 0.3}, "a length without a force",
    on_reading=shifted,
)
"""


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "spring"
    (path / "causes").mkdir(parents=True)
    force = np.linspace(0.5, 5.0, 12)
    length = 2.3 * force + 0.4 + 0.05 * np.random.default_rng(1).standard_normal(12)
    table = pd.DataFrame({"specimen_id": list("aaabbbcccddd"), "force_N": force})
    table.assign(length_mm=length.round(4), observer="Ada").to_csv(
        path / "readings.csv", index=False
    )
    (path / "study.toml").write_text(SETTINGS)
    (path / "model.py").write_text(MODEL)
    (path / "causes" / "offset.py").write_text(CAUSE)
    return path


def faults(folder):
    with pytest.raises(bd.StudyError) as caught:
        assemble(read_study(folder))
    return caught.value.faults


def changed(folder, name, old, new):
    path = folder / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_readings_parameters_and_causes_become_a_model(folder):
    study = read_study(folder)
    found = assemble(study)
    table = study.others["readings"]
    assert study.settings.forward.inputs == ("force_N",)
    assert table["observer"].tolist() == ["Ada"] * 12
    assert found.model.table.names == ("k", "length_mm_error")
    assert [cause.name for cause in found.candidates] == ["offset"]
    np.testing.assert_array_equal(found.model.observed, table["length_mm"])
    assert found.model.groups == ("a", "b", "c", "d")
    vectors = found.model.table.vectors({"k": np.array([2.0]), "length_mm_error": np.array([0.1])})
    np.testing.assert_allclose(found.model.expected(vectors), [2.0 * table["force_N"]])
    assert set(study.hashes) == {"study.toml", "readings.csv", "model.py", "causes/offset.py"}


def test_parameters_named_as_those_of_actuators_make_it_none(folder):
    changed(folder, "study.toml", "k =", "paper_stiffness =")
    changed(folder, "model.py", '"k"', '"paper_stiffness"')
    model = assemble(read_study(folder)).model
    assert bends_actuators(model.table.names)
    assert not kind_of(model).is_averaged(model)


def test_the_same_model_is_had_from_the_folder_and_from_python(folder):
    model = assemble(read_study(folder)).model
    table = pd.read_csv(folder / "readings.csv")
    readings = bd.Readings(
        {"force_N": table["force_N"]},
        table["length_mm"],
        specimen=table["specimen_id"],
        name="length_mm",
        unit="mm",
    )

    def length(values, x):
        return values["k"][:, None] * x["force_N"]

    own = bd.Model(readings, length, parameters=[bd.Parameter("k", bd.LogNormal(2, 1), "mm/N")])
    vectors = model.table.sample(np.random.default_rng(0), 5)
    np.testing.assert_array_equal(own.density.log_prob(vectors), model.log_prob(vectors))


@pytest.mark.parametrize(
    ("file", "old", "new", "place"),
    [
        ("study.toml", "model.py:length", "model.py:lenght", FUNCTION),
        ("study.toml", "model.py:length", "modl.py:length", FUNCTION),
        ("study.toml", "model.py:length", "length", ("study.toml", 3, "forward.function")),
        ("study.toml", "length_mm", "lenght_mm", ("readings.csv", 1, "lenght_mm")),
        ("study.toml", '"model.py:length"', '"model.py:length"\ninputs = ["force_kN"]',
         ("readings.csv", 1, "force_kN")),
        ("study.toml", "lognormal", "lognorml", ("study.toml", 5, "parameters.k")),
        ("study.toml", "[sampling]", '[priors]\nkk = { law = "half_normal", sd = 1 }\n[sampling]',
         ("study.toml", None, "priors.kk")),
        ("study.toml", "[sampling]", '[causes]\ncandidates = ["ofset"]\n[sampling]',
         ("study.toml", None, "causes.candidates")),
        ("study.toml", "[forward]\nfunction", "[forwrd]\nfunction", ("study.toml", 2, "forwrd")),
        ("readings.csv", "a,0.5", "a,half", ("readings.csv", 2, "force_N")),
        ("model.py", "return", "retrun", ("model.py", 2, None)),
        ("model.py", "def length", "import nothing_like_it\ndef length", ("model.py", 1, None)),
        ("model.py", 'values["k"]', 'values["stiffness"]', ("model.py", 2, None)),
        ("model.py", 'x["force_N"]', 'x["force"]', ("model.py", 2, None)),
        ("model.py", '* x["force_N"]', "* [1.0]", ("model.py", None, None)),
        ("model.py", 'values["k"][:, None] *', "", ("model.py", None, None)),
        ("model.py", '* x["force_N"]', '* (x["force_N"] - 0.5) ** -1.0 * float("nan")',
         ("model.py", None, None)),
        ("model.py", "return", "raise OSError('no answer')\n    return", ("model.py", 2, None)),
        ("causes/offset.py", "import bayesdeg", "import bayesdog", ("causes/offset.py", 1, None)),
        ("causes/offset.py", "CAUSE =", "OTHER =", ("causes/offset.py", None, None)),
        ("causes/offset.py", 'effect["length"]', 'effect["size"]', ("causes/offset.py", 4, None)),
        ("causes/offset.py", "return length +", "return len(length) * length[:, :3] +",
         ("causes, offset", None, None)),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(folder, file, old, new, place):
    changed(folder, file, old, new)
    told = faults(folder)
    assert place in [(fault.file, fault.row, fault.column) for fault in told]
    assert all(fault.problem and fault.remedy for fault in told)


def test_a_function_for_single_numbers_is_to_be_written_for_arrays(folder):
    changed(folder, "model.py", "def", "import math\ndef")
    changed(folder, "model.py", 'values["k"][:, None]', 'math.exp(values["k"])')
    (fault,) = faults(folder)
    assert (fault.file, fault.row) == ("model.py", 3)
    assert "for arrays" in fault.remedy
    readings = bd.Readings({"x": np.arange(1.0, 4.0)}, np.arange(3.0), name="y", unit="mm")
    with pytest.raises(bd.BayesdegError, match="for arrays"):
        bd.Model(
            readings,
            lambda values, x: math.exp(values["k"]) * x["x"],
            parameters=[bd.Parameter("k", bd.LogNormal(2, 1), "mm")],
        )


def test_wrong_shapes_name_the_shape_that_is_wanted(folder):
    changed(folder, "model.py", '[:, None] * x["force_N"]', "")
    (fault,) = faults(folder)
    assert "(32, 12)" in fault.problem
    assert "(32,)" in fault.problem


def test_data_of_actuators_and_readings_without_a_function_are_refused(folder):
    (folder / "break.csv").write_text("specimen_id,degradation_pct,elongation_pct\na,0,200\n")
    assert [fault.file for fault in faults(folder)] == ["break.csv"]
    (folder / "study.toml").write_text("")
    assert [fault.file for fault in faults(folder)] == ["readings.csv"]


def test_a_virtual_experiment_of_it_is_refused(folder, tmp_path):
    result = CliRunner().invoke(app, ["simulate", str(folder), "--out", str(tmp_path / "virtual")])
    assert result.exit_code != 0
    assert not (tmp_path / "virtual").exists()


def test_nothing_is_written_into_the_study(folder):
    before = sorted(path.name for path in folder.rglob("*"))
    assemble(read_study(folder))
    assert sorted(path.name for path in folder.rglob("*")) == before


def test_a_run_is_resumed_only_with_the_same_code(folder):
    study = read_study(folder)
    first = fingerprint(study)
    changed(folder, "model.py", "values", "draws")
    assert fingerprint(read_study(folder)) != first
    hashes = {name: value for name, value in study.hashes.items() if name != "model.py"}
    assert fingerprint(replace(study, hashes=hashes)) != first


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The published example, run by its command."""
    place = tmp_path_factory.mktemp("own")
    shutil.copytree(FALL_TIMES, place / "fall_times")
    arguments = ["run", str(place / "fall_times"), "--out", str(place / "run"), "--quiet", "--json"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    return place / "run", json.loads(result.stdout)


def test_the_example_names_drag_and_reports_it(finished):
    path, verdict = finished
    folder = RunFolder(path)
    assert (verdict["outcome"], verdict["causes"]) == ("named", ["drag"])
    assert verdict["misfit"]["unit"] == "s"
    assert "left_out" not in verdict or not verdict["left_out"]
    fitted = folder.read_table("fitted")
    assert len(fitted) == 2 * 63
    assert set(fitted["model"]) == {"base", "final"}
    assert "elpd_diff" in folder.read_table("gain")
    assert (
        folder.read_posterior("posterior")["posterior"].to_dataset()["drag.coefficient"].ndim == 2
    )
    page = (path / "index.html").read_text(encoding="utf-8")
    assert 'id="figure-readings"' in page
    assert "Yeoh" not in page


def answer(*arguments):
    result = CliRunner().invoke(app, [*map(str, arguments), "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)["rows"]


def test_its_run_folder_predicts_and_finds_a_height(finished):
    rows = answer("predict", finished[0], "--x", "height_m=1,4")
    assert [row["height_m"] for row in rows] == [1.0, 4.0]
    free = np.sqrt(2.0 * np.array([1.0, 4.0]) / 9.81)
    assert all(row["q05"] > time for row, time in zip(rows, free, strict=True))
    (found,) = answer(
        "control", finished[0], "--reading", rows[1]["q50"], "--x", "height_m=0.5:6:0.1"
    )
    assert found["reached"]
    assert found["needed_q50"] == pytest.approx(4.0, abs=0.03)


@pytest.mark.parametrize(
    "arguments",
    [
        ["predict"],
        ["predict", "--x", "heigth=1"],
        ["predict", "--x", "height_m=much"],
        ["predict", "--pressure", "3", "--degradation", "0"],
        ["predict", "--x", "height_m=1", "--cause", "drag"],
        ["control", "--reading", "0.5"],
        ["control", "--reading", "0.5", "--x", "height_m=0.5:6:0.1", "--cause", "drag"],
        ["control", "--x", "height_m=1:3:1"],
        ["control", "--curvature", "3", "--degradation", "0"],
    ],
)
def test_what_has_no_meaning_is_refused(finished, arguments):
    result = CliRunner().invoke(app, [arguments[0], str(finished[0]), *arguments[1:]])
    assert result.exit_code == 2


def test_a_function_that_changed_since_the_run_predicts_nothing(finished):
    model = finished[0].parent / "fall_times" / "model.py"
    text = model.read_text()
    try:
        model.write_text(text.replace("9.81", "9.80"))
        result = CliRunner().invoke(app, ["predict", str(finished[0]), "--x", "height_m=1"])
    finally:
        model.write_text(text)
    assert result.exit_code == 2 or isinstance(result.exception, bd.BayesdegError)
    assert "model.py" in result.output + str(result.exception)


NOWHERE = 'np.where(values["k"][:, None] > 2.0, np.nan, values["k"][:, None] * x["force_N"])'
NOISY = 'values["k"][:, None] * x["force_N"] + np.random.normal(0, 0.05, (len(values["k"]), 12))'


def written_as(folder, returned):
    changed(folder, "model.py", 'values["k"][:, None] * x["force_N"]', returned)
    changed(folder, "model.py", "def ", "import numpy as np\ndef ")
    return assemble(read_study(folder))


def test_prior_draws_without_an_answer_are_counted(folder):
    assert assemble(read_study(folder)).answers.prior_unanswered == 0.0
    answers = written_as(folder, NOWHERE).answers
    assert answers.prior_unanswered == pytest.approx(0.5, abs=0.1)  # the median of k is 2
    assert not answers.noise
    [said] = forward_map_words(answers)
    assert f"{answers.prior_unanswered:.0%}".replace("%", f"{SPACE}%") in said


def test_proposals_without_an_answer_are_counted(folder):
    model = written_as(folder, NOWHERE).model
    density = CountedDensity(model)
    k = np.array([1.0, 1.9, 2.1, 3.0, 4.0])
    density(model.table.vectors({"k": k, "length_mm_error": np.full(5, 0.1)}))
    assert density.refusals == Refusals(5, 3)
    fewer = CountedDensity(model.without(np.array([0])))
    fewer(model.table.vectors({"k": k, "length_mm_error": np.full(5, 0.1)}))
    assert fewer.refusals == Refusals(5, 3)


def test_noise_of_the_map_itself_is_noticed(folder):
    [noise] = written_as(folder, NOISY).answers.noise
    assert (noise.kind, noise.unit) == ("length_mm", "mm")
    assert noise.sd == pytest.approx(0.05, rel=0.2)


@pytest.mark.slow
def test_a_run_says_where_its_map_has_no_answer(folder):
    shutil.rmtree(folder / "causes")
    written_as(folder, NOWHERE.replace("2.0", "2.4"))
    out = folder.parent / "run"
    result = CliRunner().invoke(app, ["run", str(folder), "--out", str(out)])
    assert result.exit_code == 0, result.output
    run, verdict = RunFolder(out).read_run(), RunFolder(out).read_verdict()
    assert run.forward_map == verdict.forward_map
    assert 0.0 < verdict.forward_map.proposals_unanswered < 0.5
    assert sum(n for name, n in run.counts.items() if "refused" in name) > 0
    [said] = doubts_of(verdict)
    [at_once] = forward_map_words(assemble(read_study(folder)).answers)
    console, page = result.stderr.split(), (out / "index.html").read_text(encoding="utf-8")
    for one in (at_once, said):
        assert f"in doubt: {' '.join(one.split())}" in " ".join(console)
    assert said.split(SPACE)[0] in page
