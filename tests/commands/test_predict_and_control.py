"""``predict`` and ``control`` on a run folder whose posterior is known."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import find
from bayesdeg.inference.course import CourseModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.inference.tree import to_datatree
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.folder import RunFolder
from bayesdeg.prediction.predictive import curvature_bands, rupture_table
from bayesdeg.prediction.stored import model_document, read_stored
from bayesdeg.surrogate.trained import default_surrogate, to_bytes, write_trained
from tests.inference.small_study import TRUTH, altered, values_of
from tests.run.study_files import study_in

OFFSET = 12.0
DRAWS = 400
LEVELS, PRESSURES = np.array([0.0, 10.0]), np.array([0.0, 40.0, 80.0, 120.0])
AT = ("--pressure", "0:120:40", "--degradation", "0,10")
BANDS = ["q05", "q25", "q50", "q75", "q95"]
PROBABILITIES = ["probability", "probability_q05", "probability_q95"]


def chain_of(model, width, known=None):
    """Independent normal laws about the truth."""
    generator = np.random.default_rng(5)
    offset = {"elongation_at_0": 22.0, "pressure_offset.offset": OFFSET}
    known = values_of(TRUTH | offset | (known or {}))
    centre = model.table.vectors({name: known[name] for name in model.table.names})[0]
    vectors = centre + width * generator.standard_normal((2, DRAWS // 20, 10, len(centre)))
    return Chain(vectors, np.zeros(vectors.shape[:3]), np.full(2, 0.4))


def write_run(path, model, final, *, width=0.03, training=None, known=None):
    """Write what a finished run leaves of its posteriors."""
    folder = RunFolder(path)
    for name, fitted in (("posterior_base", model), ("posterior", final)):
        tree = to_datatree(fitted, chain_of(fitted, width, known), np.random.default_rng(0))
        folder.write_posterior(name, tree)
    folder.write_json("verdict", {"outcome": "named", "causes": [c.name for c in final.causes]})
    record = json.loads(default_surrogate().record) if training is None else training
    folder.write_json(
        "run",
        {
            "title": "Small",
            "seed": 7,
            "model": model_document(model).document(),
            "emulator": {"training": record},
        },
    )
    return path


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    base = assemble(study_in(tmp_path_factory.mktemp("study"))).model
    return base, base.extended(find("pressure_offset"))


@pytest.fixture(scope="module")
def report(tmp_path_factory, models):
    return write_run(tmp_path_factory.mktemp("runs") / "run", *models)


@pytest.fixture(autouse=True)
def empty_folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def rewritten(run, folder, document, change, *, of=None):
    """Return a copy of a run, of whose document entries were changed, or those of one of them."""
    copy = folder / "rewritten"
    shutil.copytree(run, copy)
    content = RunFolder(copy).read_json(document)
    new = change if of is None else {of: content[of] | change}
    RunFolder(copy).write_json(document, content | new)
    return copy


def rows_of(printed):
    return pd.DataFrame(json.loads(printed)["rows"]).astype({"why": str})


def test_the_stored_model_predicts_as_the_one_that_was_calibrated(report, models):
    stored = read_stored(report)
    assert stored.name == "base+pressure_offset"
    assert stored.model.world.nodes == models[1].world.nodes
    assert stored.model.world.elongation_nodes == models[1].world.elongation_nodes
    assert stored.measured == {
        "pressure_kPa": (40.0, 120.0),
        "degradation_pct": (0.0, 25.0),
        "film_degradation_pct": (0.0, 25.0),
    }
    vectors = chain_of(models[1], 0.03).vectors
    calibrated = models[1].table.named(np.swapaxes(vectors, 1, 2).reshape(-1, vectors.shape[-1]))
    rebuilt = stored.model.table.named(
        stored.chain.vectors.reshape(-1, stored.chain.vectors.shape[-1])
    )
    again = altered(stored.model, actuator=models[1].data_of(Curvature).tests)
    own = again.data_of(Curvature).predicted(again.tests(rebuilt)).prediction.curvature
    expected = (
        models[1].data_of(Curvature).predicted(models[1].tests(calibrated)).prediction.curvature
    )
    np.testing.assert_allclose(own, expected, rtol=1e-10)


@pytest.mark.parametrize("which", [0, 1])
def test_predictions_agree_with_the_bands_of_the_run(bayesdeg, report, models, which):
    """Within the Monte Carlo error of quantiles of 2000 draws of a spread of 5 %."""
    model = models[which]
    chain = chain_of(model, 0.03)
    options = {"degradation": LEVELS, "pressure": PRESSURES, "draws": 4000}
    bands = curvature_bands(model, chain, np.random.default_rng(1), **options)
    rupture = rupture_table(model, chain, np.random.default_rng(1), **options)
    code, printed, _ = bayesdeg("predict", report, *AT, "--json", *([] if which else ["--base"]))
    assert code == 0
    assert json.loads(printed)["model"] == ("base", "base+pressure_offset")[which]
    found = rows_of(printed)
    key = ["degradation_pct", "pressure_kPa"]
    assert found[key].to_numpy().tolist() == bands[key].to_numpy().tolist()
    np.testing.assert_allclose(found[BANDS], bands[BANDS], rtol=0.015, atol=1e-9)
    least = 1.0 / read_stored(report).tested.rupture_checks
    pressed = found["pressure_kPa"] > 0.0
    assert found.loc[pressed, PROBABILITIES].min().min() == pytest.approx(least)
    known = rupture[PROBABILITIES].where(~pressed, rupture[PROBABILITIES].clip(lower=least))
    np.testing.assert_allclose(found[PROBABILITIES], known, atol=0.03)
    assert found["probability"].between(0.05, 0.95).any()
    assert (found["answered"] == 1.0).all()


def test_the_named_cause_acts_in_predictions(bayesdeg, report):
    """Up to the offset nothing bends."""
    at = ("--pressure", "10", "--degradation", "0", "--json")
    with_cause = rows_of(bayesdeg("predict", report, *at)[1])
    without = rows_of(bayesdeg("predict", report, *at, "--base")[1])
    assert with_cause["q95"][0] == 0.0
    assert without["q05"][0] > 0.1


def test_json_is_all_that_is_printed_and_csv_holds_the_same(bayesdeg, report, tmp_path):
    out = tmp_path / "table.csv"
    code, printed, messages = bayesdeg("predict", report, *AT, "--json", "--quiet", "--out", out)
    assert code == 0
    assert messages == ""
    written = pd.read_csv(out)
    assert list(written.columns) == [
        *("degradation_pct", "pressure_kPa", *BANDS, *PROBABILITIES, "answered", "why")
    ]
    found = rows_of(printed)
    np.testing.assert_allclose(written[BANDS], found[BANDS], rtol=1e-12)
    assert set(json.loads(printed)["units"]) == {*written.columns} - {"why"}


def test_the_table_has_units_and_the_same_numbers(bayesdeg, report):
    code, printed, _ = bayesdeg("predict", report, "--pressure", "80", "--degradation", "10")
    assert code == 0
    for unit in ("[kPa]", "[%]", "[1/m]"):
        assert unit in printed
    row = rows_of(
        bayesdeg("predict", report, "--pressure", "80", "--degradation", "10", "--json")[1]
    )
    assert f"{row['q50'][0]:.2f}" in printed


def test_the_same_seed_gives_the_same_answer(bayesdeg, report):
    first, second, other = (
        bayesdeg("predict", report, *AT, "--json", "--seed", seed)[1] for seed in (1, 1, 2)
    )
    assert first == second
    assert first != other


def test_rows_beyond_the_emulator_are_empty_and_say_why(bayesdeg, report):
    at = ("--pressure", "80,2000", "--degradation", "0", "--json")
    code, printed, messages = bayesdeg("predict", report, *at)
    assert code == 0
    inside, outside = json.loads(printed)["rows"]
    assert inside["why"] == ""
    assert all(outside[name] is None for name in (*BANDS, *PROBABILITIES))
    assert outside["answered"] == 0.0
    assert outside["why"].startswith("100 %")
    assert "120 kPa" in messages
    assert "2000 kPa" in messages


@pytest.mark.parametrize(
    ("pressure", "degradation", "words"),
    [
        ("100", "31", "actuators were measured"),
        ("100", "31", "films were measured"),
        ("100", "31", "0 to 25 %"),
        ("150", "10", "120 kPa"),
        ("100", "0.25", "0.25 %"),
    ],
)
def test_extrapolation_is_said(bayesdeg, report, pressure, degradation, words):
    at = ("--pressure", pressure, "--degradation", degradation)
    code, _, messages = bayesdeg("predict", report, *at)
    assert code == 0
    assert words in messages


UNUSABLE = {"usable": False, "sentence": "The sampler has not converged."}


@pytest.mark.parametrize(
    ("document", "change", "words"),
    [
        ("verdict", {"outcome": "unexplained"}, "no cause explains"),
        (
            "verdict",
            {"outcome": "ambiguous", "causes": ["pressure_offset", "pressure_loss"]},
            "pressure_offset, pressure_loss apart",
        ),
        ("run", {"convergence": {"final": UNUSABLE}}, UNUSABLE["sentence"]),
    ],
)
def test_doubts_of_the_run_are_passed_on(bayesdeg, report, tmp_path, document, change, words):
    doubtful = rewritten(report, tmp_path, document, change)
    code, _, messages = bayesdeg("predict", doubtful, "--pressure", "80", "--degradation", "10")
    assert code == 0
    assert words in messages


def test_nothing_is_said_within_what_was_measured(bayesdeg, report):
    _, printed, _ = bayesdeg("predict", report, *AT, "--json")
    assert json.loads(printed)["messages"] == []


def test_control_gives_the_pressure_at_which_half_of_the_specimens_bend_so_far(bayesdeg, report):
    at = ("--curvature", "4,6", "--degradation", "10,25", "--risk", "0.5", "--beyond", "--json")
    code, printed, _ = bayesdeg("control", report, *at)
    assert code == 0
    found = rows_of(printed)
    assert len(found) == 4
    for row in found.to_dict("records"):
        assert row["reached"] == 1
        assert row["needed_q05_kPa"] < row["pressure_kPa"] < row["needed_q95_kPa"]
        assert row["pressure_kPa"] <= row["allowed_kPa"]
        assert row["q50"] == pytest.approx(row["wanted_per_m"], rel=1e-3)
        asked = (f"{row['pressure_kPa']:.6f}", f"{row['degradation_pct']:g}")
        back = bayesdeg(
            "predict", report, "--pressure", asked[0], "--degradation", asked[1], "--json"
        )
        predicted = rows_of(back[1])
        np.testing.assert_allclose(
            predicted[BANDS].to_numpy()[0], [row[name] for name in BANDS], rtol=0.015
        )


def test_control_says_what_is_out_of_reach_and_what_is_best(bayesdeg, report):
    at = ("--curvature", "25", "--degradation", "0", "--risk", "0.02", "--beyond")
    code, printed, _ = bayesdeg("control", report, *at)
    assert code == 0
    assert "25 1/m at 0 %" in printed
    assert "not above 0.02" in printed
    row = json.loads(bayesdeg("control", report, *at, "--json")[1])["rows"][0]
    assert row["reached"] == 0
    assert row["pressure_kPa"] == row["allowed_kPa"] < row["needed_q50_kPa"]
    assert 0.0 < row["q50"] < 25.0
    # the risk that is kept to is less than the specimens can tell
    assert row["probability"] == pytest.approx(1.0 / read_stored(report).tested.rupture_checks)
    assert "below 1 in 9" in bayesdeg("control", report, *at)[2]
    assert row["why"] in printed


def test_more_risk_allows_more_pressure(bayesdeg, report):
    allowed = [
        json.loads(
            bayesdeg(
                *("control", report, "--curvature", "25", "--degradation", "0"),
                *("--risk", risk, "--beyond", "--json"),
            )[1]
        )["rows"][0]["allowed_kPa"]
        for risk in (0.001, 0.05, 0.5)
    ]
    assert np.all(np.diff(allowed) > 1.0)


@pytest.fixture(scope="module")
def strong(tmp_path_factory, models):
    """A run of which the risk would allow more than the 120 kPa that were tested."""
    path = tmp_path_factory.mktemp("runs") / "strong"
    return write_run(path, *models, known={"elongation_at_0": 210.0})


def test_control_allows_nothing_above_what_was_tested_unless_told(bayesdeg, strong):
    at = ("control", strong, "--curvature", "25", "--degradation", "0,25")
    code, printed, messages = bayesdeg(*at)
    assert code == 0
    assert "--beyond" in printed
    assert "rests on" not in messages
    rows = rows_of(bayesdeg(*at, "--json")[1])
    assert rows["allowed_kPa"].tolist() == rows["pressure_kPa"].tolist() == [120.0, 120.0]
    assert (rows["reached"] == 0).all()
    assert (rows["needed_q05_kPa"] > 120.0).all()
    code, printed, messages = bayesdeg(*at, "--beyond", "--json")
    assert code == 0
    assert (rows_of(printed)["allowed_kPa"] > 150.0).all()
    assert "above 120 kPa" in messages
    assert "rests on" in messages


BURST = {
    "degradation_pct": 24.0,
    "burst": 1,
    "pressure_kPa": 100.0,
    "survived_kPa": 80.0,
    "source": "actuator.csv",
}


@pytest.mark.parametrize(
    ("change", "allowed", "words"),
    [
        ({}, 80.0, "burst at 100 kPa"),
        ({"survived_kPa": None}, 0.0, "survived any"),
        ({"pressure_kPa": None, "burst": 2, "tested": 3}, 120.0, "2 of 3"),
    ],
)
def test_control_stays_below_pressures_at_which_actuators_burst(
    bayesdeg, strong, tmp_path, change, allowed, words
):
    burst = rewritten(strong, tmp_path, "run", {"bursts": [BURST | change]}, of="model")
    code, printed, messages = bayesdeg(
        "control", burst, "--curvature", "5", "--degradation", "10,25", "--json"
    )
    assert code == 0
    assert rows_of(printed)["allowed_kPa"].tolist() == [120.0, allowed]
    assert words in " ".join(messages.split())


def test_control_writes_csv(bayesdeg, report, tmp_path):
    out = tmp_path / "settings.csv"
    at = ("--curvature", "4", "--degradation", "10", "--out", out, "--json", "--quiet")
    code, printed, messages = bayesdeg("control", report, *at)
    assert (code, messages) == (0, "")
    assert pd.read_csv(out)["pressure_kPa"][0] == pytest.approx(rows_of(printed)["pressure_kPa"][0])


PREDICT = ("--pressure", "100", "--degradation", "10")
CONTROL = ("--curvature", "5", "--degradation", "10")


@pytest.mark.parametrize("command", [("predict", *PREDICT), ("control", *CONTROL)])
def test_what_is_no_finished_run_ends_with_2(bayesdeg, report, tmp_path, command):
    name, *rest = command
    code, _, messages = bayesdeg(name, "nowhere", *rest)
    assert code == 2
    assert "no such folder" in messages
    unfinished = tmp_path / "unfinished"
    shutil.copytree(report, unfinished, ignore=shutil.ignore_patterns("run.json"))
    code, _, messages = bayesdeg(name, unfinished, *rest)
    assert code == 2
    assert "run.json is missing" in messages
    assert "finish the run" in messages


def test_a_study_without_actuators_ends_with_2(bayesdeg, tmp_path):
    texts = ("actuator.csv", "summary.csv")
    (tmp_path / "study").mkdir()
    model = assemble(study_in(tmp_path / "study", without=texts)).model
    code, _, messages = bayesdeg("predict", write_run(tmp_path / "run", model, model), *PREDICT)
    assert code == 2
    assert "actuator.csv" in messages


def test_without_breaks_curvature_is_predicted_and_rupture_is_not(bayesdeg, tmp_path):
    (tmp_path / "study").mkdir()
    texts = ("break.csv", "summary.csv")
    model = assemble(study_in(tmp_path / "study", without=texts)).model
    run = write_run(tmp_path / "run", model, model)
    code, printed, messages = bayesdeg("predict", run, *PREDICT, "--json")
    row = json.loads(printed)["rows"][0]
    assert code == 0
    assert row["q50"] > 0.0
    assert row["probability"] is None
    assert "break.csv" in messages
    code, printed, _ = bayesdeg("control", run, *CONTROL, "--json")
    row = json.loads(printed)["rows"][0]
    assert (code, row["reached"], row["probability"]) == (0, 1, None)


def test_published_statistics_alone_are_enough_if_they_say_how_actuators_bend(bayesdeg, tmp_path):
    (tmp_path / "study").mkdir()
    model = assemble(study_in(tmp_path / "study", without=("actuator.csv",))).model
    code, printed, messages = bayesdeg(
        "predict", write_run(tmp_path / "run", model, model), *PREDICT, "--json"
    )
    assert code == 0
    assert json.loads(printed)["rows"][0]["q50"] > 0.0
    assert "no actuator" in messages


def test_the_emulator_of_the_run_is_needed(bayesdeg, models, tmp_path):
    """Another of the same geometry was not the one that the posterior was made with."""
    shipped = default_surrogate()
    record = json.dumps(json.loads(shipped.record) | {"seed": 99, "mesh_error_pct": float("nan")})
    own = replace(shipped, record=record)
    training = json.loads(record)
    run = write_run(tmp_path / "run", *models, training=training)
    code, _, messages = bayesdeg("predict", run, *PREDICT)
    assert code == 2
    assert "--emulator FILE" in messages
    write_trained(tmp_path / "own.npz", own)
    write_trained(tmp_path / "other.npz", shipped)
    assert bayesdeg("predict", run, *PREDICT, "--emulator", tmp_path / "own.npz")[0] == 0
    code, _, messages = bayesdeg("predict", run, *PREDICT, "--emulator", tmp_path / "other.npz")
    assert code == 2
    assert "other.npz" in messages
    assert "not the emulator" in messages
    RunFolder(run).write_emulator(b"damaged")
    assert bayesdeg("predict", run, *PREDICT)[0] == 2
    RunFolder(run).write_emulator(to_bytes(own))
    assert bayesdeg("predict", run, *PREDICT)[0] == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"model": None}, "older version"),
        ({"emulator": {}}, "record an emulator"),
        ({"model": {"nodes_pct": [0.0, 25.0]}}, "run.json"),
        ({"model": {"nodes_pct": "all"}}, "a list"),
        ({"model": 3}, "an object"),
    ],
)
def test_a_record_that_does_not_fit_ends_with_2(bayesdeg, report, tmp_path, change, words):
    damaged = rewritten(report, tmp_path, "run", change)
    code, _, messages = bayesdeg("predict", damaged, *PREDICT)
    assert code == 2
    assert words in messages


def test_a_posterior_of_another_model_is_refused(bayesdeg, report, tmp_path):
    nodes = {"nodes_pct": [0.0, 25.0 / 3.0, 50.0 / 3.0, 25.0]}
    mixed = rewritten(report, tmp_path, "run", nodes, of="model")
    code, _, messages = bayesdeg("predict", mixed, *PREDICT)
    assert code == 2
    assert "do not match" in messages
    assert "c1_control_8_33" in messages


def changed(report, tmp_path, change):
    """Return a copy of a run whose posterior was changed by hand."""
    copy = tmp_path / "changed"
    shutil.copytree(report, copy)
    folder = RunFolder(copy)
    tree = folder.read_posterior("posterior")
    draws = change(tree["posterior"].to_dataset())
    folder.write_posterior("posterior", xr.DataTree.from_dict({"posterior": draws}))
    return copy


def with_draw(name, value):
    def change(draws):
        values = draws[name].to_numpy().copy()
        values[-1, -1] = value
        return draws.assign({name: (draws[name].dims, values)})

    return change


@pytest.mark.parametrize("command", [("predict", *PREDICT), ("control", *CONTROL)])
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (with_draw("c1_at_0", np.nan), "draws of c1_at_0"),
        (with_draw("emulator_error_level", np.inf), "draws of emulator_error_level"),
        (with_draw("c1_at_25", -0.2), "c1_at_25 is -0.2"),
        (with_draw("volume_ratio", 0.0), "volume_ratio is 0,"),
        (lambda draws: draws.isel(draw=slice(0, 0)), "have no draws"),
        (lambda draws: draws.assign(c1_at_0=("chain", np.ones(2))), "different numbers"),
    ],
)
def test_draws_that_no_calibration_leaves_are_refused(
    bayesdeg, report, tmp_path, command, change, words
):
    name, *rest = command
    code, printed, messages = bayesdeg(name, changed(report, tmp_path, change), *rest)
    assert code == 2
    assert printed == ""
    assert words in messages
    assert len(messages.splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"largest_pressure_kPa": -3.0}, "above 0"),
        ({"paper_thickness_mm": 0.0}, "above 0"),
        ({"largest_pressure_kPa": 10**300}, "finite number"),
        ({"nodes_pct": [0.0, 10**300, 25.0]}, "finite number"),
    ],
)
def test_an_impossible_model_is_refused(bayesdeg, report, tmp_path, change, words):
    damaged = rewritten(report, tmp_path, "run", change, of="model")
    code, _, messages = bayesdeg("predict", damaged, *PREDICT)
    assert code == 2
    assert words in messages


@pytest.mark.parametrize("seed", ["-1", str(2**63), 5000 * "9"])
def test_an_impossible_seed_is_refused(bayesdeg, report, seed):
    code, _, messages = bayesdeg("predict", report, *PREDICT, "--seed", seed)
    assert code == 2
    assert "--seed" in messages
    assert "Traceback" not in messages


def test_titles_and_names_are_shown_as_they_are(bayesdeg, report, tmp_path):
    named = tmp_path / "[red]x[/blue] :100:"
    shutil.copytree(report, named)
    folder = RunFolder(named)
    folder.write_json("run", folder.read_json("run") | {"title": "a [/b] :100: title"})
    code, printed, _ = bayesdeg("predict", named, *PREDICT)
    assert code == 0
    assert "a [/b] :100: title" in printed
    (named / "run.json").unlink()
    code, _, messages = bayesdeg("predict", named, *PREDICT)
    assert code == 2
    assert str(named) in messages


# ---- conditions


@pytest.fixture(scope="module")
def crept(tmp_path_factory, models):
    """A run that named creep."""
    final = models[0].extended(find("creep"))
    known = {"creep.amount": 0.15, "creep.time_constant": 30.0}
    return write_run(tmp_path_factory.mktemp("runs") / "crept", models[0], final, known=known)


def test_a_named_cause_of_time_moves_predict_and_control(bayesdeg, crept):
    at = (crept, "--degradation", "10", "--json")
    bent, needed, words = [], [], []
    for more in ((), ("--hold-s", "60")):
        code, printed, messages = bayesdeg("predict", *at, "--pressure", "80", *more)
        assert code == 0
        bent.append(rows_of(printed)["q50"][0])
        words.append(messages)
        code, printed, _ = bayesdeg("control", *at, "--curvature", "4", "--risk", "0.5", *more)
        assert code == 0
        needed.append(rows_of(printed)["needed_q50_kPa"][0])
    assert bent[1] > 1.1 * bent[0]
    assert needed[1] == pytest.approx(needed[0] / 1.13, rel=0.02)  # 1 + 0.15 (1 − e⁻²)
    assert words == ["", ""]


def test_without_options_the_answer_is_that_of_the_defaults_bit_for_bit(bayesdeg, crept):
    at = ("predict", crept, *AT, "--json")
    stated = ("--hold-s", "0", "--cycle", "1", "--branch", "loading", "--mount", "horizontal")
    assert bayesdeg(*at)[1] == bayesdeg(*at, *stated, "--degradation-sd", "0")[1]


def test_a_condition_that_no_named_cause_answers_to_is_said(bayesdeg, crept):
    for command in (("predict", *PREDICT), ("control", *CONTROL)):
        name, *rest = command
        options = ("--hold-s", "60", "--mount", "hanging")
        code, printed, messages = bayesdeg(name, crept, *rest, *options, "--json")
        assert code == 0
        assert "mount hanging" in messages
        assert "creep" in messages
        assert "hold_s" not in messages
        assert any("mount hanging" in one for one in json.loads(printed)["messages"])


# ---- hours in the soil

LIMIT, TIME_CONSTANT = 24.0, 10.0


def with_course(run, folder, *, width=0.1):
    """Return a copy of a run that also has the posterior of a course of degradation."""
    copy = folder / "buried"
    shutil.copytree(run, copy)
    films = RunFolder(copy)
    model = CourseModel(("a", "b"), np.array([0.0, 24.0]), np.array([20.0, 15.0]))
    known = {
        "fresh_moisture": 20.0,
        "degradation_limit": LIMIT,
        "degradation_time_constant": TIME_CONSTANT,
        "moisture_scatter": 0.5,
    }
    centre = model.table.vectors({name: np.array([value]) for name, value in known.items()})[0]
    generator = np.random.default_rng(8)
    vectors = centre + width * generator.standard_normal((2, 100, 10, len(centre)))
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.full(2, 0.4))
    films.write_posterior("posterior_course", to_datatree(model, chain, generator))
    content = films.read_json("run")
    content["model"]["measured"]["time_h"] = [0.0, 24.0]
    films.write_json("run", content)
    return copy


@pytest.fixture(scope="module")
def buried(report, tmp_path_factory):
    return with_course(report, tmp_path_factory.mktemp("course"))


def test_hours_in_the_soil_become_degradation_rates_with_their_uncertainty(bayesdeg, buried):
    at = ("predict", buried, "--pressure", "80", "--json")
    code, printed, messages = bayesdeg(*at, "--hours", "0,8,24")
    assert (code, messages) == (0, "")
    found = rows_of(printed)
    expected = LIMIT * -np.expm1(-np.array([0.0, 8.0, 24.0]) / TIME_CONSTANT)
    assert found["time_h"].tolist() == [0.0, 8.0, 24.0]
    np.testing.assert_allclose(found["degradation_pct"], expected, rtol=0.02)
    assert found["degradation_q05"][0] == found["degradation_q95"][0] == 0.0
    assert (found["degradation_q05"][1:] < 0.95 * expected[1:]).all()
    assert (found["degradation_q95"][1:] > 1.05 * expected[1:]).all()
    assert json.loads(printed)["units"]["time_h"] == "h"
    known = rows_of(bayesdeg(*at, "--degradation", f"0,{expected[1]},{expected[2]}")[1])
    np.testing.assert_allclose(found["q50"], known["q50"], rtol=0.05)
    width = {name: np.log(one["q95"] / one["q05"]) for name, one in (("h", found), ("%", known))}
    assert width["h"][0] == pytest.approx(width["%"][0], rel=1e-9)
    assert (width["h"][1:] > 1.2 * width["%"][1:]).all()


def test_without_uncertainty_hours_give_what_the_rate_gives(bayesdeg, report, tmp_path):
    exact = with_course(report, tmp_path, width=0.0)
    rate = LIMIT * -np.expm1(-8.0 / TIME_CONSTANT)
    for command in (("predict", "--pressure", "80"), ("control", "--curvature", "4")):
        name, *asked = command
        answers = [
            bayesdeg(name, exact, *asked, *at, "--json")
            for at in (("--hours", "8"), ("--degradation", f"{rate:.17g}"))
        ]
        assert [code for code, _, _ in answers] == [0, 0], answers
        one, other = (rows_of(printed) for _, printed, _ in answers)
        numeric = [n for n in other.columns if n not in {"why", "reached"}]
        np.testing.assert_allclose(
            one[numeric].to_numpy(float), other[numeric].to_numpy(float), rtol=1e-9
        )


def test_control_by_hours_allows_what_all_likely_rates_allow(bayesdeg, buried):
    code, printed, _ = bayesdeg(
        "control", buried, "--curvature", "4", "--hours", "8,16", "--risk", "0.3", "--json"
    )
    found = rows_of(printed)
    assert code == 0
    assert found["time_h"].tolist() == [8.0, 16.0]
    assert (found["allowed_kPa"] <= 120.0).all()
    assert found["needed_q50_kPa"].is_monotonic_increasing
    printed = bayesdeg("control", buried, "--curvature", "4", "--hours", "8")[1]
    assert "[h]" in printed


def test_hours_beyond_the_films_are_said(bayesdeg, buried):
    code, _, messages = bayesdeg("predict", buried, "--pressure", "80", "--hours", "48")
    assert code == 0
    assert "24 h" in messages
    assert "48 h" in messages


def test_without_moisture_hours_end_with_2_and_say_what_is_needed(bayesdeg, report):
    code, printed, messages = bayesdeg("predict", report, "--pressure", "80", "--hours", "8")
    assert (code, printed) == (2, "")
    assert "moisture.csv" in messages
    assert len(messages.strip().splitlines()) == 1


@pytest.mark.parametrize("option", ["--x", "--reading"])
def test_options_of_a_forward_map_of_ones_own_are_named_where_there_is_none(
    bayesdeg, report, option
):
    code, _, messages = bayesdeg("control", report, "--degradation", "0", option, "1")
    assert code == 2
    assert f"{option} is" in " ".join(messages.split())
