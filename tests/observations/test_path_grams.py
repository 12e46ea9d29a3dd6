"""Products with the inverse covariance of reading errors, against whole matrices."""

import numpy as np
import pytest

from bayesdeg.observations.noise import noise_correlation, path_grams, paths_of


@pytest.mark.parametrize("length", [0.01, 0.3, 40.0])
def test_products_are_those_of_the_whole_covariance(length):
    generator = np.random.default_rng(3)
    place = np.cumsum(generator.uniform(0.05, 0.4, (3, 9)), axis=1)
    mask = generator.uniform(size=(3, 9)) > 0.25
    paths = paths_of(mask[:, None, :], place)
    columns, variance = generator.standard_normal((3, 9, 4)), generator.uniform(0.1, 2.0, (3, 9))
    gram, log_det = np.empty((3, 4, 4)), np.empty(3)
    path_grams(columns, variance, paths.mask, paths.gap, length, gram, log_det)
    correlation = noise_correlation(paths, np.array([length]), np.zeros(1))[0]
    for s in range(3):
        read = mask[s]
        sd = np.sqrt(variance[s, read])
        whole = correlation[s][np.ix_(read, read)] * np.outer(sd, sd)
        expected = columns[s, read].T @ np.linalg.solve(whole, columns[s, read])
        np.testing.assert_allclose(gram[s], expected, rtol=1e-9, atol=1e-9)
        assert log_det[s] == pytest.approx(np.linalg.slogdet(2.0 * np.pi * whole)[1])
