"""Draws that take in further readings, against densities and samples of all readings at once."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.inference.laplace import Evidence
from bayesdeg.inference.update import (
    FEWEST,
    RELIABLE_K,
    Method,
    Updated,
    drawn_evenly,
    is_reliable,
    reweighted,
    take_in,
)
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from tests.run.planted_offset import model as planted
from tests.run.small_run import sample_of


@pytest.fixture(scope="module")
def whole():
    return planted()


def without_specimen(model, place):
    curves = model.data_of(Curvature).tests
    return model.with_observations(
        *data_of_actuators(
            curves.subset(np.delete(np.arange(len(curves.specimens)), place)), model.base
        )
    )


def without_reading(model, place):
    """The last reading of a specimen that was read up to the largest pressure is not there."""
    curves = model.data_of(Curvature).tests
    last = np.flatnonzero(curves.mask[place])[-1]
    mask, recorded = curves.mask.copy(), curves.recorded.copy()
    mask[place, last] = recorded[place, last] = False
    angle = curves.angle_mask & mask
    return model.with_observations(
        *data_of_actuators(
            replace(curves, mask=mask, recorded=recorded, angle_mask=angle), model.base
        )
    )


@pytest.fixture(scope="module")
def reference(whole):
    return sample_of(whole, 1, enough=3000.0)


def moments(sample):
    weights = np.exp(sample.log_weights - sample.log_weights.max())
    weights /= weights.sum()
    mean = weights @ sample.draws
    return mean, np.sqrt(weights @ (sample.draws - mean) ** 2)


CASES = {"specimen": without_specimen, "reading": without_reading}


@pytest.mark.parametrize("case", CASES)
def test_weights_are_the_ratio_of_both_posteriors(whole, case):
    """A further reading of a specimen is not independent of those that were read on it before."""
    before = CASES[case](whole, 1)
    draws = sample_of(before, 2, enough=200.0).draws[:300]
    density = before.log_prob(draws)
    possible = np.isfinite(density)
    name = whole.data_of(Curvature).tests.specimens[1]
    found = reweighted(before, whole, draws[possible], density[possible], [name])
    expected = whole.log_prob(draws[possible]) - density[possible]
    # the largest weights are smoothed
    order = np.argsort(expected)[: len(expected) // 2]
    shift = found.log_weights[order] - expected[order]
    assert np.ptp(shift[np.isfinite(expected[order])]) < 1e-8
    np.testing.assert_allclose(found.log_densities, whole.log_prob(draws[possible]), rtol=1e-10)


@pytest.mark.parametrize("case", CASES)
def test_the_updated_posterior_is_that_of_all_readings(whole, reference, case):
    before = CASES[case](whole, 1)
    earlier = sample_of(before, 3, enough=3000.0)
    generator = np.random.default_rng(4)
    places = drawn_evenly(earlier, generator, 2000)
    name = whole.data_of(Curvature).tests.specimens[1]
    found = take_in(
        before,
        whole,
        earlier.draws[places],
        earlier.log_densities[places],
        [name],
        generator,
        independent=0.6,
        enough=2500.0,
    )
    assert found.method == Method.REFIT
    assert found.reliable
    assert found.posterior.effective >= 2500.0
    mean, sd = moments(found.posterior)
    wanted, width = moments(reference)
    assert np.max(np.abs(mean - wanted) / width) < 0.12
    assert np.max(np.abs(sd / width - 1.0)) < 0.08


def test_draws_that_are_many_enough_are_only_weighed(whole):
    before = without_reading(whole, 1)
    earlier = sample_of(before, 3, enough=600.0)
    places = drawn_evenly(earlier, np.random.default_rng(0), 1000)
    found = take_in(
        before,
        whole,
        earlier.draws[places],
        earlier.log_densities[places],
        [whole.data_of(Curvature).tests.specimens[1]],
        np.random.default_rng(0),
        enough=100.0,
    )
    assert found.method == Method.WEIGHTS
    assert found.posterior is found.weights
    assert 100.0 <= found.posterior.effective <= 1000.0
    assert len(found.posterior.draws) == 1000


@pytest.mark.long
def test_where_weights_fail_the_posterior_is_found_again(whole, reference):
    """The earlier readings are of a specimen much stiffer than it is: its draws carry no weight."""
    curves = whole.data_of(Curvature).tests
    scale = np.where(np.arange(len(curves.specimens)) == 1, 0.4, 1.0)[:, None]
    wrong = whole.with_observations(
        *data_of_actuators(replace(curves, curvature=curves.curvature * scale), whole.base)
    )
    earlier = sample_of(wrong, 5, enough=800.0)
    places = drawn_evenly(earlier, np.random.default_rng(1), 500)
    found = take_in(
        wrong,
        whole,
        earlier.draws[places],
        earlier.log_densities[places],
        [curves.specimens[1]],
        np.random.default_rng(2),
        enough=1500.0,
    )
    assert found.weights.effective < FEWEST
    assert found.method != Method.WEIGHTS
    assert found.reliable
    mean, _ = moments(found.posterior)
    wanted, width = moments(reference)
    assert np.max(np.abs(mean - wanted) / width) < 0.2


def test_what_is_reliable_has_a_light_tail_and_enough_draws():
    even = Evidence(0.0, 0.0, np.zeros((500, 1)), np.zeros(500), 500.0)
    assert is_reliable(even)
    assert Updated(even, Method.WEIGHTS, even).reliable
    heavy = replace(even, pareto_k=RELIABLE_K + 0.01)
    assert not is_reliable(heavy)
    assert not Updated(heavy, Method.REFIT, heavy).reliable
    few = replace(even, effective=FEWEST - 1.0)
    assert not Updated(few, Method.MODE, few).reliable


def test_resampled_draws_have_the_weights_of_the_sample():
    generator = np.random.default_rng(0)
    weights = generator.gamma(1.0, size=50)
    sample = Evidence(0.0, 0.0, np.zeros((50, 1)), np.log(weights), 25.0)
    counts = np.bincount(drawn_evenly(sample, generator, 1000), minlength=50)
    assert np.all(np.abs(counts - 1000 * weights / weights.sum()) < 1.0)
