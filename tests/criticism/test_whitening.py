"""Covariances as blocks of specimens and what they share, against dense matrices."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from bayesdeg.criticism.fit.linear import Whitening


def case(seed=0, shared=4):
    generator = np.random.default_rng(seed)
    blocks = [(a := generator.standard_normal((n, n))) @ a.T + 0.1 * np.eye(n) for n in (3, 1, 5)]
    scatter = block_diag(*blocks)
    order = generator.permutation(len(scatter))  # readings of a specimen need not be neighbours
    return scatter[np.ix_(order, order)], generator.standard_normal((len(scatter), shared))


@pytest.mark.parametrize("shared", [1, 4, 30])
def test_factor_and_inverse_are_those_of_the_covariance(shared):
    scatter, root = case(shared=shared)
    found, total = Whitening.of(scatter, root), scatter + root @ root.T
    np.testing.assert_allclose(found.factor @ found.factor.T, total, rtol=1e-9, atol=1e-9)
    columns = np.random.default_rng(1).standard_normal((len(total), 3))
    np.testing.assert_allclose(found.whitened(found.coloured(columns)), columns, atol=1e-9)
    np.testing.assert_allclose(
        found.adjoint(found.whitened(columns)), np.linalg.solve(total, columns), atol=1e-7
    )
    np.testing.assert_allclose(found.whitened(columns[:, 0]), found.whitened(columns)[:, 0])


def test_whitened_readings_have_the_density_of_scipy():
    scatter, root = case(3)
    found = Whitening.of(scatter, root)
    reading = np.random.default_rng(2).standard_normal(len(scatter))
    z = found.whitened(reading)
    logs = 0.5 * np.linalg.slogdet(found.factor @ found.factor.T)[1]
    want = multivariate_normal(cov=scatter + root @ root.T).logpdf(reading)
    assert -0.5 * z @ z - logs - 0.5 * len(z) * np.log(2 * np.pi) == pytest.approx(want)


def test_nothing_shared_leaves_the_blocks():
    scatter, root = case()
    found = Whitening.of(scatter, 0.0 * root)
    np.testing.assert_allclose(found.factor @ found.factor.T, scatter, atol=1e-12)
    assert found.is_finite


@pytest.mark.parametrize("place", ["scatter", "shared"])
def test_what_is_no_number_is_kept_and_said(place):
    scatter, root = case()
    (scatter if place == "scatter" else root)[0, 0] = np.nan
    assert not Whitening.of(scatter, root).is_finite
