from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from bayesdeg.criticism.gain import (
    DRAWS,
    HeldOut,
    crps,
    difference,
    folds,
    gain_table,
    predict_held_out,
)
from tests.criticism.linear_case import tight_model, with_known_scatter
from tests.inference.small_study import draws_near_truth, small_model, values_of


def normal_crps(mean, sd, y):
    """Gneiting and Raftery (2007), Eq. 21, with the sign turned."""
    z = (y - mean) / sd
    return sd * (z * (2.0 * norm.cdf(z) - 1.0) + 2.0 * norm.pdf(z) - 1.0 / np.sqrt(np.pi))


@pytest.mark.parametrize("observed", [-4.0, 0.3, 1.0, 2.5])
def test_crps_of_a_normal_law(observed):
    quantiles = norm(1.0, 0.7).ppf((np.arange(4000) + 0.5) / 4000)
    score = float(crps(quantiles, np.array(observed)))
    assert score == pytest.approx(normal_crps(1.0, 0.7, observed), abs=2e-4)


@given(
    draws=st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=12), observed=st.floats(-50.0, 50.0)
)
def test_crps_by_its_definition_over_all_pairs(draws, observed):
    x = np.array(draws)
    pairs = np.abs(x[:, None] - x).mean()
    expected = np.abs(x - observed).mean() - 0.5 * pairs
    assert float(crps(x, np.array(observed))) == pytest.approx(expected, abs=1e-9)


@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_crps_of_a_point_is_the_absolute_error(x, y):
    assert float(crps(np.full(5, x), np.array(y))) == pytest.approx(abs(x - y), abs=1e-12)


def test_crps_of_many_readings_at_once():
    generator = np.random.default_rng(1)
    draws, observed = generator.standard_normal((30, 2, 3)), generator.standard_normal((2, 3))
    scores = crps(draws, observed)
    assert scores.shape == (2, 3)
    assert scores[1, 2] == pytest.approx(float(crps(draws[:, 1, 2], observed[1, 2])))


@given(st.lists(st.sampled_from([0.0, 5.0, 10.0, 15.0]), min_size=2, max_size=20))
def test_no_fold_leaves_out_two_specimens_of_a_level(levels):
    degradation = np.array(levels)
    fold = folds(degradation)
    assert set(fold) == set(range(fold.max() + 1))
    if len(set(levels)) < len(levels):
        for k in range(fold.max() + 1):
            left_out = degradation[fold == k]
            assert len(set(left_out)) == len(left_out)


def test_single_specimens_are_left_out_by_thirds():
    assert folds(np.array([0.0, 5.0, 10.0, 15.0])).tolist() == [0, 1, 2, 0]


def made_up(log_density, mean, model, sd=0.1, seed=1):
    noise = np.random.default_rng(seed).standard_normal((4000, *mean.shape))
    return HeldOut(np.asarray(log_density), mean + sd * noise, mean)


def test_table_of_scores_by_hand():
    model = tight_model()
    model = model.with_readings(model.curvature(values_of()).curvature[0])
    mean = model.actuator.curvature
    base = made_up([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], mean + 0.3, model)
    better = made_up([2.0, 2.0, 5.0, 5.0, 8.0, 8.0], mean, model)
    table = gain_table(model, {"base": base, "base+x": better}).set_index(
        ["model", "degradation_pct"]
    )
    assert list(table.loc["base"].index) == ["0", "10", "24", "all"]
    every = table.loc[("base+x", "all")]
    gaps = np.array([1.0, 0.0, 2.0, 1.0, 3.0, 2.0])
    assert every["elpd"] == pytest.approx(30.0)
    assert every["elpd_diff"] == pytest.approx(gaps.sum())
    assert every["elpd_diff_se"] == pytest.approx(np.sqrt(6.0 * np.var(gaps, ddof=1)))
    assert (every["elpd_diff"], every["elpd_diff_se"]) == difference(better, base)
    assert every["rmse_per_m"] == pytest.approx(0.0, abs=1e-12)
    assert every["r_squared"] == pytest.approx(1.0)
    assert every["crps_per_m"] == pytest.approx(normal_crps(0.0, 0.1, 0.0), rel=0.05)
    worse = table.loc[("base", "all")]
    assert worse["elpd_diff"] == 0.0
    assert worse["rmse_per_m"] == pytest.approx(0.3)
    assert worse["coverage_90"] == 0.0
    assert table.loc[("base+x", "10"), "elpd"] == pytest.approx(10.0)


def test_coverage_counts_readings_inside_the_interval():
    model = tight_model()
    shape = model.actuator.mask.shape
    inside = np.where(np.arange(shape[1]) < 2, 0.0, 5.0)  # 2 of 8 readings of each specimen
    model = model.with_readings(np.broadcast_to(inside, shape) + 10.0)
    held_out = made_up(np.zeros(6), np.full(shape, 10.0), model, sd=1.0)
    table = gain_table(model, {"base": held_out}).set_index("degradation_pct")
    assert table.loc["all", "coverage_50"] == pytest.approx(0.25)
    assert table.loc["all", "coverage_90"] == pytest.approx(0.25)


def test_one_specimen_has_no_standard_error():
    one = HeldOut(np.array([1.0]), np.zeros((1, 1, 1)), np.zeros((1, 1)))
    gain, error = difference(one, one)
    assert gain == 0.0
    assert np.isnan(error)


@pytest.fixture(scope="module")
def held_out():
    """Six like specimens with every data set but their curvature known from the truth."""
    model = with_known_scatter(replace(tight_model(), breaks=None))
    generator = np.random.default_rng(2)
    model = model.with_readings(model.simulate(values_of(), generator)[0])
    start = draws_near_truth(model, 1, spread=0.0)[0]
    return model, start, predict_held_out(model, start, seed=np.random.SeedSequence(3))


def test_held_out_specimens_of_a_true_model_are_predicted(held_out):
    model, _, result = held_out
    data = model.actuator
    assert result.draws.shape == (DRAWS, *data.mask.shape)
    spread = result.draws.std(axis=0)
    z = (data.curvature - result.mean) / spread
    assert np.sqrt(np.mean(z**2)) < 2.0
    assert np.all(np.isfinite(result.log_density))


def test_a_specimen_is_predicted_without_its_own_readings(held_out):
    """Another reading of one specimen changes its score, not its prediction."""
    model, start, before = held_out
    readings = model.actuator.curvature.copy()
    readings[0] *= 1.2
    after = predict_held_out(model.with_readings(readings), start, seed=np.random.SeedSequence(3))
    fold = folds(model.actuator.degradation[:, 0])
    same = fold == fold[0]
    np.testing.assert_array_equal(after.draws[:, same], before.draws[:, same])
    assert after.log_density[0] < before.log_density[0] - 1.0
    assert not np.array_equal(after.draws[:, ~same], before.draws[:, ~same])


def test_bend_angles_count_in_the_density_and_not_in_the_draws():
    """A bend angle that does not go with its curvature lowers the specimen's score."""
    model = with_known_scatter(replace(tight_model(with_angle=True), breaks=None))
    readings = model.simulate(values_of(), np.random.default_rng(2))[0]
    points = model.actuator.mask.shape[1]
    other = readings.copy()
    other[0, points:] *= 1.3
    start = draws_near_truth(model, 1, spread=0.0)[0]
    before, after = (
        predict_held_out(model.with_readings(r), start, seed=np.random.SeedSequence(3))
        for r in (readings, other)
    )
    assert before.draws.shape == (DRAWS, *model.actuator.mask.shape)
    assert after.log_density[0] < before.log_density[0] - 1.0
    np.testing.assert_array_equal(after.draws[:, 0], before.draws[:, 0])


def test_workers_do_not_change_the_prediction(held_out):
    model, start, alone = held_out
    done = []
    with ThreadPoolExecutor(2) as executor:
        together = predict_held_out(
            model,
            start,
            seed=np.random.SeedSequence(3),
            executor=executor,
            on_fold=lambda: done.append(1),
        )
    np.testing.assert_array_equal(together.draws, alone.draws)
    np.testing.assert_array_equal(together.log_density, alone.log_density)
    assert len(done) == folds(model.actuator.degradation[:, 0]).max() + 1


def test_gaps_in_a_curve_are_not_scored():
    model = small_model()
    mask = model.actuator.mask
    mean = np.where(mask, model.actuator.curvature, 1e6)
    held_out = HeldOut(np.zeros(5), np.broadcast_to(mean, (10, *mean.shape)).copy(), mean)
    table = gain_table(model, {"base": held_out}).set_index("degradation_pct")
    assert table.loc["all", "rmse_per_m"] == 0.0
