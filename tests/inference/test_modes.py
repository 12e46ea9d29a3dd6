"""Separate modes: found, weighed and told of; one mode left in peace."""

from functools import cache

import numpy as np
import pytest
from scipy import integrate

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.density import CustomDensity
from bayesdeg.inference.laplace import Laplace, approximate
from bayesdeg.inference.modes import dispersed, find_modes, nearest, separate, tempered
from bayesdeg.inference.sampling import EFFORTS, sample
from tests.inference.bimodal import SHARES, label_switching, two_normals
from tests.inference.reference_posteriors import blr, schools_not_centred

SIZES = [1, 2, 5, 20]


@cache
def found(size):
    return find_modes(two_normals(size), np.random.default_rng(size))


@pytest.mark.parametrize("size", SIZES)
def test_both_of_two_normals_are_found_with_their_shares(size):
    modes = found(size).modes
    assert len(modes) == 2
    centres = [mode.laplace.mode * np.sqrt(size) for mode in modes]
    np.testing.assert_allclose(centres[0], 4.0, atol=0.02)
    np.testing.assert_allclose(centres[1], -4.0, atol=0.02)
    for mode, share in zip(modes, SHARES[::-1], strict=True):
        assert abs(mode.weight - share) < min(0.05, 4.0 * mode.error)
    assert sum(mode.weight for mode in modes) == pytest.approx(1.0)


@pytest.mark.parametrize("size", SIZES)
def test_the_evidence_is_that_of_both(size):
    """∫ p = (2π)^(n/2) over the prior's normalisation, (2π)^(n/2) 10^n."""
    posterior = found(size).posterior
    assert abs(posterior.log_evidence + size * np.log(10.0)) < 4.0 * posterior.error < 0.4


@pytest.mark.parametrize("size", [1, 2, 5])
def test_sampling_from_there_holds_both(size):
    density = two_normals(size)
    chain = sample(
        density, found(size).posterior, effort=EFFORTS["standard"], seed=np.random.SeedSequence(3)
    )
    across = chain.vectors.sum(axis=-1)
    assert chain.r_hat().max() < 1.01
    assert abs(np.mean(across > 0.0) - SHARES[1]) < 0.05


def test_labels_that_may_be_swapped_give_two_equal_modes():
    modes = find_modes(label_switching(), np.random.default_rng(0)).modes
    first, second = modes
    np.testing.assert_allclose(first.laplace.mode, second.laplace.mode[::-1], atol=0.02)
    assert abs(first.weight - 0.5) < 0.05


def test_a_single_mode_is_left_in_peace():
    modes = find_modes(blr(), np.random.default_rng(0))
    assert not modes.tempered
    assert [mode.weight for mode in modes.modes] == [1.0]


def test_a_mode_that_is_known_need_not_be_found_again():
    density = two_normals(2)
    far = approximate(density, np.random.default_rng(0), start=np.array([-2.0, -2.0]))
    modes = find_modes(density, np.random.default_rng(5), known=[far])
    assert len(modes.modes) == 2


def test_a_posterior_without_a_top_is_tempered_and_its_evidence_is_that_of_quadrature():
    """Given tau the schools are normal: y ~ N(mu, sigma² + tau²)."""
    population, level = tempered(schools_not_centred(), np.random.default_rng(2))
    assert len(np.unique(population, axis=0)) > 500
    y = np.array([28.0, 8.0, -3.0, 7.0, -1.0, 1.0, 18.0, 12.0])
    sigma = np.array([15.0, 10.0, 16.0, 11.0, 9.0, 11.0, 10.0, 18.0])
    # mu ~ N(0, 5²) joins the covariance; the density leaves out the errors' normalisation

    def of(tau):
        covariance = np.diag(sigma**2 + tau**2) + 25.0
        quadratic = y @ np.linalg.solve(covariance, y)
        constant = np.linalg.slogdet(covariance)[1] - 2.0 * np.sum(np.log(sigma))
        return np.exp(-0.5 * (quadratic + constant)) * 2.0 * 5.0 / np.pi / (25.0 + tau**2)

    want = np.log(integrate.quad(of, 0.0, np.inf)[0])
    assert level == pytest.approx(want, abs=0.3)


def test_tops_without_a_valley_between_them_are_one():
    density = two_normals(2)
    top = np.full(2, 4.0 / np.sqrt(2.0))
    near = [Laplace(top + shift, np.eye(2), -shift) for shift in (0.0, 0.01, 0.3)]
    other = Laplace(-top, np.eye(2), -1.0)
    assert separate(density, [*near[::-1], other]) == [near[0], other]


def test_points_belong_to_the_mode_whose_normal_law_is_the_denser():
    wide, narrow = Laplace(np.zeros(1), 4.0 * np.eye(1), 0.0), Laplace(np.ones(1), np.eye(1), 0.0)
    points = np.array([[-3.0], [0.9], [9.0]])
    assert nearest(points, [wide, narrow]).tolist() == [0, 1, 0]


def test_an_impossible_posterior_is_refused_in_words():
    single = two_normals(1).parameters
    nowhere = CustomDensity(single, lambda values: np.full(len(values["x0"]), -np.inf))
    with pytest.raises(BayesdegError, match="widen the priors"):
        find_modes(nowhere, np.random.default_rng(0))


def test_starts_are_apart():
    starts = dispersed(two_normals(1), np.random.default_rng(1))
    assert np.min(np.abs(np.diff(np.sort(starts.ravel())))) > 0.5
    assert starts.min() < -2.0 < 2.0 < starts.max()
