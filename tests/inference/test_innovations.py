"""Readings given those before them: the compiled filter against Cholesky factors of covariances."""

import numpy as np
import pytest

from bayesdeg.observations import noise as likelihood
from bayesdeg.observations.noise import Linearised, paths_of
from tests.inference.path_filter import density_and_mode


def linearised(*, outputs, deviations, seed=0):
    """Random curves of three specimens, with gaps, held readings and a second output."""
    generator = np.random.default_rng(seed)
    mask = generator.random((3, outputs, 7)) < 0.8
    place = np.cumsum(generator.choice([0.0, 10.0, 20.0], (3, 7)), axis=1)
    paths = paths_of(mask, place)
    shape = (4, 3, 7 * outputs)
    return Linearised(
        generator.standard_normal(shape),
        generator.standard_normal((*shape, deviations)),
        generator.uniform(0.1, 2.0, shape),
        generator.uniform(0.0, 1.5, (*shape[:2], deviations)),
        generator.uniform(3.0, 40.0, 4),
        generator.uniform(-0.8, 0.8, 4) if outputs > 1 else np.zeros(4),
        paths,
    )


@pytest.mark.parametrize("outputs", [1, 2])
@pytest.mark.parametrize("deviations", [1, 2])
def test_scores_and_sds_are_those_of_the_cholesky_factor(outputs, deviations):
    curves = linearised(outputs=outputs, deviations=deviations)
    factor = np.linalg.cholesky(likelihood.covariance(curves))
    residual = np.where(curves.paths.mask, curves.residual, 0.0)
    scores = np.linalg.solve(factor, residual[..., None])[..., 0]
    sds = np.diagonal(factor, axis1=-2, axis2=-1)
    found = likelihood.innovations(curves)
    np.testing.assert_allclose(found[0], scores[:, curves.paths.mask], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(np.exp(found[1]), sds[:, curves.paths.mask], rtol=1e-9)


def test_they_sum_to_the_density_of_the_specimens():
    curves = linearised(outputs=2, deviations=2, seed=3)
    score, log_sd = likelihood.innovations(curves)
    total = np.sum(-0.5 * score**2 - log_sd - 0.5 * np.log(2.0 * np.pi), axis=1)
    density = density_and_mode(curves)[0].sum(axis=1)
    np.testing.assert_allclose(total, density, rtol=1e-10)
