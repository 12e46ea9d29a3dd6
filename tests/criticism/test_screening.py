"""Screening: held against exact Bayes factors of normal laws and against quadrature."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from bayesdeg.causes.catalogue import find
from bayesdeg.criticism.fit.linear import columns_of, effects, neutral_sizes, with_neutral
from bayesdeg.criticism.fit.screening import screen
from bayesdeg.observations.curvature import Curvature
from bayesdeg.priors import Normal, TruncatedNormal
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import known_linear, scaling_cause, with_readings
from tests.criticism.straight_subject import SHAPES, X, cause_of, linear_cause
from tests.inference.small_study import altered

MONTE_CARLO = 0.1  # nats: about 1/√128, of a mean over as many draws


@pytest.mark.parametrize("size", [0.0, 0.05, -0.2, 0.6])
@pytest.mark.parametrize("name", ["offset", "wave", "lag"])
def test_log_bayes_factor_of_a_linear_cause_is_exact(name, size):
    observed = straight.readings(1, **{name: size})
    cause = linear_cause(name)
    found = screen(straight.exact_linear(observed), cause)
    assert found.log_bayes_factor == pytest.approx(
        straight.log_factor(observed, cause), abs=MONTE_CARLO
    )


@pytest.mark.parametrize("size", [0.5, -2.0])
def test_an_effect_of_many_prior_sds_is_screened_exactly(size):
    """With a prior sd of 0.02 hardly a draw from the prior comes near it."""
    cause = linear_cause("wave", law=Normal(0.0, 0.02))
    observed = straight.readings(2, wave=size)
    found = screen(straight.exact_linear(observed), cause)
    exact = straight.log_factor(observed, cause)
    assert exact > 50.0
    assert found.log_bayes_factor == pytest.approx(exact, abs=MONTE_CARLO)


def test_size_and_effect_are_those_of_the_posterior():
    observed = straight.readings(3, wave=0.3)
    cause = linear_cause("wave")
    linear = straight.exact_linear(observed)
    found = screen(linear, cause)
    mode = straight.joint_of(cause).posterior(observed)[0]
    np.testing.assert_allclose(found.size, mode[-1:], rtol=1e-4)
    np.testing.assert_allclose(found.effect, effects(linear, cause, found.size[None])[0])
    per_prior_size = linear.whiten_columns(0.3 * SHAPES["wave"])
    np.testing.assert_allclose(found.columns[:, 0], per_prior_size, rtol=1e-3)
    assert found.cause is cause


def test_a_cause_of_two_parameters_is_screened_exactly():
    shapes = {"size": SHAPES["offset"], "more": SHAPES["wave"]}
    laws = {"size": Normal(0.0, 0.3), "more": Normal(0.0, 0.2)}
    hook = straight.partial(straight.added, shapes=shapes)
    cause = cause_of("two", laws, hook)
    for planted in ({}, {"offset": 0.2}, {"offset": -0.3, "wave": 0.4}):
        observed = straight.readings(4, **planted)
        found = screen(straight.exact_linear(observed), cause)
        exact = straight.log_factor(observed, cause)
        assert found.log_bayes_factor == pytest.approx(exact, abs=MONTE_CARLO)
        mode = straight.joint_of(cause).posterior(observed)[0]
        np.testing.assert_allclose(found.size, mode[-2:], atol=1e-3)


def saturating(readings, conditions, effect):
    """Strongly nonlinear in its size, and of one sign."""
    return readings + 0.4 * (1.0 - np.exp(-np.abs(effect["size"]) * X))


def by_quadrature(observed, change, law):
    """ln of the exact mean of the likelihood ratio over the prior, of one additive effect."""
    joint = straight.joint_of()
    normal = multivariate_normal(joint.shapes @ joint.mean, joint.covariance)
    sizes = np.asarray(law.quantile((np.arange(20_000) + 0.5) / 20_000))
    densities = normal.logpdf(observed - change(sizes[:, None])) - normal.logpdf(observed)
    return logsumexp(densities) - np.log(len(sizes))


@pytest.mark.parametrize(
    ("law", "size"),
    [
        (TruncatedNormal(0.0, 2.0, 0.0, np.inf), 0.0),
        (TruncatedNormal(0.0, 2.0, 0.0, np.inf), 1.0),
        (TruncatedNormal(0.0, 2.0, 0.0, np.inf), 4.0),
        (Normal(0.0, 1.0), 2.0),  # two modes, of either sign
    ],
)
def test_a_nonlinear_cause_is_screened_as_by_quadrature(law, size):
    cause = cause_of("saturating", {"size": law}, saturating)
    planted = saturating(straight.readings(5), None, {"size": size})
    found = screen(straight.exact_linear(planted), cause)
    exact = by_quadrature(planted, lambda s: saturating(0.0, None, {"size": s}), law)
    # the two signs of the last are one mode only to the draws about it: those from the prior see
    # both
    assert found.log_bayes_factor == pytest.approx(exact, abs=2.0 * MONTE_CARLO)


def test_an_effect_of_the_wrong_sign_is_screened_as_by_quadrature():
    """Its most probable size is outside its prior."""
    law = TruncatedNormal(0.0, 0.3, 0.0, np.inf)
    cause = linear_cause("wave", law=law)
    observed = straight.readings(6, wave=-0.05)
    found = screen(straight.exact_linear(observed), cause)
    exact = by_quadrature(observed, lambda s: s * SHAPES["wave"], law)
    assert found.size[0] < 0.0
    # few draws are near the bound, where all the likelihood is
    assert found.log_bayes_factor == pytest.approx(exact, abs=0.5)


def widened(observed, law):
    """ln of the mean, over the prior of an additional error, of the exact likelihood ratio."""

    def log_ratio(extra):
        wide = straight.joint_of(extra=extra).log_evidence(observed)
        return wide - straight.joint_of().log_evidence(observed)

    def weighted(extra):
        return float(np.exp(law.log_density(extra) + log_ratio(extra) - shift))

    shift = max(log_ratio(e) for e in np.linspace(0.0, 0.3, 50))
    return shift + np.log(quad(weighted, 0.0, 0.8, limit=200)[0])


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.15])
def test_a_cause_that_only_widens_the_errors_is_screened_as_by_quadrature(noise):
    law = TruncatedNormal(0.0, 0.1, 0.0, np.inf)
    cause = cause_of("noise", {"extra": law}, straight.untouched)
    observed = straight.readings(7) + noise * np.random.default_rng(8).standard_normal(len(X))
    found = screen(straight.exact_linear(observed), cause)
    exact = widened(observed, law)
    # nine sizes stand for the prior, whose upper tail is then missing
    assert found.log_bayes_factor == pytest.approx(exact, abs=0.5)
    assert not np.any(found.effect)
    assert (exact > np.log(20.0)) == (noise > 0.1)


def widened_and_shifted(observed, law, cause):
    """As `widened`, of an error beside a linear effect, which is integrated out exactly."""
    extra = np.asarray(law.quantile((np.arange(400) + 0.5) / 400))
    ratios = [straight.joint_of(cause, extra=e).log_evidence(observed) for e in extra]
    return logsumexp(ratios) - np.log(len(extra)) - straight.joint_of().log_evidence(observed)


@pytest.mark.parametrize(("size", "sd"), [(0.2, 0.3), (0.6, 0.1)])
def test_an_effect_that_also_widens_the_errors_is_screened_as_by_quadrature(size, sd):
    """Of a usual size, and of six prior sds, where the prior pulls harder the wider errors are."""
    law = TruncatedNormal(0.0, 0.3, 0.0, np.inf)
    shift = linear_cause("wave", law=Normal(0.0, sd))
    hook = straight.partial(straight.added, shapes={"size": SHAPES["wave"]})
    both = cause_of("noise", {"size": Normal(0.0, sd), "extra": law}, hook)
    more = 0.4 * np.random.default_rng(8).standard_normal(len(X))
    observed = straight.readings(7, wave=size) + more
    found = screen(straight.exact_linear(observed), both)
    exact = widened_and_shifted(observed, law, shift)
    # nine sizes stand for the prior of the errors
    assert found.log_bayes_factor == pytest.approx(exact, abs=0.6)


def test_scatter_of_misread_degradation_is_screened_as_by_quadrature():
    """Of the catalogue's own cause: specimens of a level that differ more than they may."""
    known, cause = known_linear(), find("degradation_misread")
    data = known.subject.data_of(Curvature).tests
    shift = np.array([0.0, 0.0, 2.5, -2.5, -3.0, 3.0])
    off = replace(data, degradation=data.degradation + shift[:, None])
    moved = altered(known.subject, actuator=off)
    readings = (
        moved.data_of(Curvature).predicted(moved.tests(moved.table.named(known.mode[None]))).mean[0]
    )
    case = with_readings(known, readings)
    found = screen(case, cause)
    assert found.log_bayes_factor > np.log(20.0)
    assert found.log_bayes_factor == pytest.approx(scatter_by_quadrature(case, cause), abs=0.5)


def scatter_by_quadrature(linear, cause):
    """Mean of the likelihood ratio over shift and scatter on a fine grid of the prior."""
    extended = linear.subject.extended(cause)
    where = columns_of(extended, cause)
    point = with_neutral(linear.mode, linear.subject, extended)
    shares = (np.arange(60) + 0.5) / 60
    shift, scatter = (p.law for p in cause.parameters)
    sizes = np.stack([shift.quantile((np.arange(400) + 0.5) / 400), np.zeros(400)], axis=1)
    residuals = linear.subject.observed - linear.mean
    changes = effects(linear, cause, sizes) @ linear.factor.T
    base = linear.factor @ linear.factor.T
    none = multivariate_normal(np.zeros(len(residuals)), base).logpdf(residuals)
    total = []
    for share in shares:
        point[where] = [0.0, float(scatter.quantile(share))]
        wide = base + extended.scatter(point) - linear.subject.scatter(linear.mode)
        law = multivariate_normal(np.zeros(len(residuals)), wide, allow_singular=False)
        total.append(logsumexp(law.logpdf(residuals - changes) - none) - np.log(len(sizes)))
    return logsumexp(total) - np.log(len(shares))


def test_screening_draws_the_same_each_time():
    linear = straight.exact_linear(straight.readings(12, wave=0.1))
    one, two = (screen(linear, linear_cause("wave")) for _ in range(2))
    assert one.log_bayes_factor == two.log_bayes_factor
    np.testing.assert_array_equal(one.size, two.size)


def refusing(readings, conditions, effect):
    """An effect whose upper half of sizes the forward map refuses."""
    size = np.where(effect["size"] > 0.25, np.nan, effect["size"])
    return readings + size * SHAPES["wave"]


def test_sizes_that_the_model_refuses_count_as_impossible():
    law = Normal(0.0, 0.3)
    cause = cause_of("refused", {"size": law}, refusing)
    observed = straight.readings(13, wave=0.2)
    found = screen(straight.exact_linear(observed), cause)
    sizes = np.asarray(law.quantile((np.arange(20_000) + 0.5) / 20_000))
    allowed = sizes[sizes <= 0.25]
    joint = straight.joint_of()
    normal = multivariate_normal(joint.shapes @ joint.mean, joint.covariance)
    ratios = normal.logpdf(observed - allowed[:, None] * SHAPES["wave"]) - normal.logpdf(observed)
    exact = logsumexp(ratios) - np.log(len(sizes))
    assert found.log_bayes_factor == pytest.approx(exact, abs=MONTE_CARLO)


def test_an_actuators_cause_at_a_strong_size_is_screened_at_that_size():
    """Curvatures scaled by 1.5 where the prior has 0.1: linear, so that the size is known."""
    known, cause = known_linear(), scaling_cause(sd=0.1)
    found = screen(with_readings(known, 1.5 * known.mean), cause)
    unit = known.whiten_columns(known.prediction)
    exact = 0.5 * (unit @ unit) / (unit @ unit + 100.0)
    np.testing.assert_allclose(found.size, [exact], rtol=1e-3)
    assert neutral_sizes(cause).tolist() == [0.0]
