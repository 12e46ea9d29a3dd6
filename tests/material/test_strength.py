"""Elongation limit and its scatter: against scipy.stats, weakest links, common parameters."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bayesdeg.material.strength import (
    GUMBEL,
    SCATTER_LAWS,
    draw_scores,
    limit_stretch,
    log_broken,
    log_broken_between,
    log_survival,
    log_whole,
    rupture_probability,
    score_density,
    weibull_modulus,
)

MEDIAN, SCATTER = 3.1, 0.12
STRETCHES = np.linspace(1.0, 5.0, 41)


def reference(law, median, scatter):
    elongation = median - 1.0
    if law == "lognormal":
        return stats.lognorm(scatter, loc=1.0, scale=elongation)
    modulus = math.pi / (math.sqrt(6.0) * scatter)
    return stats.weibull_min(modulus, loc=1.0, scale=elongation / math.log(2.0) ** (1.0 / modulus))


@pytest.mark.parametrize("law", SCATTER_LAWS)
def test_survival_equals_that_of_scipy(law):
    expected = reference(law, MEDIAN, SCATTER)
    np.testing.assert_allclose(
        log_survival(STRETCHES, MEDIAN, SCATTER, law),
        expected.logsf(STRETCHES),
        rtol=1e-10,
        atol=1e-300,
    )
    np.testing.assert_allclose(
        rupture_probability(STRETCHES, MEDIAN, SCATTER, law), expected.cdf(STRETCHES), rtol=1e-10
    )


@pytest.mark.parametrize("law", SCATTER_LAWS)
def test_scatter_is_that_of_the_log_elongation(law):
    draws = reference(law, MEDIAN, 0.03).rvs(size=100_000, random_state=np.random.default_rng(5))
    assert np.std(np.log(draws - 1.0)) == pytest.approx(0.03, rel=0.02)


@pytest.mark.parametrize("law", SCATTER_LAWS)
@given(
    median=st.floats(1.05, 6.0),
    scatter=st.floats(0.02, 0.6),
    stretch=st.floats(1.0, 8.0),
    more=st.floats(0.0, 2.0),
)
def test_probability_rises_with_the_demand_and_is_half_at_the_median(
    law, median, scatter, stretch, more
):
    lower = float(rupture_probability(stretch, median, scatter, law))
    upper = float(rupture_probability(stretch + more, median, scatter, law))
    assert 0.0 <= lower <= upper <= 1.0
    assert float(rupture_probability(median, median, scatter, law)) == pytest.approx(0.5)


@pytest.mark.parametrize("law", ["lognormal", "weibull"])
def test_nothing_breaks_before_it_is_stretched(law):
    np.testing.assert_array_equal(rupture_probability([0.5, 1.0], MEDIAN, SCATTER, law), 0.0)


@given(volume=st.floats(1e-3, 1e3), stretch=st.floats(1.5, 4.0), scatter=st.floats(0.05, 0.4))
def test_a_larger_volume_is_a_chain_of_specimens(volume, stretch, scatter):
    median = 1.0 + (MEDIAN - 1.0) * volume ** (-1.0 / float(weibull_modulus(scatter)))
    assert float(log_survival(stretch, median, scatter, "weibull")) == pytest.approx(
        volume * float(log_survival(stretch, MEDIAN, scatter, "weibull")), rel=1e-9
    )


def test_limit_passes_through_the_paper_and_stays_above_one():
    nodes = (0.0, 25.0)
    logs = np.log([2.098, 0.52])
    np.testing.assert_allclose(limit_stretch(logs, nodes, nodes), [3.098, 1.52], rtol=1e-14)
    assert np.all(limit_stretch(logs, np.linspace(0.0, 400.0, 50), nodes) > 1.0)
    assert limit_stretch(np.zeros((4, 2)), np.zeros(6), nodes).shape == (4, 6)


def test_faults_are_named():
    with pytest.raises(ValueError, match="law 'gumbel'"):
        log_survival(2.0, 3.0, 0.1, "gumbel")
    with pytest.raises(ValueError, match="above 1"):
        rupture_probability(2.0, 1.0, 0.1)
    with pytest.raises(ValueError, match="above 0"):
        log_survival(2.0, 2.0, 0.0)


def scores_of(law):
    """The law of scores at break, as scipy has it: Gumbel's of the smallest about its median."""
    if law == "lognormal":
        return stats.norm()
    return stats.gumbel_l(loc=-math.log(math.log(2.0)) / GUMBEL, scale=1.0 / GUMBEL)


@pytest.mark.parametrize("law", ["lognormal", "weibull"])
@given(score=st.floats(-12.0, 4.0))
def test_laws_of_scores_are_those_of_scipy(law, score):
    expected = scores_of(law)
    assert float(log_whole(score, law)) == pytest.approx(expected.logsf(score), rel=1e-9)
    assert float(log_broken(score, law)) == pytest.approx(expected.logcdf(score), rel=1e-7)
    assert float(score_density(score, law)) == pytest.approx(expected.logpdf(score), rel=1e-9)


@given(low=st.floats(-40.0, 40.0), width=st.floats(1e-3, 50.0))
def test_interval_probabilities_are_those_of_scipy(low, width):
    """In the tails too, where scipy's own difference of cdfs is nothing."""
    got = float(log_broken_between(low, low + width))
    flipped = -abs(low + 0.5 * width)  # the left tail has digits to spare
    a, b = stats.norm.logcdf([flipped - 0.5 * width, flipped + 0.5 * width])
    assert got == pytest.approx(b + np.log1p(-np.exp(a - b)), rel=1e-6, abs=1e-9)


@given(low=st.floats(-30.0, 3.0), width=st.floats(1e-3, 20.0))
def test_interval_probabilities_of_weakest_links_are_those_of_scipy(low, width):
    got = float(log_broken_between(low, low + width, "weibull"))
    law = scores_of("weibull")
    a, b = law.logsf([low, low + width])
    assert got == pytest.approx(a + np.log(-np.expm1(b - a)), rel=1e-7, abs=1e-9)
    assert float(log_broken_between(-np.inf, low, "weibull")) == pytest.approx(
        law.logcdf(low), rel=1e-7
    )
    assert float(log_broken_between(low, np.inf, "weibull")) == pytest.approx(
        law.logsf(low), rel=1e-9
    )


@pytest.mark.parametrize("law", ["lognormal", "weibull"])
def test_drawn_scores_follow_their_law(law):
    drawn = draw_scores((4000,), np.random.default_rng(4), law)
    assert stats.kstest(drawn, scores_of(law).cdf).pvalue > 0.01
