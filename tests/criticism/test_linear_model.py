"""The linear model of readings: held against closed forms and against importance sampling."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import multivariate_normal

from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.fit.linear import (
    Linear,
    effects,
    linearise,
    log_bayes_factor,
    neutral_sizes,
    prior_size,
    rest_law,
    sensitivities,
    with_neutral,
)
from bayesdeg.criticism.fit.screening import screen
from bayesdeg.inference.laplace import approximate, evidence
from bayesdeg.observations.curvature import CURVATURE, Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.priors import LogNormal, Normal, Parameter, TruncatedNormal, with_priors
from bayesdeg.surrogate.trained import default_surrogate
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import (
    known_linear,
    scaling_cause,
    with_known_scatter,
    with_readings,
)
from tests.inference.small_study import TRUTH, altered, draws_near_truth, small_model, values_of

moderate = st.floats(-3.0, 3.0)


DRAWS = 100_000
FEWEST = 50.0  # effective draws of an evidence that others are held against


def sampled_evidence(model, start, generator, *, draws=DRAWS):
    """Log evidence by importance sampling, good enough to hold others against."""
    found = evidence(model, approximate(model, generator, start=start), generator, draws=draws)
    assert found.effective > FEWEST
    return found.log_evidence


@pytest.fixture(scope="module")
def calibrated():
    """Model, mode and log evidence of the small study; the linear model holds scatter fixed."""
    model = with_known_scatter(small_model())
    generator = np.random.default_rng(3)
    start = draws_near_truth(model, 1, spread=0.0)[0]
    mode = approximate(model, generator, start=start).mode
    return model, mode, sampled_evidence(model, mode, generator)


@pytest.fixture(scope="module")
def linear(calibrated):
    return linearise(calibrated[0], calibrated[1])


@pytest.mark.parametrize("with_angle", [False, True])
def test_whitened_data_are_standard_normal_under_the_model(with_angle):
    known = known_linear(with_angle=with_angle)
    generator = np.random.default_rng(1)
    points = len(known.mean)
    readings = known.mean + generator.standard_normal((4000, points)) @ known.factor.T
    z = known.whiten(readings)
    assert np.max(np.abs(np.cov(z.T) - np.eye(points))) < 0.12
    assert np.max(np.abs(z.mean(axis=0))) < 0.08


@pytest.mark.parametrize("with_angle", [False, True])
def test_columns_are_whitened_as_readings_are(with_angle):
    known = known_linear(with_angle=with_angle)
    change = np.random.default_rng(2).standard_normal(len(known.mean))
    both = known.whiten(np.stack([known.mean, known.mean + change]))
    np.testing.assert_allclose(known.whiten_columns(change), both[1] - both[0], atol=1e-9)


def with_known_material(model):
    """Constants as well known from elsewhere as good films leave them."""
    laws = {
        name: Normal(TRUTH[name], 0.05) if "ratio" in name else LogNormal(TRUTH[name], 0.1)
        for name in model.table.names
        if name.startswith(("c1_", "c2_", "c3_"))
    }
    return altered(model, base=with_priors(model.base, laws))


def test_the_density_of_the_readings_is_a_ratio_of_evidences():
    """p(readings | all else) = Z/Z', both by importance sampling, which knows no linearisation."""
    model = with_known_material(with_known_scatter(small_model()))
    generator = np.random.default_rng(3)
    start = draws_near_truth(model, 1, spread=0.0)[0]
    mode = approximate(model, generator, start=start).mode
    whole = sampled_evidence(model, mode, generator, draws=20_000)
    rest = altered(model, actuator=None, tensile=None)
    without = sampled_evidence(rest, mode, np.random.default_rng(5), draws=20_000)
    linear = linearise(model, mode)
    density = multivariate_normal(linear.mean, linear.factor @ linear.factor.T)
    assert density.logpdf(linear.subject.observed) == pytest.approx(whole - without, abs=1.0)


@pytest.mark.parametrize("names", [(), ("offset",), ("offset", "wave")])
def test_the_density_of_straight_readings_is_their_exact_evidence(names):
    observed = straight.readings(3, offset=0.2)
    causes = [cause for cause in straight.CAUSES if cause.name in names]
    linear = straight.exact_linear(observed, *causes)
    density = multivariate_normal(linear.mean, linear.factor @ linear.factor.T)
    exact = straight.joint_of(*causes).log_evidence(observed)
    assert density.logpdf(observed) == pytest.approx(exact, abs=1e-6)


def test_the_mode_of_the_linear_model_is_near_the_mode(linear):
    """Not at it: errors that grow with what is predicted pull at the mode too."""
    total = linear.factor @ linear.factor.T
    spread = total - linear.scatter
    # f + X (δ₀ + Λ⁻¹ Xᵀ (V + X Λ⁻¹ Xᵀ)⁻¹ (y − mean)) is what is predicted with all data
    fitted = linear.mean + spread @ np.linalg.solve(total, linear.subject.observed - linear.mean)
    uncertain = np.sqrt(np.diag(spread - spread @ np.linalg.solve(total, spread)))
    assert np.max(np.abs(fitted - linear.prediction) / uncertain) < 0.7
    # and it is not for want of anything to fit
    assert np.max(np.abs(linear.mean - linear.prediction)) > 0.1


def test_a_conflict_with_the_films_is_no_larger_where_readings_are_exact():
    """The base model gives way in its scatter, and what it leaves is what that scatter allows."""
    model, cause = small_model(), find("film_mismatch")
    careful = {"curvature_noise": 0.005, "curvature_noise_floor": 0.03}
    careful |= {"bend_angle_noise": 0.005, "bend_angle_noise_floor": 0.08}
    hidden = values_of() | {
        name: np.array([size])
        for name, size in {**careful, "film_mismatch.log_ratio": -0.15}.items()
    }
    softer = (
        model.extended(cause)
        .data_of(Curvature)
        .drawn(model.extended(cause).tests(hidden), np.random.default_rng(4))[0]
    )
    read = model.with_observations(
        *data_of_actuators(model.data_of(Curvature).tests.with_readings(softer), model.base)
    )
    start = model.table.vectors({name: hidden[name] for name in model.table.names})[0]
    mode = approximate(read, np.random.default_rng(0), start=start).mode
    linear = linearise(read, mode)
    assert 0.6 < np.mean(linear.observed**2) < 1.2


def test_the_mean_of_a_straight_model_is_what_the_prior_predicts():
    observed = straight.readings(4)
    linear, law = straight.exact_linear(observed), straight.joint_of()
    np.testing.assert_allclose(linear.mean, law.shapes @ law.mean, atol=1e-6)
    np.testing.assert_allclose(linear.factor @ linear.factor.T, law.covariance, atol=1e-7)
    np.testing.assert_allclose(linear.scatter, law.scatter, atol=1e-12)


@pytest.mark.parametrize("point", [(1.0, 0.0), (3.0, -2.0)])
def test_a_straight_model_is_the_same_wherever_it_is_linearised(point):
    """Given what all but the readings says of the parameters."""
    observed, law = straight.readings(4), straight.joint_of()
    subject, uncertain = straight.subject_of(observed), np.diag(law.sd**2)
    found = linearise(subject, np.array(point), uncertain=uncertain, centre=law.mean)
    np.testing.assert_allclose(found.prediction, law.shapes @ point, atol=1e-9)
    at_mode = straight.exact_linear(observed)
    np.testing.assert_allclose(found.observed, at_mode.observed, atol=1e-5)
    np.testing.assert_allclose(found.mean, law.shapes @ law.mean, atol=1e-6)


def test_what_is_known_from_all_else_is_the_prior_where_there_is_nothing_else():
    subject = straight.subject_of(straight.readings(5))
    mean, found = rest_law(subject, np.array([1.0, 0.0]))
    sd = np.array([sd for _, sd, _ in straight.BASE.values()])
    # 1000 draws or so
    assert np.all(np.abs(mean - straight.joint_of().mean) < 0.15 * sd)
    np.testing.assert_allclose(np.sqrt(np.diag(found)), sd, rtol=0.1)
    assert abs(found[0, 1]) < 0.1 * sd[0] * sd[1]


def test_unexplained_is_what_a_refit_leaves_of_straight_readings():
    observed = straight.readings(6, wave=0.1)
    linear, law = straight.exact_linear(observed), straight.joint_of()
    refitted = law.shapes @ law.posterior(observed)[0]
    np.testing.assert_allclose(linear.unexplained(linear.observed), observed - refitted, atol=1e-7)
    several = np.stack([linear.observed, 2.0 * linear.observed])
    np.testing.assert_allclose(
        linear.unexplained(several)[1], 2.0 * (observed - refitted), atol=1e-7
    )


def test_data_simulated_by_a_straight_model_are_straight():
    linear = straight.exact_linear(straight.readings(8))
    vectors = linear.mode + np.random.default_rng(9).standard_normal((5, 2))
    simulated = linear.subject.simulated(vectors, np.random.default_rng(10))
    found = linear.straightened(vectors, simulated)
    np.testing.assert_allclose(found, simulated, atol=1e-9)
    np.testing.assert_allclose(linear.jacobian, straight.joint_of().shapes, atol=1e-9)


def test_straightened_data_keep_their_errors_about_a_linear_mean(linear):
    vectors = linear.mode + 0.3 * np.random.default_rng(9).standard_normal((4, len(linear.mode)))
    mean = linear.subject.expected(vectors)
    errors = np.random.default_rng(10).standard_normal(mean.shape)
    errors[2, 0] = np.nan
    found = linear.straightened(vectors, mean + errors)
    moved = linear.prediction + (vectors - linear.mode) @ linear.jacobian.T
    np.testing.assert_allclose(found, moved + errors, atol=1e-9)
    # so large a step is not straight by itself
    assert np.max(np.abs(mean - moved)) > 0.1


def test_effects_are_changes_of_the_whitened_mean():
    """Through the full equations: curvatures scaled by 1 + φ at each of several sizes."""
    known, cause = known_linear(), scaling_cause()
    sizes = np.array([[-0.3], [0.0], [0.05], [2.0]])
    changed = known.whiten((1.0 + sizes) * known.prediction) - known.whiten(known.prediction)
    np.testing.assert_allclose(effects(known, cause, sizes), changed, atol=1e-9)


def refusing(readings, conditions, effect):
    return np.where(effect["size"] > 0.5, np.nan, readings + effect["size"])


def test_effects_that_the_model_refuses_are_nan():
    cause = straight.cause_of("refused", {"size": Normal(0.0, 0.3)}, refusing)
    linear = straight.exact_linear(straight.readings(7))
    found = effects(linear, cause, np.array([[0.2], [0.6]]))
    expected = linear.whiten_columns(np.full(len(linear.mean), 0.2))
    np.testing.assert_allclose(found[0], expected, atol=1e-9)
    assert np.all(np.isnan(found[1]))


def test_neutral_sizes_have_no_effect():
    for cause in (scaling_cause(), find("pressure_loss"), find("degradation_misread")):
        found = effects(known_linear(), cause, neutral_sizes(cause)[None])
        assert found.shape == (1, len(known_linear().mean))
        assert not np.any(found)


@settings(max_examples=40, deadline=None)
@given(z=arrays(float, 5, elements=moderate), s=arrays(float, (5, 2), elements=moderate))
def test_bayes_factor_is_that_of_two_normal_laws(z, s):
    wide = multivariate_normal(np.zeros(5), np.eye(5) + s @ s.T).logpdf(z)
    narrow = multivariate_normal(np.zeros(5), np.eye(5)).logpdf(z)
    assert float(log_bayes_factor(z, s)) == pytest.approx(wide - narrow, abs=1e-8)


def test_bayes_factors_of_a_batch_are_those_of_its_rows():
    generator = np.random.default_rng(4)
    z, s = generator.standard_normal((3, 4, 6)), generator.standard_normal((6, 2))
    batch = log_bayes_factor(z, s)
    assert batch.shape == (3, 4)
    for index in np.ndindex(3, 4):
        assert batch[index] == pytest.approx(float(log_bayes_factor(z[index], s)))


def test_bayes_factor_of_no_effect_is_even():
    z = np.array([1.0, -2.0])
    assert float(log_bayes_factor(z, np.zeros((2, 1)))) == 0.0


def test_expected_bayes_factor_without_an_effect_is_one():
    z = np.random.default_rng(6).standard_normal((200_000, 3))
    factor = np.exp(log_bayes_factor(z, np.array([[0.4], [0.2], [-0.3]])))
    assert factor.mean() == pytest.approx(1.0, abs=0.01)


def test_an_effect_of_known_size_is_found_again():
    known, cause = known_linear(), scaling_cause()
    planted = with_readings(known, 1.07 * known.mean)
    assert screen(planted, cause).size[0] == pytest.approx(0.07, abs=0.01)


def test_sensitivity_is_the_change_of_the_mean_by_one_prior_sd():
    known, cause = known_linear(), scaling_cause(sd=0.1)
    size = prior_size(cause.parameters[0])
    expected = known.whiten_columns(size * known.mean)
    np.testing.assert_allclose(sensitivities(known, cause)[:, 0], expected, rtol=1e-9)


def both_scaled(prediction, conditions, effect):
    """Curvature and bend angle by the same factor: the actuator itself bends more."""
    factor = 1.0 + effect["size"]
    return replace(
        prediction,
        curvature=factor * prediction.curvature,
        bend_angle=factor * prediction.bend_angle,
    )


def test_an_effect_on_the_curvature_alone_leaves_the_bend_angle():
    known = known_linear(with_angle=True)
    own, of_both = scaling_cause(sd=0.1), scaling_cause(sd=0.1, on_reading=both_scaled)
    size = prior_size(own.parameters[0])
    curvature = np.where(known.subject.places.kind == CURVATURE, known.mean, 0.0)
    for cause, change in ((own, curvature), (of_both, known.mean)):
        expected = known.whiten_columns(size * change)
        np.testing.assert_allclose(sensitivities(known, cause)[:, 0], expected, rtol=1e-9)


def test_the_bend_angle_tells_an_error_of_the_curvature_from_an_effect_on_the_actuator():
    """Curvature alone cannot."""
    causes = scaling_cause("reading"), scaling_cause("actuator", on_reading=both_scaled)
    alone = known_linear()
    same = (sensitivities(alone, cause) for cause in causes)
    np.testing.assert_allclose(*same, rtol=1e-9)
    known = known_linear(with_angle=True)
    reading, actuator = (sensitivities(known, cause) for cause in causes)
    more = 1.0 + 0.1 * np.where(known.subject.places.kind == CURVATURE, 1.0, 0.0)
    misread = with_readings(known, more * known.mean).observed
    bent = with_readings(known, 1.1 * known.mean).observed
    assert log_bayes_factor(misread, reading) > log_bayes_factor(misread, actuator) + np.log(20.0)
    assert log_bayes_factor(bent, actuator) > log_bayes_factor(bent, reading) + np.log(20.0)


def test_what_only_widens_a_scatter_has_no_sensitivity():
    columns = sensitivities(known_linear(), find("degradation_misread"))
    assert np.any(columns[:, 0] != 0.0)
    assert not np.any(columns[:, 1])


def test_linear_bayes_factor_is_near_the_ratio_of_evidences(calibrated, linear):
    """Of a small effect on readings without it: the causes are nearly linear there."""
    model, mode, whole = calibrated
    cause = scaling_cause(sd=0.02)
    start = with_neutral(mode, model, model.extended(cause))
    exact = sampled_evidence(model.extended(cause), start, np.random.default_rng(8)) - whole
    fast = float(log_bayes_factor(linear.observed, sensitivities(linear, cause)))
    assert fast == pytest.approx(exact, abs=0.3)


def test_prior_size_counts_from_the_neutral_value():
    off_centre = Parameter("x", Normal(3.0, 4.0), "–", "of a test", 0.0)
    half = Parameter("x", TruncatedNormal(0.0, 2.0, 0.0, np.inf), "–", "of a test", 0.0)
    assert prior_size(off_centre) == pytest.approx(5.0, rel=1e-2)
    assert prior_size(half) == pytest.approx(2.0, rel=1e-2)


def test_neutral_vector_keeps_the_base_and_predicts_the_same():
    model = altered(small_model(), forward=default_surrogate())
    vector = draws_near_truth(model, 1)[0]
    cause = find("pressure_offset")
    extended = model.extended(cause)
    longer = with_neutral(vector, model, extended)
    assert longer.shape == (len(vector) + 1,)
    np.testing.assert_array_equal(
        extended.data_of(Curvature)
        .predicted(extended.tests(extended.table.named(longer[None])))
        .prediction.curvature,
        model.data_of(Curvature)
        .predicted(model.tests(model.table.named(vector[None])))
        .prediction.curvature,
    )


def test_a_linear_model_is_frozen_and_keeps_its_subject(linear):
    assert isinstance(linear, Linear)
    assert linear.factor.shape == (len(linear.mean), len(linear.mean))
    assert np.all(np.diag(linear.factor) > 0.0)
