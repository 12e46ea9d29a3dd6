"""A study of which nothing degrades has no parameter, cause or word of degradation."""

import json
import re
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import replace
from functools import partial
from io import StringIO

import numpy as np
import pytest

from bayesdeg import cli
from bayesdeg.analysis import model_kind
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.outline import outline
from bayesdeg.commands import run as command
from bayesdeg.criticism.fit.search import SearchEffort
from bayesdeg.observations.curvature import Curvature, common_error
from bayesdeg.observations.kinds import State
from bayesdeg.run import stages as run
from bayesdeg.run import writing
from bayesdeg.surrogate.trained import write_trained
from tests.pages.html_reading import read_html
from tests.run.fresh_study import HEADS, RATIO_PRIOR, SETTINGS, SHRINKAGE, fresh_study
from tests.run.planted_offset import emulator
from tests.run.study_files import study_in
from tests.run.test_never_lost import COARSEST

WORDS = re.compile(r"degrad|\bD_?R\b|moisture|shrink|gelatin|fresh specimen|in the soil", re.I)
COLUMNS = re.compile(r"(film_)?degradation(_sd)?_pct")
OF_DEGRADATION = {
    *("degradation_misread", "degraded_skin", "delamination", "erosion", "paper_softening"),
    *("uneven_degradation", "flaw_embrittlement", "dry_embrittlement", "shrinkage_reading"),
    *("degraded_shrinkage", "degradation_scale"),
}
EFFORT = SearchEffort(replicates=60, fitted=1, pairs=0, levels_out=True)
ALPHA = "volume_ratio"
MEANS = "quantity,degradation_pct,value,sd,n,unit,source\n"
DEGRADING = {
    "shrinkage.csv": SHRINKAGE,
    "moisture.csv": "film_id,time_h,mass_equilibrated_g,mass_dry_g\nm1,0,2.5,2.0\n",
    "summary.csv": f"{MEANS}volume_ratio,,0.6,0.1,4,–,s\n",
    "force.csv": "specimen_id,degradation_pct,pressure_kPa,tip_force_N\nt1,5,20,0.1\n",
}
AN_OFFSET = '[causes]\ncandidates = ["pressure_offset", "erosion"]\n'


def names_of(plan):
    return {parameter.name for parameter in plan.base}


def tried(plan):
    return {cause.name for cause in plan.candidates} | set(plan.unjudged)


def asked_of(model, count=3):
    """What a model asks its forward map at draws from its priors."""
    calls = []

    def forward(inputs):
        calls.append(inputs)
        return emulator()(inputs)

    model = model.with_world(forward=forward)
    values = model.table.named(model.table.sample(np.random.default_rng(0), count))
    model.data_of(Curvature).predicted(model.tests(values))
    return values, calls


def test_nothing_degrades_where_all_rates_are_zero_and_nothing_of_shrinkage_is_recorded(tmp_path):
    assert not fresh_study(tmp_path).degrades
    degraded = (tmp_path / "tensile.csv").read_text(encoding="utf-8").replace("f3,0,", "f3,0.4,")
    assert fresh_study(tmp_path, {"tensile.csv": degraded}).degrades


@pytest.mark.parametrize("file", DEGRADING)
def test_one_such_file_is_enough_for_a_study_to_degrade(file, tmp_path):
    assert fresh_study(tmp_path, {file: DEGRADING[file]}).degrades


def test_means_at_no_rate_or_at_zero_do_not_degrade(tmp_path):
    summary = f"{MEANS}young_modulus,0,1.8,0.1,3,MPa,s\ntested_count,,3,,,–,s\n"
    assert not fresh_study(tmp_path, {"summary.csv": summary}).degrades


def test_the_part_is_as_large_as_its_mould_in_every_call(tmp_path):
    model = assemble(fresh_study(tmp_path), emulator()).model
    assert ALPHA not in model.table.names
    assert "emulator_error_degradation" not in model.table.names
    _, calls = asked_of(model)
    assert calls
    assert all(np.all(inputs.linear_scale == 1.0) for inputs in calls)


def test_a_prior_of_the_volume_ratio_brings_it_back_with_the_cause_that_corrects_it(tmp_path):
    study = fresh_study(tmp_path, {"study.toml": SETTINGS + RATIO_PRIOR})
    plan = outline(study)
    assert {p.name: p.law for p in plan.base}[ALPHA] == study.settings.priors[ALPHA]
    assert tried(plan) & OF_DEGRADATION == {"shrinkage_reading"}
    values, calls = asked_of(assemble(study, emulator()).model)
    for inputs in calls:
        np.testing.assert_allclose(inputs.linear_scale[:, 0, 0], values[ALPHA] ** (1.0 / 3.0))


def test_data_of_shrinkage_bring_it_back_with_all_that_is_of_degradation(tmp_path):
    fresh = outline(fresh_study(tmp_path))
    plan = outline(fresh_study(tmp_path, {"shrinkage.csv": SHRINKAGE}))
    assert names_of(plan) - names_of(fresh) == {ALPHA, "emulator_error_degradation"}
    assert tried(plan) - tried(fresh) == OF_DEGRADATION
    assert not WORDS.search(" ".join(p.meaning for p in fresh.base))
    assert {file for file, _ in plan.missing} - {file for file, _ in fresh.missing} == {
        "moisture.csv"
    }


def test_a_study_with_degradation_keeps_its_parameters(tmp_path):
    plan = outline(study_in(tmp_path))
    assert {ALPHA, "emulator_error_degradation"} <= names_of(plan)
    assert tried(plan) >= OF_DEGRADATION


def test_a_cause_of_degradation_that_a_study_asks_for_is_not_judged(tmp_path):
    plan = outline(fresh_study(tmp_path, {"study.toml": SETTINGS + AN_OFFSET}))
    assert [cause.name for cause in plan.candidates] == ["pressure_offset"]
    assert set(plan.unjudged) == {"erosion"}


def test_the_common_error_of_the_emulator_has_unit_variance_without_degradation(tmp_path):
    model = assemble(fresh_study(tmp_path), emulator()).model
    (tests,) = model.of_kind(Curvature)
    pressure = np.linspace(0.0, model.world.largest_pressure, 2001)[None]
    names = ("emulator_error_level", "emulator_error_pressure")
    variance = np.zeros(pressure.shape)
    for name in names:
        values = {other: np.array([float(other == name)]) for other in names}
        curves = replace(tests.tests, pressure=pressure, degradation=np.zeros((1, 1)))
        variance += common_error(State(values, model.world), curves)[0] ** 2
    assert np.mean(variance) == pytest.approx(1.0, abs=1e-3)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """What the command leaves of a study of which nothing degrades, and what it says meanwhile."""
    folder, out = (tmp_path_factory.mktemp(name) for name in ("fresh", "out"))
    fresh_study(folder)
    short = replace(run.EFFORTS["quick"], effective=1.0, r_hat=9.0, longest=60, chunk=30)
    coarse = partial(writing.write_deformed, resolution=COARSEST)
    words = ["bayesdeg", "run", str(folder), "--out", str(out / "run"), "--workers", "1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "emulator_for", lambda *_args, **_options: emulator())
        patch.setattr(model_kind, "JUDGE_EFFORTS", {"quick": EFFORT})
        for module in (run, model_kind):
            patch.setattr(module, "EFFORTS", {"quick": short})
        patch.setattr(writing, "write_deformed", coarse)
        patch.setattr(sys, "argv", words)
        with redirect_stdout(StringIO()) as said, redirect_stderr(said):
            assert cli.exit_code() == 0
    return out / "run", said.getvalue()


def own_words(text):
    """What a text says besides names of columns, which are a contract."""
    return COLUMNS.sub("", text)


@pytest.mark.slow
def test_the_report_of_such_a_study_has_no_word_of_degradation(finished):
    folder, _ = finished
    page = read_html((folder / "index.html").read_text(encoding="utf-8"))
    shown = [page.text, *(one.attributes.get("aria-label", "") for one in page.every())]
    assert [found[0] for text in shown for found in WORDS.finditer(text)] == []
    verdict = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
    assert verdict["left_out"] == []
    assert verdict["causes"][0] == "pressure_offset"
    assert verdict["next_experiments"]
    assert len(page.all("svg")) >= 12


@pytest.mark.slow
def test_the_console_has_no_word_of_it(finished):
    _, said = finished
    assert "sampling" in said
    assert "pressure_offset" in said
    assert "polynomials" not in said
    assert WORDS.findall(" ".join(said.split())) == []


@pytest.mark.slow
def test_its_files_have_no_word_of_it_but_names_of_columns(finished):
    folder, _ = finished
    files = [path for path in folder.iterdir() if path.suffix in (".csv", ".json")]
    assert len(files) > 15
    for path in files:
        text = own_words(path.read_text(encoding="utf-8").replace('"degrades"', ""))
        assert WORDS.findall(text) == [], path.name


@pytest.mark.slow
@pytest.mark.parametrize("asked", [("predict", "--pressure"), ("control", "--curvature")])
def test_predictions_need_no_rate_and_show_none(finished, asked, bayesdeg, tmp_path):
    folder, _ = finished
    write_trained(tmp_path / "emulator.npz", emulator())
    command, option = asked
    given = (command, folder, option, "4", "--emulator", tmp_path / "emulator.npz")
    code, printed, said = bayesdeg(*given)
    assert code == 0, said
    assert WORDS.findall(printed + said) == [], printed + said
    code, printed, _ = bayesdeg(*given, "--degradation", "0,5")
    assert code == 0
    assert "D_R" in printed


@pytest.mark.slow
def test_a_degraded_specimen_does_not_enter_such_a_run(finished, bayesdeg, tmp_path):
    folder, _ = finished
    added = tmp_path / "new.csv"
    added.write_text(HEADS["actuator.csv"] + "a9,5,40,1.2\n", encoding="utf-8")
    code, _, said = bayesdeg("update", folder, added, "--out", tmp_path / "updated")
    assert code == 2
    assert "emulator_error_degradation" in said
    assert not (tmp_path / "updated").exists()
