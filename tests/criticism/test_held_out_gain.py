"""Held-out groups: predictive densities against exact ones of normal laws; folds."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bayesdeg.criticism.fit.trials import base_trial, settled, try_causes
from bayesdeg.criticism.holdout import held_out as module
from bayesdeg.criticism.holdout.held_out import (
    DRAWS,
    HeldOut,
    by_level,
    difference,
    group_levels,
    joined,
    run_folds,
    standard_error,
)
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import approximate
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.priors import LogNormal, Normal, TruncatedNormal, with_priors
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import tight_model, with_known_scatter
from tests.criticism.straight_subject import (
    LEVEL,
    SPECIMEN,
    linear_cause,
    predict_folds,
    predict_one_by_one,
)
from tests.inference.small_study import TRUTH, altered, draws_near_truth, small_model, values_of

SPECIMENS = tuple("abcdef")


LEVELS = np.repeat([0, 1, 2], 2)


@given(st.permutations([0.0, 0.0, 5.0, 5.0, 12.0, 13.0]))
def test_folds_by_level_leave_out_all_specimens_of_a_level(order):
    subject = straight.subject_of(straight.readings(1))
    places = replace(subject.places, level=np.repeat(order, straight.POINTS))
    fold = by_level(straight.reading(subject, read_at=places))
    for i in range(6):
        for j in range(6):
            # rates within 2 % of each other are one level
            assert (fold[i] == fold[j]) == (abs(order[i] - order[j]) <= 2.0)


def test_levels_of_groups_are_those_of_their_readings():
    subject = straight.subject_of(straight.readings(1))
    assert group_levels(subject).tolist() == [0.0, 0.0, 10.0, 10.0, 20.0, 20.0]
    assert by_level(subject).tolist() == LEVELS.tolist()


def trial_of(observed, *causes):
    trial = straight.fitted(straight.subject_of(observed))
    for cause in causes:
        trial = try_causes(trial, cause, np.zeros(1), np.random.default_rng(1))
    return trial


def one_by_one(observed, *causes, **options):
    return predict_one_by_one(
        trial_of(observed, *causes), seed=np.random.SeedSequence(3), **options
    )


def in_folds(observed, *causes, fold=LEVELS, **options):
    trial = trial_of(observed, *causes)
    return predict_folds(trial, fold, seed=np.random.SeedSequence(3), **options)


def exact_held_out(observed, *causes, fold=None):
    """Each specimen given all specimens of other folds, with parameters integrated out."""
    fold = np.arange(len(SPECIMENS)) if fold is None else fold
    found = []
    for name, own_fold in zip(SPECIMENS, fold, strict=True):
        others = [s for s, k in zip(SPECIMENS, fold, strict=True) if k == own_fold and s != name]
        rows = ~np.isin(SPECIMEN, others)
        law = straight.joint_of(*causes, rows=rows)
        own = np.isin(SPECIMEN, [name])[rows]
        found.append(straight.conditional(law, observed[rows], own))
    return np.array(found)


@pytest.mark.parametrize("names", [(), ("wave",)])
def test_densities_of_specimens_one_by_one_are_exact(names):
    observed = straight.readings(2, wave=0.1)
    causes = [linear_cause(name) for name in names]
    found, exact = one_by_one(observed, *causes), exact_held_out(observed, *causes)
    np.testing.assert_allclose(found.log_density, exact, atol=0.25)
    assert np.sum(found.log_density) == pytest.approx(np.sum(exact), abs=0.5)


@pytest.mark.parametrize("names", [(), ("wave",)])
def test_densities_of_specimens_in_folds_are_exact(names):
    observed = straight.readings(2, wave=0.1)
    causes = [linear_cause(name) for name in names]
    found, exact = in_folds(observed, *causes), exact_held_out(observed, *causes, fold=LEVELS)
    np.testing.assert_allclose(found.log_density, exact, atol=0.25)
    assert np.sum(found.log_density) == pytest.approx(np.sum(exact), abs=0.5)


def outlying(observed):
    """One specimen so far off that draws which know it say nothing of what is without it."""
    return observed + np.where(np.isin(SPECIMEN, ["f"]), 1.5 * straight.X, 0.0)


def test_a_specimen_that_carries_the_fit_is_left_out_in_earnest():
    observed = outlying(straight.readings(3))
    plan = module.one_by_one(trial_of(observed), np.random.SeedSequence(3))
    assert 5 in np.concatenate(plan.parts)
    found, exact = one_by_one(observed), exact_held_out(observed)
    assert exact[5] < exact[:5].min() - 100.0
    # a ratio of evidences: no draw of the others' posterior comes near it
    assert found.log_density[5] == pytest.approx(exact[5], abs=0.25)
    np.testing.assert_allclose(found.log_density[:5], exact[:5], atol=0.25)


def test_held_out_densities_of_a_settled_trial_are_closer_to_the_exact_ones():
    observed = outlying(straight.readings(3))
    trial = settled(trial_of(observed, linear_cause("wave")), np.random.default_rng(4))
    exact = exact_held_out(observed, linear_cause("wave"))
    for seed in range(3):
        found = predict_one_by_one(trial, seed=np.random.SeedSequence(seed))
        np.testing.assert_allclose(found.log_density, exact, atol=0.08)


def test_each_of_few_specimens_is_left_out_in_earnest(monkeypatch):
    def never(*args):
        raise AssertionError("weights of draws that know the specimen")

    monkeypatch.setattr(module, "smoothed", never)
    observed = straight.readings(8)
    subject = straight.subject_of(observed).only(np.array([0, 2, 4]))
    found = predict_one_by_one(straight.fitted(subject), seed=np.random.SeedSequence(3))
    rows = np.isin(SPECIMEN, subject.groups)
    law = straight.joint_of(rows=rows)
    exact = [
        straight.conditional(law, observed[rows], np.isin(SPECIMEN[rows], [name]))
        for name in subject.groups
    ]
    np.testing.assert_allclose(found.log_density, exact, atol=0.25)


def test_the_gain_of_a_planted_cause_is_exact_and_positive():
    observed, cause = straight.readings(3, wave=0.1), linear_cause("wave")
    gain, error = difference(one_by_one(observed, cause), one_by_one(observed))
    gaps = exact_held_out(observed, cause) - exact_held_out(observed)
    assert gain == pytest.approx(gaps.sum(), abs=0.6)
    assert error == pytest.approx(np.sqrt(6.0) * np.std(gaps, ddof=1), rel=0.2)
    assert gain > error


@pytest.mark.parametrize("predict", [one_by_one, in_folds])
def test_predictive_draws_have_the_exact_mean_and_spread(predict):
    observed = straight.readings(4)
    found = predict(observed)
    assert found.draws.shape == (DRAWS, len(observed))
    groups = list(SPECIMENS) if predict is one_by_one else [0.0, 10.0, 20.0]
    for group in groups:
        own = np.isin(SPECIMEN if predict is one_by_one else LEVEL, [group])
        mean, covariance = straight.joint_of(rows=~own).posterior(observed[~own])
        law = straight.joint_of(rows=own)
        spread = np.sqrt(np.diag(law.scatter + law.shapes @ covariance @ law.shapes.T))
        z = (found.mean[own] - law.shapes @ mean) / spread
        # 150 effective draws or more
        assert np.max(np.abs(z)) < 4.0 / np.sqrt(150), group
        np.testing.assert_allclose(found.draws[:, own].std(axis=0), spread, rtol=0.2)


def test_readings_that_are_never_held_out_are_not_predicted():
    observed = straight.readings(5)
    never = np.isin(SPECIMEN, ["f"])
    subject = straight.subject_of(observed)
    subject = straight.reading(subject, group=np.where(never, "", SPECIMEN))
    trial = straight.fitted(subject)
    for found in (
        predict_one_by_one(trial, seed=np.random.SeedSequence(4)),
        predict_folds(trial, np.arange(5), seed=np.random.SeedSequence(4)),
    ):
        assert found.log_density.shape == (5,)
        assert np.all(np.isnan(found.draws[:, never]))
        assert np.all(np.isnan(found.mean[never]))
        assert np.all(np.isfinite(found.draws[:, ~never]))
        # they take part in every calibration all the same
        np.testing.assert_allclose(found.log_density, exact_held_out(observed)[:5], atol=0.25)


def test_a_posterior_along_the_bound_of_a_prior_is_predicted():
    """An effect of the wrong sign: truncated at 0, its posterior is a strip along the bound."""
    cause = linear_cause("wave", law=TruncatedNormal(0.0, 0.3, 0.0, np.inf))
    observed = straight.readings(6, wave=-0.3)
    # with next to nothing of the effect left the prediction is nearly that without it
    np.testing.assert_allclose(
        one_by_one(observed, cause).log_density, exact_held_out(observed), atol=1.0
    )
    np.testing.assert_allclose(
        in_folds(observed, cause).log_density, exact_held_out(observed, fold=LEVELS), atol=1.0
    )


def test_workers_do_not_change_the_prediction():
    observed = outlying(straight.readings(7))
    for predict in (one_by_one, in_folds):
        alone = predict(observed)
        with ThreadPoolExecutor(2) as executor:
            together = predict(observed, executor=executor)
        np.testing.assert_array_equal(together.draws, alone.draws)
        np.testing.assert_array_equal(together.log_density, alone.log_density)


def test_plans_carried_out_together_give_what_each_gives_alone():
    observed = outlying(straight.readings(7))
    trials = trial_of(observed), trial_of(observed, linear_cause("wave"))
    plans = [module.one_by_one(trial, np.random.SeedSequence(3)) for trial in trials]
    done = []
    with ThreadPoolExecutor(2) as executor:
        together = run_folds(plans, executor, done.append)
    assert done == [0, 1]
    for trial, found in zip(trials, together, strict=True):
        alone = predict_one_by_one(trial, seed=np.random.SeedSequence(3))
        np.testing.assert_array_equal(found.log_density, alone.log_density)
        np.testing.assert_array_equal(found.draws, alone.draws)


def test_one_group_has_no_standard_error():
    one = HeldOut(np.array([1.0]), np.zeros((1, 1)))
    gain, error = difference(one, one)
    assert gain == 0.0
    assert np.isnan(error)
    assert standard_error(np.array([1.0, 3.0])) == pytest.approx(2.0)


def test_the_mean_of_draws_leaves_out_those_without_an_answer():
    draws = np.array([[1.0, np.nan, np.nan], [3.0, 5.0, np.nan]])
    np.testing.assert_array_equal(HeldOut(np.zeros(1), draws).mean, [2.0, 5.0, np.nan])


def base_of(model, start, seed=0):
    subject, generator = model, np.random.default_rng(seed)
    laplace = approximate(subject, generator, start=start)
    return base_trial(subject, laplace.mode, about_mode(subject, laplace, generator))


@pytest.fixture(scope="module")
def actuators():
    """Six like specimens with every data set but their readings known from the truth."""
    model = with_known_scatter(altered(tight_model(with_angle=True), breaks=None))
    model = model.with_observations(
        *data_of_actuators(
            model.data_of(Curvature).tests.with_readings(
                model.data_of(Curvature).drawn(model.tests(values_of()), np.random.default_rng(2))[
                    0
                ]
            ),
            model.base,
        )
    )
    start = draws_near_truth(model, 1, spread=0.0)[0]
    return model, start, in_thirds(model, start)


def in_thirds(model, start):
    return predict_folds(
        base_of(model, start), np.array([0, 1, 0, 1, 0, 1]), seed=np.random.SeedSequence(3)
    )


def test_held_out_actuators_of_a_true_model_are_predicted(actuators):
    model, _, found = actuators
    subject = model
    rows = subject.group != ""
    assert found.draws.shape == (DRAWS, len(subject.places))
    assert np.all(np.isnan(found.draws[:, ~rows]))
    z = (subject.observed - found.mean)[rows] / found.draws[:, rows].std(axis=0)
    assert 0.5 < np.sqrt(np.mean(z**2)) < 2.0
    assert np.all(np.isfinite(found.log_density))


def test_bend_angles_of_a_specimen_change_its_own_score(actuators):
    """By 30 %, beside the same curvatures; others of its fold are predicted as before."""
    model, start, before = actuators
    readings = model.data_of(Curvature).tests.readings.copy()
    readings[0, model.data_of(Curvature).tests.mask.shape[1] :] *= 1.3
    after = in_thirds(
        model.with_observations(
            *data_of_actuators(model.data_of(Curvature).tests.with_readings(readings), model.base)
        ),
        start,
    )
    assert after.log_density[0] < before.log_density[0] - 5.0
    # neither calibration knows them: what differs is Monte Carlo error
    np.testing.assert_allclose(after.log_density[[2, 4]], before.log_density[[2, 4]], atol=1.0)


def test_modes_of_tension_are_held_out_where_there_are_no_actuators():
    """Constants are known so well that each left-out mode is predicted at the truth's own."""
    model = altered(small_model(), actuator=None, forward=None, breaks=None, statistics=())
    known = {
        name: Normal(TRUTH[name], 1e-3) if "ratio" in name else LogNormal(TRUTH[name], 1e-3)
        for name in model.table.names
        if name.startswith(("c1_", "c2_", "c3_"))
    }
    model = with_known_scatter(altered(model, base=with_priors(model.base, known)))
    start = model.table.vectors(values_of())[0]
    trial = base_of(model, start)
    subject = trial.subject
    at_truth = subject.group_density(start[None])[0]
    law, spread = subject.expected(start[None])[0], np.sqrt(np.diag(subject.scatter(start)))
    for found in (
        predict_one_by_one(trial, seed=np.random.SeedSequence(6)),
        predict_folds(trial, np.arange(3), seed=np.random.SeedSequence(6)),
    ):
        np.testing.assert_allclose(found.log_density, at_truth, atol=0.5)
        assert np.all(np.isfinite(found.draws))
        # draws are skewed a little by the specimens' ln stiffness
        assert np.max(np.abs(found.mean - law) / spread) < 5.0 / np.sqrt(150)


def gains(*values):
    return HeldOut(np.array(values), np.zeros((1, 0)))


def test_the_error_of_a_gain_over_several_kinds_is_that_of_the_sums_over_each():
    """Films that gain nothing do not make the gain of actuators uncertain."""
    actuators, films = gains(10.0, 11.0, 12.0, 11.0), gains(0.0, 0.1, 0.0, -0.1, 0.0)
    gain, error = difference(joined(actuators, films), joined(gains(*4 * [0.0]), gains(*5 * [0.0])))
    assert gain == pytest.approx(44.0)
    own = [difference(one, gains(*np.zeros(len(one.log_density)))) for one in (actuators, films)]
    assert error == pytest.approx(np.hypot(own[0][1], own[1][1]))
    pooled = gains(*actuators.log_density, *films.log_density)
    assert error < 0.2 * difference(pooled, gains(*9 * [0.0]))[1]


@pytest.mark.parametrize(("single", "agrees"), [(9.0, True), (1.5, False)])
def test_a_single_mean_counts_as_much_as_it_is_contradicted(single, agrees):
    """It has no spread of its own: its gain is as uncertain as that of one normal reading."""
    specimens, mean = gains(0.5, -0.5), gains(single)
    gain, error = difference(joined(specimens, mean), joined(gains(0.0, 0.0), gains(0.0)))
    assert error == pytest.approx(np.hypot(1.0, np.sqrt(2.0 * single)))
    assert (gain > error) is agrees


@pytest.mark.parametrize("shift", [0.5, 3.0, 8.0])
def test_a_single_gain_scatters_as_that_of_a_normal_reading(shift):
    """The log ratio of two normal densities, where the shifted one is right."""
    readings = stats.norm(shift).rvs(200_000, random_state=np.random.default_rng(3))
    gain = stats.norm(shift).logpdf(readings) - stats.norm().logpdf(readings)
    _, error = difference(
        joined(gains(0.0, 0.0), gains(np.mean(gain))), joined(gains(0.0, 0.0), gains(0.0))
    )
    assert error == pytest.approx(np.std(gain), rel=0.01)
