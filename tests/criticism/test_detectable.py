"""What an adequate model may hide, and errors that are none: held against planted misfits."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.criticism.checks.detectable import OFTEN, detectable_causes, detectable_misfit
from bayesdeg.criticism.checks.discrepancy import discrepancies, largest_ratio, measure
from bayesdeg.criticism.checks.plausible_errors import SEVERAL, implausible_errors
from bayesdeg.criticism.fit.linear import log_bayes_factor, sensitivities
from bayesdeg.criticism.outcome import MISFIT_LEVEL
from tests.criticism import straight_subject as straight
from tests.criticism.linear_case import drawn, known_linear, with_readings
from tests.criticism.straight_subject import linear_cause

LINEAR = known_linear(with_angle=False)
SIMULATED = drawn(LINEAR, np.random.default_rng(3), 400)
MISFIT = measure(LINEAR, SIMULATED)
FOUND = detectable_misfit(LINEAR, MISFIT, SIMULATED)


def wave(linear):
    """A smooth misfit common to all specimens, a wave over the whole path."""
    along = linear.subject.places.along
    return linear.mean * np.sin(2.0 * np.pi * (along - along.min()) / np.ptp(along))


def left_pct(linear, change):
    left = linear.unexplained(linear.whiten_columns(change))
    return 100.0 * np.max(np.abs(left)) / np.max(np.abs(linear.subject.observed))


@pytest.mark.parametrize(("share", "low", "high"), [(1.0, 0.8, 1.0), (0.2, 0.0, 0.5)])
def test_a_misfit_of_the_stated_size_shows_and_a_fifth_of_it_does_not(share, low, high):
    change = wave(LINEAR)
    size = share * FOUND.misfit_pct / left_pct(LINEAR, change)
    data = drawn(LINEAR, np.random.default_rng(4), 300) + size * change
    statistics, _ = largest_ratio(LINEAR.whiten(data), discrepancies(LINEAR))
    bound = np.quantile(MISFIT.null, 1.0 - MISFIT_LEVEL)
    assert low <= np.mean(statistics > bound) <= high


def test_more_scatter_hides_more():
    noisy = LINEAR.with_scatter(9.0 * LINEAR.scatter)
    simulated = drawn(noisy, np.random.default_rng(3), 400)
    found = detectable_misfit(noisy, measure(noisy, simulated), simulated)
    assert 2.0 * FOUND.misfit_pct < found.misfit_pct < 5.0 * FOUND.misfit_pct


def test_specimens_count_if_they_scatter():
    places = LINEAR.subject.places
    assert FOUND.specimens == len(np.unique(places.specimen[places.kind == FOUND.kind])) > 1
    exact = straight.exact_linear(straight.readings(1))
    alike = drawn(exact, np.random.default_rng(3), 400)
    assert detectable_misfit(exact, measure(exact, alike), alike).specimens == 0


def test_without_chance_nothing_is_stated():
    few = replace(MISFIT, null=MISFIT.null[:3], p_value=float("nan"))
    assert detectable_misfit(LINEAR, few, SIMULATED) is None


def test_a_cause_of_the_stated_size_is_named_as_often():
    threshold, generator = 4.0, np.random.default_rng(5)
    linear, cause = straight.exact_linear(straight.readings(1)), linear_cause("wave")
    (found,) = detectable_causes(linear, [cause], threshold)
    column = sensitivities(linear, cause)
    sd = cause.parameters[0].law.sd
    z = generator.standard_normal((4000, len(column))) + found.size / sd * column[:, 0]
    assert np.mean(log_bayes_factor(z, column) > threshold) == pytest.approx(OFTEN, abs=0.03)


def smooth_residuals(size):
    """Readings whose residuals are a smooth wave and a little noise."""
    noise = 0.1 * np.sqrt(np.diag(LINEAR.scatter)).min()
    rough = noise * np.random.default_rng(6).standard_normal(len(LINEAR.mean))
    return with_readings(LINEAR, LINEAR.prediction + size * wave(LINEAR) + rough)


def test_a_smooth_residual_taken_for_noise_is_not_plausible():
    found = implausible_errors(smooth_residuals(0.02), SIMULATED)
    assert found.noise_ratio > SEVERAL
    assert found.r_squared > 0.9


def test_noise_that_is_there_is_plausible():
    for k in range(20):
        assert implausible_errors(with_readings(LINEAR, SIMULATED[k]), SIMULATED) is None


def test_predictions_worse_than_the_mean_are_not_plausible():
    far = with_readings(LINEAR, SIMULATED[0] + 3.0 * LINEAR.mean.mean())
    assert implausible_errors(far, SIMULATED).r_squared < 0.0
