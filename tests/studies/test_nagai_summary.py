import importlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from bayesdeg.emulator.trained import default_surrogate

STUDIES = Path(__file__).resolve().parents[2] / "studies"
PARTS = ("agreement", "published", "rupture")


@pytest.fixture(scope="module")
def study():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(STUDIES))
        parts = {name: importlib.import_module(f"nagai_2021.{name}") for name in PARTS}
        yield SimpleNamespace(script=importlib.import_module("nagai_2021_summary"), **parts)


@pytest.fixture(scope="module")
def few(study):
    return study.published.draw(default_surrogate(), np.random.default_rng(3), 600)


@pytest.fixture(scope="module")
def quick_run(tmp_path_factory):
    out = tmp_path_factory.mktemp("nagai") / "report"
    script = STUDIES / "nagai_2021_summary.py"
    command = [sys.executable, str(script), "--quick", "--seed", "5", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    return out, done.stdout


@pytest.fixture(scope="module")
def answers(quick_run):
    return json.loads((quick_run[0] / "answers.json").read_text(encoding="utf-8"))


def single_material(materials, row):
    chosen = np.zeros(len(materials), dtype=bool)
    chosen[row] = True
    return materials.take(chosen)


def r_squared(experiment, simulation):
    return 1.0 - np.sum((experiment - simulation) ** 2) / (experiment.size * np.var(experiment))


def test_published_numbers_are_those_of_the_other_study(study):
    table = pd.read_csv(STUDIES / "gelatin_actuator" / "summary.csv", comment="#")
    by_quantity = {name: rows["value"].to_numpy() for name, rows in table.groupby("quantity")}
    published = study.published
    assert by_quantity["r_squared"].tolist() == published.R_SQUARED.tolist()
    assert by_quantity["ruptured_count"].tolist() == published.RUPTURED.tolist()
    assert set(by_quantity["tested_count"]) == {published.SPECIMENS}
    assert by_quantity["young_modulus"][0] == published.YOUNG_FRESH[0]
    assert by_quantity["young_modulus"][1] == pytest.approx(published.YOUNG_DEGRADED[0], abs=0.05)
    assert by_quantity["elongation_at_break"][0] == published.ELONGATION_FRESH[0]


def test_materials_agree_with_the_published_moduli_and_trends(study, few):
    materials, _ = few
    fresh, degraded = 6.0 * materials.c1[:, 0], 6.0 * materials.c1[:, 2]
    # materials next to ballooning at 240 kPa are left out, which favours the stiffer ones: not
    # below the published value less its standard error, and within its standard deviation
    assert 1.73 - 0.15 / np.sqrt(3.0) < np.median(fresh) < 1.73 + 0.15
    assert np.median(degraded) == pytest.approx(9.5, abs=0.2)
    c1, c2, _ = materials.constants(np.linspace(0.0, 25.0, 26))
    assert np.all(np.diff(c1, axis=1) > 0.0)
    assert np.all(c2[:, [0, -1]] < 0.0)
    assert np.all(c2[:, -1] < c2[:, 0])


def test_stiffness_grows_by_five_to_nine_percent_a_point(study, few):
    middle = np.median(study.published.sensitivity(few[0]), axis=0)
    assert np.all((middle > 4.7) & (middle < 9.0))


def test_growth_is_what_a_stiffer_material_does(study, few):
    materials, curves = few
    level = np.array([10.0])
    plain = materials.inputs(level, study.published.PRESSURES)
    stiffer = replace(plain, c1=1.03 * plain.c1, c2=1.03 * plain.c2, c3=1.03 * plain.c3)
    # the paper's share of the stiffness is the only thing that does not grow along
    stiffer = replace(stiffer, paper_stiffness=1.03 * plain.paper_stiffness)
    exact = default_surrogate()(stiffer).curvature[:, 0]
    linear = np.exp(curves.log_curvature[:, 10] - curves.growth[:, 10] * np.log(1.03))
    assert np.allclose(linear, exact, rtol=2e-3)


def test_unexplained_variance_counts_the_reading_at_zero_pressure(study):
    generator = np.random.default_rng(2)
    simulation = np.sort(generator.uniform(1.0, 30.0, 12))
    experiment = simulation * generator.normal(1.0, 0.1, 12)
    with_zero = (np.concatenate([[0.0], values]) for values in (experiment, simulation))
    got = study.agreement.unexplained(experiment, simulation)
    assert 1.0 - got == pytest.approx(r_squared(*with_zero))


@pytest.mark.parametrize(("side", "sign"), [(0, -1.0), (1, 1.0)])
def test_required_error_gives_the_published_r_squared(study, few, side, sign):
    materials, curves = few
    published, surrogate = study.published, default_surrogate()
    required = study.agreement.required_error(curves)
    one = single_material(materials, 7)
    for i, level in enumerate(published.LEVELS[1:], start=1):
        shifted = np.array([level, level + sign * required[7, i, side]])
        curvature = surrogate(one.inputs(shifted, published.PRESSURES)).curvature[0]
        simulation, experiment = np.concatenate([np.zeros((2, 1)), curvature], axis=1)
        # curves are interpolated between whole points of D_R
        lost = 1.0 - r_squared(experiment, simulation)
        assert lost == pytest.approx(1.0 - published.R_SQUARED[i], rel=0.06)


def test_less_degradation_than_none_is_impossible(study, few):
    assert np.all(np.isnan(study.agreement.required_error(few[1])[:, 0, 0]))


def test_degradation_error_alone_leaves_nothing_unexplained_when_fresh(study, few):
    model = study.agreement.Model(degradation=2.0, noise=0.0, floor=0.0)
    sample = study.agreement.fit(few[1], model, np.random.default_rng(1), inner=8).sample
    assert np.all(sample[..., 0] < -15.0)
    assert np.median(sample[..., 1:]) > -6.0


def test_reading_noise_alone_gives_the_expected_r_squared(study, few):
    curves = few[1]
    model = study.agreement.Model(noise=0.0, floor=0.1, noise_spread=0.0)
    fit = study.agreement.fit(curves, model, np.random.default_rng(1), inner=50)
    kappa = np.concatenate([np.zeros((len(curves), 6, 1)), curves.at_levels()], axis=-1)
    squares = 12.0 / 13.0 * fit.unknowns.floor[:, None] ** 2
    expected = squares / (kappa.var(axis=-1) + squares * (1.0 - 1.0 / 39.0))
    seen = fit.unknowns.floor > 0.02  # below, rounding in single precision shows
    ratio = np.exp(fit.sample[seen]).mean(axis=1) / expected[seen]
    assert np.allclose(ratio.mean(axis=0), 1.0, atol=0.01)


def test_a_pattern_of_degradation_errors_is_attributed_to_them(study, few, monkeypatch):
    target = np.log(1.0 - np.array([0.9995, 0.96, 0.96, 0.95, 0.96, 0.95]))
    monkeypatch.setattr(study.agreement, "TARGET", target)
    generator = np.random.default_rng(4)
    fits = {
        name: study.agreement.fit(few[1], model, generator, inner=32)
        for name, model in study.agreement.MODELS.items()
    }
    probability = {name: m["probability"] for name, m in study.script.compare(fits).items()}
    assert probability["D_R error"] > 0.6


def test_counts_are_binomial(study):
    rupture = study.rupture
    generator = np.random.default_rng(6)
    columns = (0.2, 0.7, 0.7, 0.5)
    demand = generator.uniform(0.3, 0.9, (4, 6))
    walls = rupture.Walls(
        {"principal_stretch": demand},
        generator.uniform(0.5, 1.5, (4, 6)),
        *(np.full((4, 1), value) for value in columns),
    )
    hypothesis = rupture.Hypothesis(concentration=True, flaws=True)
    limit, scatter = walls.limit.copy(), np.full((4, 6), 0.2)
    limit[:, 5] *= np.exp(-0.7)
    scatter[:, 5] = np.hypot(0.2, 0.5)
    burst = stats.norm.cdf(np.log(demand * np.exp(0.7) / limit) / scatter)
    expected = stats.binom.pmf([0, 0, 0, 0, 0, 2], 3, burst).prod(axis=1).mean()
    assert rupture.probability_of_counts(walls, hypothesis)[0] == pytest.approx(expected)


def test_principal_stretch_is_the_mildest_criterion(study, few):
    walls = study.rupture.draw_walls(default_surrogate(), few[0], np.random.default_rng(1))
    for criterion in ("cauchy_stress", "equivalent_strain"):
        assert np.all(walls.demand[criterion] >= walls.demand["principal_stretch"] - 1e-9)
    assert np.all(np.diff(walls.limit, axis=1) < 1e-12)


def test_margin_to_rupture_grows_with_degradation(study, few):
    walls = study.rupture.draw_walls(default_surrogate(), few[0], np.random.default_rng(1))
    factor = np.median(study.rupture.required_factor(walls), axis=0)
    assert factor[5] > 1.5 * factor[0]
    assert study.rupture.none_below(walls) < 0.01


def test_run_writes_a_page_that_stands_alone(quick_run):
    out, printed = quick_run
    page = (out / "index.html").read_text(encoding="utf-8")
    names = {path.name for path in out.iterdir()}
    assert names == {"answers.json", "index.html", "agreement.png", "rupture.png"}
    assert page.count("data:image/png;base64,") == 2
    assert "assumed geometry" in page
    assert "Hardly" in printed
    assert "No: " in printed


def test_probabilities_are_probabilities(answers):
    agreement, rupture = answers["agreement"], answers["rupture"]
    for models in agreement["variants"].values():
        shares = [m["probability"] for m in models.values()]
        assert sum(shares) == pytest.approx(1.0)
        assert all(0.0 <= share <= 1.0 for share in shares)
    assert all(0.0 <= h["probability"] <= 4.0 / 9.0 for h in rupture["hypotheses"].values())


def test_degradation_error_alone_is_improbable(answers):
    agreement = answers["agreement"]
    low, high = agreement["range"]
    assert low <= agreement["probability_degradation_error_alone"] <= high
    assert agreement["probability_degradation_error_alone"] < 0.1
    assert agreement["ordering"]["as_far_below"] < 0.01
    assert agreement["ordering"]["as_far_below"] <= agreement["ordering"]["fresh_below_5_pct"]


def test_errors_of_a_few_points_would_do_at_high_degradation(answers):
    needed = answers["agreement"]["required_degradation_error_points"]["median"][3:]
    assert all(1.5 < value < 6.0 for value in needed)
    assert needed == sorted(needed)


def test_flaws_and_not_concentration_make_the_counts_probable(answers):
    rupture = answers["rupture"]
    assert max(rupture["probability_limit_alone"]) < 1e-4
    assert max(rupture["probability_with_concentration"]) < 1e-2
    assert min(rupture["probability_with_flaws"]) > 5.0 * max(
        rupture["probability_with_concentration"]
    )


def test_the_seed_decides_everything(study, tmp_path):
    effort = study.script.Effort(200, 100, 8, 1)
    first, second, other = (
        study.script.run(tmp_path / str(i), seed=seed, effort=effort)
        for i, seed in enumerate((1, 1, 2))
    )
    assert first == second
    assert first["agreement"]["models"] != other["agreement"]["models"]
    assert (tmp_path / "0" / "answers.json").read_bytes() == (
        tmp_path / "1" / "answers.json"
    ).read_bytes()
