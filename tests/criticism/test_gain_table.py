"""Scores of held-out groups: CRPS against closed forms, and the table by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from bayesdeg.criticism.holdout.gain import crps, gain_table, mode_table
from bayesdeg.criticism.holdout.held_out import HeldOut, difference
from bayesdeg.observations.curvature import CURVATURE, Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.tensile import Tensile
from tests.criticism.linear_case import tight_model
from tests.inference.small_study import altered, small_model, values_of

COLUMNS = ["model", "degradation_pct", "elpd", "elpd_se", "elpd_diff", "elpd_diff_se"]
COLUMNS += ["rmse_per_m", "crps_per_m", "r_squared", "coverage_50", "coverage_90"]


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


def subject_of(readings, *, with_angle=False):
    """Six actuators with these readings (6, n), and films that are never held out."""
    model = tight_model(with_angle=with_angle)
    return model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(readings), model.base)
    )


def made_up(log_density, mean, subject, sd=0.1, seed=1):
    """Draws about a mean of the readings that are held out, (n_held_out,)."""
    held = subject.group != ""
    noise = np.random.default_rng(seed).standard_normal((4000, int(held.sum())))
    draws = np.full((4000, len(held)), np.nan)
    draws[:, held] = mean + sd * (noise - noise.mean(axis=0))
    return HeldOut(np.asarray(log_density), draws)


def test_table_of_scores_by_hand():
    mean = (
        tight_model()
        .data_of(Curvature)
        .predicted(tight_model().tests(values_of()))
        .prediction.curvature[0]
    )
    subject = subject_of(mean)
    base = made_up([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], mean.ravel() + 0.3, subject)
    better = made_up([2.0, 2.0, 5.0, 5.0, 8.0, 8.0], mean.ravel(), subject)
    table = gain_table(subject, {"base": base, "base+x": better})
    assert list(table.columns) == COLUMNS
    table = table.set_index(["model", "degradation_pct"])
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


def test_a_specimen_that_neither_model_answers_leaves_the_gain_unknown():
    lost = HeldOut(np.array([-1.0, -np.inf]), np.zeros((3, 2)))
    assert np.all(np.isnan(difference(lost, lost)))
    gained, error = difference(HeldOut(np.array([-1.0, -2.0]), np.zeros((3, 2))), lost)
    assert gained == np.inf
    assert np.isnan(error)


def test_coverage_counts_readings_inside_the_interval():
    shape = tight_model().data_of(Curvature).tests.mask.shape
    inside = np.where(np.arange(shape[1]) < 2, 0.0, 5.0)  # 2 of 8 readings of each specimen
    subject = subject_of(np.broadcast_to(inside, shape) + 10.0)
    table = gain_table(subject, {"base": made_up(np.zeros(6), 10.0, subject, sd=1.0)})
    every = table.set_index("degradation_pct").loc["all"]
    assert every["coverage_50"] == pytest.approx(0.25)
    assert every["coverage_90"] == pytest.approx(0.25)


def test_bend_angles_are_in_the_density_and_not_in_the_errors_of_curvatures():
    model = tight_model(with_angle=True)
    mean = model.data_of(Curvature).predicted(model.tests(values_of())).mean[0]
    subject = subject_of(mean, with_angle=True)
    held = subject.group != ""
    off = np.where(subject.places.kind[held] == CURVATURE, 0.2, 50.0)
    table = gain_table(
        subject, {"base": made_up(np.ones(6), subject.observed[held] + off, subject)}
    )
    every = table.set_index("degradation_pct").loc["all"]
    assert every["rmse_per_m"] == pytest.approx(0.2)
    assert every["elpd"] == 6.0


def test_gaps_in_a_curve_are_not_scored():
    subject = small_model()
    held = subject.group != ""
    exact = made_up(np.zeros(5), subject.observed[held], subject, sd=0.0)
    table = gain_table(subject, {"base": exact}).set_index("degradation_pct")
    assert table.loc["all", "rmse_per_m"] == pytest.approx(0.0, abs=1e-12)


def test_stresses_of_films_alone_are_scored_in_their_own_unit():
    """By mode of tension, of which there are no levels of degradation to tell apart."""
    model = altered(small_model(), actuator=None, forward=None)
    tensile = replace(model.data_of(Tensile).tests, degradation=np.zeros(4))
    subject = altered(model, tensile=tensile)
    found = made_up([1.0, 2.0, 3.0], subject.observed + 0.05, subject, sd=0.01)
    table = gain_table(subject, {"base": found})
    assert set(table.columns) == {*COLUMNS, "rmse_MPa", "crps_MPa"}
    assert table["degradation_pct"].tolist() == ["0", "all"]
    for name in table.columns.drop("degradation_pct"):  # of one level, which is all
        assert table[name].iloc[0] == pytest.approx(table[name].iloc[1], nan_ok=True)
    row = table.iloc[0]
    assert row["rmse_MPa"] == pytest.approx(0.05)
    assert row["elpd"] == pytest.approx(6.0)
    assert np.isnan(row["rmse_per_m"])
    assert np.isnan(row["crps_per_m"])


def test_modes_of_tension_are_scored_one_by_one():
    model = altered(small_model(), actuator=None, forward=None)
    subject = altered(model, tensile=replace(model.data_of(Tensile).tests, degradation=np.zeros(4)))
    assert subject.holds_out_modes
    modes = np.array(subject.groups)
    off = np.select([subject.group == mode for mode in modes], [0.1, 0.2, 0.3])
    base = made_up([1.0, 2.0, 3.0], subject.observed + 0.5, subject, sd=0.01)
    found = made_up([4.0, 4.0, 4.0], subject.observed + off, subject, sd=0.01)
    table = mode_table(subject, {"base": base, "base+x": found}).set_index(["model", "mode"])
    assert table.loc["base+x", "rmse_MPa"].tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert table.loc["base", "rmse_MPa"].tolist() == pytest.approx([0.5, 0.5, 0.5])
    assert table.loc["base+x", "elpd_diff"].tolist() == [3.0, 2.0, 1.0]
    assert not [name for name in table.columns if name.endswith(("per_m", "_se"))]


def test_actuators_are_not_held_out_by_mode():
    assert not small_model().holds_out_modes
