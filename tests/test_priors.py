"""Prior laws: against scipy.stats, by round trip, by numerical derivative, by their draws."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, stats

from bayesdeg.priors import (
    LAWS,
    Choice,
    Distribution,
    HalfCauchy,
    HalfNormal,
    LogNormal,
    Normal,
    Parameter,
    ParameterTable,
    StudentT,
    TruncatedNormal,
    Uniform,
    law_from_mapping,
)

INF = math.inf

PAIRS = [
    (Normal(0.62, 0.07), stats.norm(0.62, 0.07)),
    (LogNormal(0.288, 0.35), stats.lognorm(0.35, scale=0.288)),
    (HalfNormal(1.7), stats.halfnorm(scale=1.7)),
    (HalfCauchy(0.4), stats.halfcauchy(scale=0.4)),
    (Uniform(-2.0, 5.0), stats.uniform(-2.0, 7.0)),
    (StudentT(1.0, 0.5, 5.0), stats.t(5.0, loc=1.0, scale=0.5 * math.sqrt(3.0 / 5.0))),
    (TruncatedNormal(0.0, 0.6, 0.0), stats.truncnorm(0.0, INF, scale=0.6)),
    (TruncatedNormal(1.0, 2.0, -1.0, 1.5), stats.truncnorm(-1.0, 0.25, loc=1.0, scale=2.0)),
    (TruncatedNormal(0.0, 1.0, 4.0, INF), stats.truncnorm(4.0, INF)),
    (TruncatedNormal(0.0, 1.0, -INF, -3.0), stats.truncnorm(-INF, -3.0)),
    (Choice(1.0, 0.0), stats.truncnorm(-10.0, 10.0, loc=1.0, scale=1e-6)),
]
LAW_LIST = [law for law, _ in PAIRS]
each_pair = pytest.mark.parametrize(("law", "reference"), PAIRS, ids=lambda item: repr(item)[:45])
each_law = pytest.mark.parametrize("law", LAW_LIST, ids=repr)


@each_pair
def test_density_equals_that_of_scipy(law, reference):
    x = np.concatenate([reference.ppf(np.linspace(0.001, 0.999, 41)), np.linspace(-9, 9, 37)])
    np.testing.assert_allclose(law.log_density(x), reference.logpdf(x), rtol=1e-11, atol=1e-11)


@each_pair
def test_quantile_equals_that_of_scipy(law, reference):
    u = np.linspace(1e-6, 1.0 - 1e-6, 101).reshape(1, 101)
    np.testing.assert_allclose(law.quantile(u), reference.ppf(u), rtol=1e-9, atol=1e-10)


@each_pair
def test_support_equals_that_of_scipy(law, reference):
    assert law.support == pytest.approx(reference.support())
    np.testing.assert_allclose(law.quantile([0.0, 1.0]), law.support, rtol=1e-12, atol=1e-12)


@each_pair
def test_draws_follow_the_law(law, reference):
    draws = law.sample(np.random.default_rng(20211124), 4000)
    assert stats.kstest(draws, reference.cdf).pvalue > 0.01


@each_law
def test_draws_are_reproducible_and_shaped(law):
    draws = law.sample(np.random.default_rng(1), (3, 4))
    assert draws.shape == (3, 4)
    np.testing.assert_array_equal(draws, law.sample(np.random.default_rng(1), (3, 4)))
    assert np.shape(law.sample(np.random.default_rng(1))) == ()


@each_law
@given(x=st.floats(allow_nan=False, allow_infinity=False))
def test_density_is_never_nan_and_vanishes_outside(law, x):
    density = float(law.log_density(x))
    low, high = law.support
    assert not math.isnan(density)
    assert density < INF
    if not low <= x <= high:
        assert density == -INF


@each_law
@given(u=st.floats(1e-6, 1.0 - 1e-6))
def test_transform_round_trip(law, u):
    x = float(law.quantile(u))
    z = law.to_unconstrained(x)
    assert float(law.from_unconstrained(z)) == pytest.approx(x, rel=1e-10, abs=1e-12)


@each_law
@given(z=st.floats(-8.0, 8.0))
def test_jacobian_is_the_derivative_of_the_transform(law, z):
    step = 1e-5
    slope = (law.from_unconstrained(z + step) - law.from_unconstrained(z - step)) / (2.0 * step)
    assert float(law.log_jacobian(z)) == pytest.approx(math.log(abs(slope)), abs=1e-5)


@each_law
@given(z=st.floats(-1e300, 1e300))
def test_transform_never_leaves_the_support(law, z):
    if isinstance(law, TruncatedNormal | Choice):
        assert law.from_unconstrained(z) == z
    else:
        low, high = law.support
        assert low <= law.from_unconstrained(z) <= high


@each_law
def test_density_on_the_unconstrained_scale_integrates_to_one(law):
    def density(z):
        return math.exp(float(law.log_density(law.from_unconstrained(z)) + law.log_jacobian(z)))

    if isinstance(law, TruncatedNormal | Choice):
        low, high = np.clip(law.support, -12.0, 12.0)
    else:
        low, high = -40.0, 40.0
    median = float(law.to_unconstrained(law.quantile(0.5)))
    total = integrate.quad(density, low, median)[0] + integrate.quad(density, median, high)[0]
    assert total == pytest.approx(1.0, abs=1e-5)


@each_law
def test_untruncated_density_agrees_inside(law):
    x = law.quantile(np.linspace(0.01, 0.99, 21))
    np.testing.assert_array_equal(law.untruncated_log_density(x), law.log_density(x))


def test_untruncated_density_is_smooth_over_the_bound():
    law = TruncatedNormal(0.2, 0.5, 0.0)
    step = 1e-4
    left, middle, right = (float(law.untruncated_log_density(x)) for x in (-step, 0.0, step))
    assert (right - left) / (2.0 * step) == pytest.approx(0.2 / 0.25, rel=1e-6)
    assert (right - 2.0 * middle + left) / step**2 == pytest.approx(-4.0, rel=1e-4)
    assert float(law.log_density(-step)) == -INF


def test_a_choice_has_its_state_and_without_its_cause_the_neutral_value():
    table = ParameterTable((Parameter("exchanged", Choice(1.0, 0.0), neutral=0.0),))
    drawn = table.named(table.sample(np.random.default_rng(1), 100))["exchanged"]
    assert (drawn == 1.0).all()
    assert table.named(np.zeros((1, 1)))["exchanged"] == 0.0
    with pytest.raises(ValueError, match="either 0 or 1"):
        Parameter("exchanged", Choice(1.0, 0.0), neutral=0.5)


def test_student_sd_is_the_standard_deviation():
    law = StudentT(3.0, 0.7, 6.0)
    draws = law.sample(np.random.default_rng(4), 200_000)
    assert np.std(draws) == pytest.approx(0.7, rel=0.02)


def test_far_tail_truncation_keeps_its_mass():
    law = TruncatedNormal(0.0, 1.0, 20.0)
    x = law.quantile([0.1, 0.5, 0.9])
    np.testing.assert_allclose(x, stats.truncnorm(20.0, INF).ppf([0.1, 0.5, 0.9]), rtol=1e-9)
    assert float(law.log_density(20.0)) == pytest.approx(
        float(stats.norm.logpdf(20.0) - stats.norm.logsf(20.0)), rel=1e-9
    )


@pytest.mark.parametrize(
    ("law", "arguments"),
    [
        (Normal, (0.0, 0.0)),
        (Normal, (math.nan, 1.0)),
        (Normal, (0.0, -1.0)),
        (LogNormal, (0.0, 1.0)),
        (LogNormal, (1.0, INF)),
        (HalfNormal, (-1.0,)),
        (HalfCauchy, (0.0,)),
        (Uniform, (1.0, 1.0)),
        (Uniform, (-INF, 1.0)),
        (StudentT, (0.0, 1.0, 2.0)),
        (StudentT, (0.0, 1.0, math.nan)),
        (TruncatedNormal, (0.0, 1.0, 2.0, 1.0)),
        (TruncatedNormal, (0.0, 1.0, math.nan, 1.0)),
        (TruncatedNormal, (0.0, 1.0, INF, INF)),
    ],
)
def test_impossible_arguments_are_refused(law, arguments):
    with pytest.raises(ValueError, match=r"must|probability"):
        law(*arguments)


EXAMPLES = {
    "normal": {"mean": 0.62, "sd": 0.07},
    "lognormal": {"median": 2, "sigma": 0.5},
    "half_normal": {"sd": 1.0},
    "uniform": {"low": 0.0, "high": 1.0},
    "student_t": {"mean": 0.0, "sd": 1.0, "dof": 4.0},
    "truncated_normal": {"mean": 0.0, "sd": 1.0, "low": 0.0, "high": INF},
    "half_cauchy": {"scale": 1.0},
}


@pytest.mark.parametrize("name", LAWS)
def test_every_law_can_be_named(name):
    law = law_from_mapping({"law": name} | EXAMPLES[name])
    assert law == LAWS[name](**EXAMPLES[name])
    assert isinstance(law, Distribution)


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"mean": 1.0}, "'law' is missing"),
        ({"law": "norml", "mean": 0.0, "sd": 1.0}, "'normal'"),
        ({"law": 3}, "unknown law 3"),
        ({"law": "normal", "mean": 0.0}, "needs key 'sd'"),
        ({"law": "normal", "mean": 0.0, "sdd": 1.0}, "'sdd'; .*'sd'"),
        ({"law": "normal", "mean": 0.0, "sd": "x"}, "sd must be"),
        ({"law": "normal", "mean": 0.0, "sd": True}, "sd must be"),
        ({"law": "normal", "mean": math.nan, "sd": 1.0}, "mean must"),
        ({"law": "normal", "mean": 0.0, "sd": 0}, "sd must be positive"),
        ({"law": "uniform", "low": 2.0, "high": 1.0}, "low must"),
    ],
)
def test_faulty_mappings_are_explained(mapping, message):
    with pytest.raises(ValueError, match=message):
        law_from_mapping(mapping)


def test_neutral_value_may_lie_on_the_bound():
    law = TruncatedNormal(0.0, 0.5, 0.0)
    assert Parameter("skin_stiffening", law, "–", "surface over mean", 0.0).neutral == 0.0


@pytest.mark.parametrize(("name", "neutral"), [("x", -1.0), ("x", math.nan), (" ", None)])
def test_faulty_parameters_are_refused(name, neutral):
    with pytest.raises(ValueError, match=r"neutral|name"):
        Parameter(name, HalfNormal(1.0), "–", "", neutral)
