"""The door: what ``import bayesdeg as bd`` offers, and that it says what the engine says."""

import importlib
import inspect
import json
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bayesdeg as bd
from bayesdeg.analysis.judge import judge_model
from bayesdeg.analysis.summary import summary
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.tables import TABLES
from bayesdeg.surrogate.surrogate import Surrogate
from tests.run.planted_offset import emulator, planted_study

ROOT = Path(__file__).resolve().parents[1]
GAIN = [column.name for column in TABLES["gain"].columns]


# ---- the door itself


def test_every_public_name_is_there_and_is_declared_to_type_checkers():
    text = Path(bd.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    declared = re.findall(r"from \S+ import \w+ as (\w+)\n", text)
    assert sorted(declared) == sorted(bd.__all__)
    assert 20 <= len(bd.__all__) <= 30
    for name in bd.__all__:
        assert callable(getattr(bd, name)), name
    assert set(dir(bd)) == set(bd.__all__)
    with pytest.raises(AttributeError, match="no_such_name"):
        bd.no_such_name  # noqa: B018


def test_public_functions_and_classes_are_documented_with_their_parameters():
    for name in bd.__all__:
        found = getattr(bd, name)
        assert inspect.getdoc(found), name
        if inspect.isfunction(found):
            parameters = [p.lstrip("*") for p in inspect.signature(found).parameters]
            assert all(re.search(rf"\b{p}\b", inspect.getdoc(found)) for p in parameters), name


# ---- readings and a forward map of one's own


def hooke(values, x):
    return values["k"][:, None] * x


def added(length, force, effect):
    return length + effect["length"]


def softer(force, recorded, effect):
    return force * (1.0 + effect["share"])


OFFSET = bd.Cause(
    "offset",
    bd.Stage.READING,
    (bd.Parameter("length", bd.Normal(0, 0.5), "mm", "added to all", 0.0),),
    "the scale does not begin at zero",
    {"length": 0.3},
    "a length without a force",
    on_reading=added,
)
FORCE = np.linspace(0.5, 5.0, 12)
IDS = np.repeat(list("abcd"), 3)
LENGTH = 2.3 * FORCE + 0.4 + 0.05 * np.random.default_rng(1).standard_normal(12)
K = bd.Parameter("k", bd.LogNormal(2, 1), "mm/N")


def spring(**options):
    readings = bd.Readings(FORCE, LENGTH, specimen=IDS, name="length", unit="mm", **options)
    return bd.Model([readings], forward=hooke, parameters=[K])


@pytest.fixture(scope="module")
def base():
    return bd.calibrate(spring(), effort="quick", seed=1)


@pytest.fixture(scope="module")
def verdict(base):
    return bd.criticise(base, causes=[OFFSET], seed=1)


@pytest.fixture(scope="module")
def final(base, verdict):
    return bd.calibrate(base.model.with_causes(*verdict.causes), effort="quick", seed=1)


def test_a_spring_is_calibrated_and_summarised(base, capsys):
    table = base.summary()
    assert table.index.tolist() == ["k", "length_error"]
    columns = ["mean", "sd", "q05", "q95", "unit", "r_hat", "ess_bulk"]
    assert table.columns.tolist() == columns
    by_least_squares = FORCE @ LENGTH / (FORCE @ FORCE)
    assert table.loc["k", "mean"] == pytest.approx(by_least_squares, abs=0.02)
    assert table.loc["k", "q05"] < by_least_squares < table.loc["k", "q95"]
    assert table["unit"].tolist() == ["mm/N", "mm"]
    assert base.converged
    assert capsys.readouterr() == ("", "")


def test_its_posterior_is_a_tree_of_named_draws(base):
    tree = base.posterior
    assert isinstance(tree, xr.DataTree)
    draws = tree["posterior"]["k"]
    assert draws.dims == ("chain", "draw")
    assert float(draws.mean()) == pytest.approx(base.summary().loc["k", "mean"], abs=0.01)
    assert tree["observed_data"]["reading"].to_numpy().tolist() == LENGTH.tolist()
    assert tree["observed_data"]["specimen_id"].to_numpy().tolist() == IDS.tolist()
    assert tree["log_likelihood"]["joint"].dims == ("chain", "draw", "specimen")
    assert tree["posterior_predictive"]["reading"].shape[-1] == 12


def test_the_default_prior_of_the_error_is_half_the_spread_of_the_readings():
    law = spring().data[0].parameters[0].law
    assert law == bd.HalfNormal(0.5 * np.std(LENGTH))
    assert float(law.quantile(0.95)) == pytest.approx(np.std(LENGTH), rel=0.03)


def test_error_and_scatter_are_parameters_or_known():
    names = [p.name for p in spring(scatter=True).density.table.parameters]
    assert names == ["k", "length_error", "length_scatter"]
    known = spring(error=0.05, scatter=bd.HalfNormal(0.1)).density
    assert known.table.names == ("k", "length_scatter")
    vector = known.table.vectors({"k": np.array(2.3), "length_scatter": np.array(0.1)})
    same = IDS[:, None] == IDS
    assert known.scatter(vector) == pytest.approx(0.05**2 * np.eye(12) + 0.1**2 * same)


def test_the_cause_is_named_with_its_size(verdict):
    assert verdict.outcome == "named"
    assert verdict.causes == ("offset",)
    first = str(verdict).splitlines()[0]
    mean, low, high = map(
        float, re.fullmatch(r"named: offset (\S+) mm \[(\S+), (\S+)\]", first).groups()
    )
    assert low < 0.4 < high
    row = verdict.candidates.iloc[0]
    assert row["cause"] == "offset"
    assert row["mean"] == pytest.approx(mean, abs=0.001)
    assert row["log_bayes_factor"] > 5.0
    assert row["unit"] == "mm"
    document = verdict.to_dict()
    assert json.loads(json.dumps(document)) == document
    keys = {"outcome", "causes", "explanation", "candidates", "confusable", "false_name_rate"}
    assert keys | {"misfit", "next_experiments"} <= set(document)


def test_what_a_verdict_names_can_be_added_even_after_pickling(base, verdict):
    (name,) = pickle.loads(pickle.dumps(verdict.causes))
    assert base.model.with_causes(name).name == "base+offset"
    assert base.model.name == "base"


@pytest.mark.parametrize("off", [{"r_hat": (1.9, 1.0)}, {"ess_bulk": (900.0, 12.0)}])
def test_a_calibration_that_has_not_converged_is_not_judged(base, off):
    unsettled = replace(base.fit, diagnosis=replace(base.fit.diagnosis, **off))
    found = bd.criticise(replace(base, fit=unsettled), causes=[OFFSET], seed=1)
    assert found.outcome == "not_judged"
    assert found.causes == ()
    assert "has not converged" in found.explanation
    assert "1.90" in found.explanation or "12 effective" in found.explanation
    assert "not converged" in found.candidates["why"].iloc[0]


def test_the_final_model_predicts_better_what_was_held_out(base, final):
    table = bd.compare(base, final)
    assert table["model"].tolist() == ["base", "base+offset"]
    expected = [
        {"degradation_pct": "level", "rmse_per_m": "rmse", "crps_per_m": "crps"}.get(n, n)
        for n in GAIN
    ]
    assert table.columns.tolist() == expected
    assert table["elpd_diff"][0] == 0.0
    assert table["elpd_diff"][1] > 3.0 * table["elpd_diff_se"][1]
    assert table["rmse"][1] == pytest.approx(0.05, rel=0.5)


def test_it_predicts_at_other_inputs(final):
    table = bd.predict(final, x=[0.0, 10.0])
    assert table["x"].tolist() == [0.0, 10.0]
    assert table["q50"].to_numpy() == pytest.approx([0.4, 23.4], abs=0.15)
    assert np.all(np.diff(table[["q05", "q25", "q50", "q75", "q95"]]) > 0.0)


def test_the_same_seed_gives_the_same_bits_and_another_does_not(base, verdict):
    again = bd.calibrate(spring(), effort="quick", seed=1)
    pd.testing.assert_frame_equal(again.summary(), base.summary())
    assert bd.criticise(again, causes=[OFFSET]).to_dict() == verdict.to_dict()
    other = bd.calibrate(spring(), effort="quick", seed=2)
    assert other.summary().loc["k", "mean"] != base.summary().loc["k", "mean"]


def test_results_show_themselves_as_text_and_as_html(base, verdict):
    for one in (base, verdict):
        assert one._repr_html_().count("<table") == 1
        assert repr(one) == str(one)
    assert "length_error" in str(base)
    document = verdict.document.model_copy(update={"explanation": "<b>"})
    assert "&lt;" in replace(verdict, document=document)._repr_html_()


def test_causes_act_on_inputs_or_are_asked_by_name(base):
    share = bd.Parameter("share", bd.Normal(0, 0.2), "–", "read too low", 0.0)
    words = {"mechanism": "m", "typical": {"share": 0.1}, "revealed_by": "r"}
    gauge = bd.Cause("gauge", bd.Stage.LOAD, (share,), **words, on_inputs=softer)
    named = bd.Cause("named", bd.Stage.LOAD, (share,), **words)

    def forward(values, x):
        stretched = values["k"] * (1.0 + values.get("named.share", 0.0))
        return stretched[:, None] * x

    readings = base.model.data
    model = bd.Model(readings, forward, parameters=[K], catalogue=[gauge, named])
    vector = np.array([[np.log(2.0), 0.0, 0.1]])
    plain = model.density.expected(vector[:, :2])[0]
    assert plain == pytest.approx(2.0 * FORCE)
    for name in ("gauge", "named"):
        found = model.with_causes(name).density.expected(vector)[0]
        assert found == pytest.approx(2.2 * FORCE)


def test_several_kinds_of_readings_and_a_frame_of_inputs():
    frame = pd.DataFrame({"force": FORCE, "heat": np.linspace(0.0, 1.0, 12)})
    length = bd.Readings(frame, LENGTH, specimen=IDS, name="length", error=0.1)
    width = bd.Readings(FORCE[:4], -FORCE[:4], specimen=IDS[:4], name="width", error=0.2)
    maps = {
        "length": lambda values, x: values["k"][:, None] * (x["force"] + x["heat"]).to_numpy(),
        "width": lambda values, x: -values["k"][:, None] * x,
    }
    density = bd.Model([length, width], maps, parameters=[K]).density
    expected = density.expected(np.array([[0.0]]))[0]
    assert expected == pytest.approx(np.concatenate([FORCE + frame["heat"], -FORCE[:4]]))
    assert np.diag(density.scatter(np.array([0.0]))) == pytest.approx([0.01] * 12 + [0.04] * 4)
    assert set(density.groups) == set("abcd")


def cut(values, x):
    return np.where(values["k"] > 2.0, np.inf, values["k"])[:, None] * x


def noisy(values, x):
    return hooke(values, x) + np.random.default_rng().normal(0.0, 0.01, (len(values["k"]), len(x)))


@pytest.mark.parametrize(("forward", "words"), [(cut, "NaN"), (noisy, "by 0.0")])
def test_a_map_without_answers_or_with_noise_warns(forward, words):
    rough = bd.Readings(FORCE[:4], LENGTH[:4], error=1.0)
    model = bd.Model([rough], forward, parameters=[K])
    with pytest.warns(UserWarning, match=words) as said:
        bd.calibrate(model, effort="quick", seed=1)
    assert all(Path(one.filename) == Path(__file__) for one in said)


# ---- what goes wrong


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda b, v: bd.calibrate(b.model, effort="quik"), "'quick'"),
        (lambda b, v: bd.calibrate(b.model, seed=-1), "seed"),
        (lambda b, v: bd.calibrate(b.model, workers=0), "workers"),
        (lambda b, v: bd.calibrate(b), "Model"),
        (lambda b, v: bd.criticise(b.model), "calibrate"),
        (lambda b, v: bd.criticise(b), "causes="),
        (lambda b, v: bd.criticise(b, causes=[]), "causes="),
        (lambda b, v: b.model.with_causes(OFFSET).with_causes("ofset"), "'offset'"),
        (lambda b, v: bd.predict(b, pressure=10, degradation=0), "x="),
        (lambda b, v: bd.control(b, curvature=1, degradation=0), "reading="),
        (lambda b, v: bd.compare(b, b), "differ"),
        (lambda b, v: bd.report("nowhere", b, b), "verdict"),
        (lambda b, v: bd.Model([], hooke), "Readings"),
        (lambda b, v: bd.Model([1.0], hooke), "float"),
        (lambda b, v: bd.Model(b.model.data), "forward"),
        (
            lambda b, v: bd.Model(
                b.model.data, lambda values, x: values["k"] * 2.0, parameters=[K]
            ),
            "shape",
        ),
        (lambda b, v: bd.Model(b.model.data, hooke, parameters=[K, K]), "distinct"),
        (lambda b, v: bd.Readings([1.0], [1.0, 2.0]), "1 rows"),
        (lambda b, v: bd.Readings([1.0], [np.nan]), "finite"),
        (lambda b, v: bd.Readings([1.0, 2.0], [1.0, 2.0], specimen=["a"]), "specimen"),
        (lambda b, v: bd.Readings([1.0, 2.0], [1.0, 2.0], error=0.0), "above 0"),
    ],
)
def test_a_mistake_is_told_with_its_remedy(base, verdict, call, words):
    with pytest.raises(bd.BayesdegError, match=re.escape(words)):
        call(base, verdict)


def test_a_report_of_a_spring_has_its_tables_and_names_no_actuator(base, final, verdict, tmp_path):
    written = RunFolder(Path(bd.report(tmp_path / "spring", base, final, verdict)))
    run, told = written.read_run(), written.read_verdict()
    assert (run.forward, told.causes, told.misfit.kind, told.misfit.unit) == (
        *("forward", ("offset",), "length", "mm"),
    )
    assert not told.left_out
    fitted = written.read_table("fitted").query("model == 'final'")
    assert fitted["measured"].tolist() == LENGTH.tolist()
    assert (fitted["mean"] - fitted["measured"]).abs().max() < 0.2
    assert fitted["measured"].between(fitted["q05"], fitted["q95"]).mean() > 0.7
    page = (written.path / "index.html").read_text(encoding="utf-8")
    assert 'id="figure-readings"' in page
    assert "Yeoh" not in page
    assert "Nagai" not in page


def test_control_of_a_spring_finds_the_force_for_a_length(final):
    wanted = [3.0, 8.0, 1000.0]
    table = bd.control(final, reading=wanted, x=np.linspace(0.0, 5.0, 21)).set_index("wanted")
    k, offset = (final.summary().loc[name, "mean"] for name in ("k", "offset.length"))
    for length in wanted[:2]:
        row = table.loc[length]
        assert row["needed_q50"] == pytest.approx((length - offset) / k, abs=0.02)
        assert row["needed_q05"] < row["needed_q50"] < row["needed_q95"]
        again = bd.predict(final, x=[row["needed_q50"]])["q50"].iloc[0]
        assert again == pytest.approx(length, abs=0.02)
    assert table["reached"].tolist() == [True, True, False]
    assert np.isnan(table.loc[1000.0, "needed_q50"])


def test_one_specimen_cannot_be_held_out(base):
    alone = bd.Readings(FORCE, LENGTH, specimen="a", name="length")
    model = bd.Model([alone], hooke, parameters=[K])
    fits = [bd.calibrate(one, effort="quick", seed=1) for one in (model, model.with_causes(OFFSET))]
    with pytest.raises(bd.BayesdegError, match="specimen="):
        bd.compare(*fits)


# ---- the falling ball by the verbs and by the engine


@pytest.fixture(scope="module")
def ball():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "studies"))
        yield importlib.import_module("falling_ball")


@pytest.mark.parametrize("gravity_known", [False, True])
def test_the_falling_ball_comes_to_the_same_figures(ball, gravity_known):
    model = ball.asked(gravity_known=gravity_known).density
    old = summary(judge_model(model, ball.CATALOGUE, seed=1))

    def fall(values, height):
        g = values["g"][:, None] if "g" in values else ball.GRAVITY
        drag = values["drag.coefficient"][:, None] if "drag.coefficient" in values else 0.0
        return ball.fall_time(
            ball.Fall(height + 0.0 * values["timing_error"][:, None], g, drag), height
        )

    readings = bd.Readings(
        model.places.along,
        model.observed,
        specimen=model.places.specimen,
        history=model.places.history,
        name="timing",
        unit="s",
        error=bd.HalfNormal(0.1),
    )
    catalogue = (
        replace(ball.DRAG, on_inputs=None),
        ball.REACTION_TIME,
        replace(ball.RELEASE_HEIGHT, on_inputs=lambda height, _, effect: height + effect["error"]),
    )
    gravity = () if gravity_known else (bd.Parameter("g", bd.Uniform(5.0, 15.0), "m/s²"),)
    fit = bd.calibrate(bd.Model([readings], fall, parameters=gravity), effort="quick", seed=1)
    found = bd.criticise(fit, causes=catalogue, effort="standard", seed=1)
    assert (found.outcome, list(found.causes)) == (old["outcome"], old["causes"])
    new = summary(found.judgement)
    assert new["threshold"] == pytest.approx(old["threshold"], rel=1e-9)
    assert new["misfit"] == pytest.approx(old["misfit"], rel=1e-9)
    for one, other in zip(new["fitted"], old["fitted"], strict=True):
        assert one["causes"] == other["causes"]
        assert one["log_bayes_factor"] == pytest.approx(other["log_bayes_factor"], rel=1e-9)
        for name, value in one["posterior"].items():
            assert value == pytest.approx(other["posterior"][name], rel=1e-9)


# ---- a study; its verbs are held against commands in test_verbs_and_commands.py


@pytest.fixture(scope="module")
def planted(tmp_path_factory):
    return planted_study(tmp_path_factory.mktemp("planted"))


def test_faults_of_a_study_are_told_all_at_once(tmp_path):
    (tmp_path / "study.toml").write_text("sed = 1\n")
    (tmp_path / "break.csv").write_text("specimen_id,degradation_pct,elongation_pct\na,0,-3\n")
    with pytest.raises(bd.StudyError) as caught:
        bd.read_study(str(tmp_path))
    assert {fault.file for fault in caught.value.faults} == {"study.toml", "break.csv"}


def test_a_geometry_without_an_emulator_is_told(planted, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    settings = replace(planted.settings, dimensions=replace(planted.geometry, length=60.0))
    with pytest.raises(bd.BayesdegError, match="emulator"):
        bd.Model(replace(planted, settings=settings))
    assert isinstance(bd.emulator(planted), Surrogate)


def test_what_is_the_users_own_is_not_sent_to_other_processes(planted):
    ours = bd.Model(planted, emulator(), causes=["gravity"])
    assert ours.is_parallel
    assert not ours.with_causes(OFFSET).is_parallel
    assert not bd.Model(planted, lambda inputs: emulator()(inputs)).is_parallel


def test_a_script_without_a_guard_is_not_started_again_by_its_workers(planted, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from pathlib import Path\n"
        "import bayesdeg.surrogate.workers as place\n"
        "with (Path(__file__).parent / 'count').open('a') as file:\n"
        "    file.write('x')\n"
        "for _ in range(2):\n"
        "    with place.kept_processes(2) as pool:\n"
        "        assert list(pool.map(abs, [-1, -2, 3])) == [1, 2, 3]\n"
        "assert len(place._KEPT) == 1\n"
        "assert Path(__file__).name == 'script.py'\n"
    )
    subprocess.run([sys.executable, str(script)], check=True, timeout=120)
    assert (tmp_path / "count").read_text() == "x"
