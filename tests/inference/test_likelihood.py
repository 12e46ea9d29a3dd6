"""Densities of curves against full covariance matrices of scipy.stats."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from bayesdeg.inference import likelihood

POINTS = 6


@st.composite
def curves(draw, *, leading=()):
    """Residual, slope, variance, spread and mask of curves of six points."""
    shape = (*leading, POINTS)
    real = st.floats(-5.0, 5.0)
    return (
        draw(arrays(float, shape, elements=real)),
        draw(arrays(float, shape, elements=real)),
        {
            "variance": draw(arrays(float, shape, elements=st.floats(0.05, 4.0))),
            "spread": draw(arrays(float, (*leading, 1), elements=st.floats(0.0, 9.0))),
            "mask": draw(arrays(bool, shape, elements=st.booleans())),
        },
    )


def reference(residual, slope, *, variance, spread, mask):
    """Log density of the masked points under N(0, diag(v) + τ² J Jᵀ)."""
    if not mask.any():
        return 0.0
    J = slope[mask]
    covariance = np.diag(variance[mask]) + spread[0] * np.outer(J, J)
    return stats.multivariate_normal(np.zeros(len(J)), covariance).logpdf(residual[mask])


@given(curve=curves())
def test_marginal_is_the_density_with_diagonal_plus_rank_one_covariance(curve):
    residual, slope, rest = curve
    got = likelihood.marginal(residual, slope, **rest)
    assert got.shape == ()
    assert float(got) == pytest.approx(reference(residual, slope, **rest), rel=1e-9, abs=1e-9)


@given(curve=curves())
def test_sequential_densities_are_those_given_what_came_before(curve):
    """log p(y_1 … y_j) − log p(y_1 … y_{j−1}), each from its own full matrix."""
    residual, slope, rest = curve
    got = likelihood.sequential(residual, slope, **rest)
    before = 0.0
    for j in range(POINTS):
        seen = rest["mask"] & (np.arange(POINTS) <= j)
        now = reference(residual, slope, **(rest | {"mask": seen}))
        assert got[j] == pytest.approx(now - before, rel=1e-7, abs=1e-7)
        before = now


@settings(max_examples=30)
@given(curve=curves(leading=(3, 2)))
def test_sequential_densities_sum_to_the_marginal_and_batches_are_single_curves(curve):
    residual, slope, rest = curve
    marginal = likelihood.marginal(residual, slope, **rest)
    sequential = likelihood.sequential(residual, slope, **rest)
    np.testing.assert_allclose(np.sum(sequential, axis=-1), marginal, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(sequential[~rest["mask"]], 0.0)
    for index in np.ndindex(3, 2):
        one = {name: value[index] for name, value in rest.items()}
        assert marginal[index] == pytest.approx(
            reference(residual[index], slope[index], **one), rel=1e-9, abs=1e-9
        )


@given(curve=curves())
def test_deviation_is_the_posterior_mean_of_the_linear_gaussian(curve):
    residual, slope, rest = curve
    mask = rest["mask"]
    got = likelihood.deviation(residual, slope, **rest)
    assert got.shape == (1,)
    if not mask.any():
        assert got[0] == 0.0
        return
    J, spread = slope[mask], rest["spread"][0]
    covariance = np.diag(rest["variance"][mask]) + spread * np.outer(J, J)
    want = spread * J @ np.linalg.solve(covariance, residual[mask])
    assert got[0] == pytest.approx(want, rel=1e-7, abs=1e-9)


@given(curve=curves(), order=st.permutations(range(POINTS)))
def test_the_order_of_readings_does_not_matter(curve, order):
    residual, slope, rest = curve
    mixed = {k: v[order] if k != "spread" else v for k, v in rest.items()}
    np.testing.assert_allclose(
        likelihood.marginal(residual[order], slope[order], **mixed),
        likelihood.marginal(residual, slope, **rest),
        rtol=1e-9,
        atol=1e-9,
    )


@given(curve=curves())
def test_what_is_masked_cannot_act(curve):
    residual, slope, rest = curve
    hidden = np.where(rest["mask"], residual, -3.0 * residual + 7.0)
    for function in (likelihood.marginal, likelihood.sequential, likelihood.deviation):
        np.testing.assert_array_equal(
            function(hidden, slope, **rest), function(residual, slope, **rest)
        )


@given(value=st.floats(-9.0, 9.0), mean=st.floats(-5.0, 5.0), sd=st.floats(0.01, 50.0))
def test_normal_is_that_of_scipy(value, mean, sd):
    assert likelihood.normal(value, np.array(mean), sd) == pytest.approx(
        stats.norm(mean, sd).logpdf(value), rel=1e-12, abs=1e-12
    )


@given(value=st.floats(0.1, 900.0), median=st.floats(0.1, 900.0), scatter=st.floats(0.01, 3.0))
def test_log_normal_is_that_of_scipy(value, median, scatter):
    got = likelihood.log_normal(np.array(value), np.array(median), np.array(scatter))
    want = stats.lognorm(scatter, scale=median).logpdf(value)
    assert got == pytest.approx(want, rel=1e-9, abs=1e-9)


@given(
    value=st.floats(-9.0, 9.0),
    mean=st.floats(-9.0, 9.0),
    scale=st.floats(0.01, 9.0),
    dof=st.one_of(st.floats(1.0, 50.0), st.just(np.inf)),
)
def test_student_is_that_of_scipy(value, mean, scale, dof):
    got = likelihood.student(value, np.array(mean), scale, dof)
    want = stats.norm(mean, scale) if np.isinf(dof) else stats.t(dof, mean, scale)
    assert got == pytest.approx(want.logpdf(value), rel=1e-9, abs=1e-9)
