import html
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

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.observations.curvature import actuator_parameters
from bayesdeg.surrogate.trained import default_surrogate

STUDIES = Path(__file__).resolve().parents[2] / "studies"
PARTS = (
    "agreement",
    "aimed",
    "cause_agreement",
    "cause_rupture",
    "cause_words",
    "causes",
    "explored",
    "noise",
    "published",
    "rupture",
)
DEGRADED_ONLY = {
    *("degradation_misread", "degraded_skin", "delamination", "erosion", "paper_softening"),
    *("degradation_scale", "degraded_shrinkage"),
}
ACCOUNTING = {"dry_embrittlement", "flaw_embrittlement"}  # for the ruptures
OF_RUPTURE = {*ACCOUNTING, "uneven_degradation"}
NOT_RECORDED = {"batch_stiffness", "gravity", "hysteresis", "mullins", "temperature_softening"}
NOT_BENDING = {*OF_RUPTURE, *NOT_RECORDED, "stress_measure"}


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
def setting(study, few):
    rounds = ((150, 16), (150, 24), (190, 32))
    return study.explored.set_up(default_surrogate(), *few, np.random.default_rng(8), rounds=rounds)


@pytest.fixture(scope="module")
def shared(study, few):
    return study.cause_rupture.share(default_surrogate(), few[0], np.random.default_rng(7))


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


def fixed(cause, sizes, count):
    return {cause.qualified(name): np.full(count, value) for name, value in sizes.items()}


def neutral(cause, count):
    return fixed(cause, {p.name: p.neutral for p in cause.parameters}, count)


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


@pytest.mark.long
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


def test_the_widest_reading_error_is_the_prior_of_the_package(study):
    scales = {
        p.name: p.law.sd
        for p in actuator_parameters(240.0)
        if p.name.startswith("curvature_noise") and hasattr(p.law, "sd")
    }
    known = (scales["curvature_noise"], scales["curvature_noise_floor"])
    assert known == study.noise.OF_THE_PACKAGE == study.noise.NOISES[-1]


def test_the_page_begins_with_what_rests_on_the_reading_error(answers, quick_run):
    first = answers["reading_noise"]["answer"]
    page = html.unescape((quick_run[0] / "index.html").read_text(encoding="utf-8"))
    assert page.index(first) < page.index(answers["agreement"]["answer"])


def test_what_was_assumed_has_one_set_of_figures(study, answers):
    found = study.noise.at(answers["reading_noise"]["by_noise"], study.noise.ASSUMED)
    assert found["models"] == answers["agreement"]["models"]
    causes = answers["agreement_by_cause"]["causes"]
    assert found["causes"].keys() == causes.keys()
    for name, factors in found["causes"].items():
        assert factors.items() <= causes[name]["with_degradation_error"].items()


def test_with_the_packages_own_prior_of_reading_errors_no_cause_would_be_named(study, answers):
    by_noise = answers["reading_noise"]["by_noise"]
    assert [one["floor_per_m"] for one in by_noise] == sorted(f for _, f in study.noise.NOISES)
    assumed, package = (
        study.noise.at(by_noise, s) for s in (study.noise.ASSUMED, study.noise.OF_THE_PACKAGE)
    )
    alone = [one["models"]["D_R error"]["probability"] for one in (assumed, package)]
    # quick runs scatter: four of two seeds found 0.007 each, and 0.04, 0.04, 0.10 and 0.14
    assert alone[0] < 0.02 < alone[1]
    assert max(float(f["bayes_factor"]) for f in assumed["causes"].values()) > 50.0
    rest = {n: float(f["bayes_factor"]) for n, f in package["causes"].items()}
    error = {n: float(f["bayes_factor_error"]) for n, f in package["causes"].items()}
    # to be named takes 20; a quick run knows the largest of these within a half
    assert max(rest[n] - error[n] for n in rest) < 20.0
    # of a size that is nearly known, one cause keeps some of it
    assert rest.pop("degraded_shrinkage") > 1.0
    # with the many draws of a full run erosion has 6.6 ± 1.4
    assert max(rest[n] - error[n] for n in rest) < 6.0


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


@pytest.mark.long
def test_the_seed_decides_everything(study, tmp_path):
    effort = study.script.Effort(200, 100, 8, 1, ((80, 8), (80, 8), (80, 8)), 1)
    first, second, other = (
        study.script.run(tmp_path / str(i), seed=seed, effort=effort)
        for i, seed in enumerate((1, 1, 2))
    )
    assert first == second
    assert first["agreement"]["models"] != other["agreement"]["models"]
    assert (tmp_path / "0" / "answers.json").read_bytes() == (
        tmp_path / "1" / "answers.json"
    ).read_bytes()


@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - NOT_BENDING))
def test_a_cause_of_neutral_size_changes_no_reading(study, setting, name):
    cause = CATALOGUE[name]
    altered = study.explored.alter(setting, cause, neutral(cause, 20))
    assert altered.inside.all()
    assert np.allclose(altered.ratio, 1.0, atol=1e-6)
    assert not altered.shift.any()
    assert not altered.scatter.any()


@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - NOT_RECORDED - {"stress_measure"}))
def test_a_cause_of_neutral_size_changes_no_rupture(study, shared, name):
    cause = CATALOGUE[name]
    base = study.cause_rupture.burst(shared)
    values = neutral(cause, len(shared.materials))
    for criterion, bursts in study.cause_rupture.burst(shared, cause, values).items():
        assert np.allclose(bursts.probability, base[criterion].probability, rtol=1e-6)


def test_what_cannot_act_is_listed_with_the_reason(study, answers):
    causes = study.causes
    _, silent = causes.able(causes.cannot_bend)
    assert set(silent) == NOT_BENDING
    for part in ("agreement_by_cause", "rupture_by_cause"):
        answer = answers[part]
        assert set(answer["causes"]) | set(answer["cannot_act"]) == set(CATALOGUE)
        assert all(answer["cannot_act"].values())
        page_words = answer["answer"]
        assert not any(name in page_words for name in answer["cannot_act"])


def test_an_offset_is_met_as_a_lower_pressure(study, setting):
    cause, rows = CATALOGUE["pressure_offset"], np.arange(5)
    materials, levels = setting.materials.take(rows), study.published.LEVELS
    values = fixed(cause, {"offset": 14.0}, 5)
    read = study.causes.predict(
        setting.surrogate, materials, levels, cause=cause, values=values
    ).curvature
    pressure = study.published.PRESSURES - 14.0
    assert np.allclose(read, setting.surrogate(materials.inputs(levels, pressure)).curvature)


def test_creep_counts_what_was_held_before(study, setting):
    cause, rows = CATALOGUE["creep"], np.arange(5)
    materials, levels = setting.materials.take(rows), study.published.LEVELS[-1:]
    values = fixed(cause, {"amount": 0.1, "time_constant": 40.0}, 5)
    every = study.published.LEVELS
    read = study.causes.predict(setting.surrogate, materials, every, cause=cause, values=values)
    last = study.causes.predict(
        setting.surrogate, materials, every, cause=cause, values=values, read=study.causes.LAST
    )
    # twelve steps of 20 kPa, each right after the reading before, 30 s apart
    held = 30.0 * np.arange(12, 0, -1)
    pressure = 240.0 + 0.1 * np.sum(20.0 * (1.0 - np.exp(-held / 40.0)))
    direct = setting.surrogate(materials.inputs(levels, np.array([pressure])))
    assert np.allclose(read.curvature[:, -1, -1], direct.curvature[:, 0, 0])
    assert np.allclose(last.peak_stretch[:, -1, -1], direct.peak_stretch[:, 0, 0])


def test_what_cannot_be_simulated_explains_nothing(study, setting):
    cause = CATALOGUE["creep"]
    amounts = np.repeat([0.02, 0.9], 10)
    values = {"creep.amount": amounts, "creep.time_constant": np.full(20, 30.0)}
    altered = study.explored.alter(setting, cause, values)
    assert not altered.inside[10:].any()
    assert altered.inside[:10].any()
    curves = type(setting.curves)(setting.curves.log_curvature[:20], setting.curves.growth[:20])
    fit = study.agreement.fit(
        curves, study.agreement.Model(), np.random.default_rng(1), inner=4, altered=altered
    )
    assert np.all(np.isneginf(fit.log_likelihood[~altered.inside]))
    assert np.all(np.isfinite(fit.sample))


@pytest.mark.parametrize("name", sorted(DEGRADED_ONLY))
def test_what_does_not_act_at_zero_leaves_its_r_squared_as_noise_makes_it(study, setting, name):
    model = study.cause_agreement.BESIDE["alone"]
    outcome = study.explored.explore(
        setting, model, np.random.default_rng(2), CATALOGUE[name]
    ).prior
    noise = study.explored.explore(setting, model, np.random.default_rng(2)).prior
    assert np.array_equal(outcome.sample[..., 0], noise.sample[..., 0])
    assert not study.cause_agreement.changes_fresh(
        setting, CATALOGUE[name], np.random.default_rng(2)
    )
    found, base = (study.agreement.ordering(f.sample) for f in (outcome, noise))
    # a misfit more at 5 % can only bring R² there nearer to that at 0 %, but for chance
    assert found["as_far_below"] <= base["as_far_below"] + 0.005


def test_what_acts_at_zero_is_found_by_computing(answers):
    causes = answers["agreement_by_cause"]["causes"]
    assert {name for name, c in causes.items() if not c["changes_fresh"]} == DEGRADED_ONLY


def test_a_planted_offset_is_told_from_what_does_not_act_when_fresh(study, setting, monkeypatch):
    cause, count = CATALOGUE["pressure_offset"], len(setting.curves)
    altered = study.explored.alter(setting, cause, fixed(cause, {"offset": 15.0}, count))
    simulated = setting.curves.at_levels()
    lost = study.agreement.unexplained(simulated * altered.ratio[:, :, 1], simulated)
    target = np.median(np.log(lost[altered.inside]), axis=0)
    monkeypatch.setattr(study.agreement, "TARGET", target)
    generator, model = np.random.default_rng(3), study.cause_agreement.BESIDE["alone"]
    found = {
        name: study.explored.explore(setting, model, generator, acting)
        for name, acting in (
            ("none", None),
            *((n, CATALOGUE[n]) for n in ("pressure_offset", "erosion", "paper_slack")),
        )
    }
    logs = {name: study.aimed.evidence(o.joint()).log_value for name, o in found.items()}
    # a leak or stiffer walls can't be told from it by R² alone, so they are not asked
    assert all(
        logs["pressure_offset"] > value + 6.0 for n, value in logs.items() if n != cause.name
    )
    size = 10.0 * found["pressure_offset"].scores.standard[:, -1]
    weight = np.exp(found["pressure_offset"].joint() - found["pressure_offset"].joint().max())
    assert np.average(np.abs(size), weights=weight) == pytest.approx(15.0, abs=4.0)


def test_aimed_draws_give_the_evidence_of_a_narrow_likelihood(study):
    aimed, generator = study.aimed, np.random.default_rng(5)
    sd, at = np.array([0.05, 0.2, 1.0]), np.array([2.2, -1.5, 0.3])

    def log_likelihood(scores):
        return stats.norm.logpdf(scores.standard, at, sd).sum(axis=1)

    scores = aimed.from_prior(generator, 1500, 3)
    for _ in range(3):
        scores = aimed.aimed(generator, scores, [log_likelihood(scores)], 1500)
    found = aimed.evidence(scores.log_weight + log_likelihood(scores))
    exact = stats.norm.logpdf(at, 0.0, np.hypot(1.0, sd)).sum()
    assert found.error < 0.1
    assert found.log_value == pytest.approx(exact, abs=4.0 * found.error)
    assert np.mean(np.exp(scores.log_weight)) == pytest.approx(1.0, abs=0.1)


def test_a_wider_prior_keeps_its_bounds(study):
    cause = study.causes.widened(CATALOGUE["erosion"], 2.0)
    scores = np.array([[-5.0, 0.0], [0.0, 0.0], [5.0, 0.0]])
    values = study.causes.values_at(cause, scores)["erosion.lost_share"]
    assert cause.parameters[0].law.sd == 2.0 * CATALOGUE["erosion"].parameters[0].law.sd
    assert 0.0 <= values[0] < values[1] < values[2] <= 0.2


def test_ruptures_without_a_cause_are_those_of_the_limit_alone(study, shared):
    materials, levels = shared.materials, study.published.LEVELS
    stretch = shared.surrogate(materials.inputs(levels, np.array([240.0]))).peak_stretch[..., 0]
    limit = np.exp(shared.log_limit)[:, [0, 2]]
    bursts = study.cause_rupture.burst(shared)["principal_stretch"].probability
    for column, level in enumerate((0, 5)):
        ratio = (stretch[:, level] - 1.0) / limit[:, column]
        expected = stats.norm.cdf(np.log(ratio) / shared.scatter[:, 0])
        assert np.allclose(bursts[:, level], expected, rtol=1e-6, atol=1e-300)


def test_weights_of_the_scatter_restore_its_prior(study, shared):
    rupture = study.rupture
    assert shared.weight.mean() == pytest.approx(1.0, abs=0.1)
    mean = np.average(shared.scatter[:, 0], weights=shared.weight)
    assert mean == pytest.approx(rupture.SCATTER * np.sqrt(2.0 / np.pi), rel=0.12)


def test_flaws_cut_the_limit_at_25_percent_alone(study, shared):
    cause, count = CATALOGUE["flaw_embrittlement"], len(shared.materials)
    values = fixed(cause, {"cut": 1.5, "widening": 0.3, "onset": 20.0}, count)
    base = study.cause_rupture.burst(shared)["principal_stretch"]
    flawed = study.cause_rupture.burst(shared, cause, values)["principal_stretch"]
    # they begin by degrees: at 20 % there are 8 % of them
    assert np.allclose(flawed.probability[:, :4], base.probability[:, :4], atol=1e-4)
    assert flawed.probability[:, 5].mean() > 10.0 * base.probability[:, 5].mean()
    assert study.cause_rupture.compare(shared, flawed, base)["bayes_factor"] > 1000.0


def test_of_all_causes_flaws_and_dry_air_account_for_the_ruptures(study, answers):
    """A most degraded place helps, but by far too little."""
    causes, enough = answers["rupture_by_cause"]["causes"], study.cause_words.ACCOUNTS
    for name, cause in causes.items():
        for criterion in cause["criteria"].values():
            assert 0.0 <= criterion["probability"] <= 4.0 / 9.0
            assert (criterion["probability"] > enough) == (name in ACCOUNTING)
            assert criterion["bayes_factor"] < 1000.0 or name in OF_RUPTURE
            assert criterion["bayes_factor"] > 1000.0 or name not in ACCOUNTING
    assert not causes["curvature_reading"]["changes_bursts"]
    assert "the counts" in answers["rupture_by_cause"]["answer"]


def test_shares_outside_are_reported_and_not_left_out(answers):
    for part in ("agreement_by_cause", "rupture_by_cause"):
        creep = answers[part]["causes"]["creep"]
        found = creep["alone"] if "alone" in creep else creep["criteria"]["principal_stretch"]
        assert 0.02 < found["share_outside"] < 0.8
    for cause in answers["agreement_by_cause"]["causes"].values():
        beside = cause["alone"]
        expected = beside["bayes_factor"] / (1.0 - beside["share_outside"])
        assert beside["bayes_factor_inside"] == pytest.approx(expected)


def test_erosion_gains_where_it_acts_and_not_when_fresh(answers):
    erosion = answers["agreement_by_cause"]["causes"]["erosion"]["with_degradation_error"]
    assert erosion["bayes_factor"] > 10.0
    assert erosion["bayes_factor_of_fresh"] < 0.1 * erosion["bayes_factor"]
