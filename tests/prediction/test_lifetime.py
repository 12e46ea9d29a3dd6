"""How long an actuator in the soil does its duty, against closed forms of a straight-line map."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.stats import norm

from bayesdeg.inference.sampling import Chain
from bayesdeg.prediction.lifetime import Duty, live, passed_at, specimens_in_soil
from bayesdeg.prediction.predictive import draw_specimens
from bayesdeg.prediction.soil import Soil
from tests.inference.small_study import TRUTH, altered, small_model, values_of
from tests.prediction.test_control import StraightLine

SCALE = np.cbrt(TRUTH["volume_ratio"])
LIMIT, TIME_CONSTANT = 24.0, 10.0
HOURS = np.linspace(0.0, 24.0, 49)
PRESSURE, WANTED = 60.0, 5.0
STILL = 1e-9  # of a scatter that has no effect


def course(scatter=STILL, count=50):
    known = {
        "degradation_limit": LIMIT,
        "degradation_time_constant": TIME_CONSTANT,
        "fresh_moisture": 20.0,
        "moisture_scatter": scatter,
    }
    return Soil({name: np.full(count, value) for name, value in known.items()})


def life(*, scatter=STILL, duty=None, draws=20, strata=6, ceiling=np.inf, **changes):
    model = altered(small_model(), forward=StraightLine(), largest_pressure=140.0)
    truth = {n: v for n, v in (TRUTH | changes).items() if n in model.table.names}
    vectors = model.table.vectors(values_of(truth, 10))[None, :, None]
    chain = Chain(vectors, np.zeros((1, 10, 1)), np.ones(1))
    generator = np.random.default_rng(4)
    specimens = draw_specimens(model, chain, generator, draws=draws, strata=strata)
    rates = specimens_in_soil(course(scatter), specimens, generator)
    wanted = duty or Duty(PRESSURE, WANTED, 0.05)
    return live(specimens, rates, wanted, HOURS, ceiling=lambda _: ceiling)


def c1_after(hours):
    model = small_model()
    rate = LIMIT * -np.expm1(-np.asarray(hours, float) / TIME_CONSTANT)
    return model.world.constants(values_of(), np.atleast_1d(rate))[0, :, 0]


def curvature_after(hours, pressure=PRESSURE):
    return 40.0 * pressure / (1e3 * c1_after(hours) * SCALE)


STILL_SPECIMENS = {"stiffness_scatter": STILL}


def test_a_duty_is_lost_when_the_material_is_too_stiff_for_it():
    exact = brentq(lambda t: curvature_after(t)[0] - WANTED, 0.0, 24.0)
    found = life(**STILL_SPECIMENS)
    np.testing.assert_allclose(
        found.curvature, np.tile(curvature_after(HOURS), (120, 1)), rtol=1e-6
    )
    # a step function on the grid of times, drawn as a line between them
    np.testing.assert_allclose(found.time_to_failure, exact, atol=HOURS[1])
    assert found.burst.max() < 1e-6


def test_lifetimes_spread_as_stiffness_does():
    """κ ∝ exp(−σ z): the time at which C1 exp(σ z) passes its limit, z at 0.05, 0.5, 0.95."""
    sigma = 0.1
    found = life(stiffness_scatter=sigma, strata=40).time_to_failure
    exact = [
        brentq(lambda t, z=z: curvature_after(t)[0] * np.exp(-sigma * z) - WANTED, 0.0, 24.0)
        for z in norm.ppf([0.95, 0.5, 0.05])
    ]
    np.testing.assert_allclose(found, exact, atol=0.3)


def test_lifetimes_spread_as_the_films_do():
    """D_i = D (1 + z s/D_∞), s = 100 · 0.4/20 points."""
    found = life(scatter=0.4, draws=300, strata=8, **STILL_SPECIMENS).time_to_failure
    level = brentq(lambda d: 40.0 * PRESSURE / (1e3 * SCALE * _c1_at(d)) - WANTED, 0.0, 25.0)
    share = level / (1.0 + norm.ppf([0.95, 0.5, 0.05]) * 2.0 / LIMIT) / LIMIT
    exact = -TIME_CONSTANT * np.log(1.0 - share)
    np.testing.assert_allclose(found, exact, atol=0.3)


def _c1_at(rate):
    return small_model().world.constants(values_of(), np.array([rate]))[0, 0, 0]


def test_what_has_burst_stays_burst():
    """Fresh material is strained most: what survives the first loading survives the stiffer ones.

    The strain is p/C1, the limit log-normal about the films' elongation.
    """
    strain = PRESSURE / (1e3 * TRUTH["c1_at_0"])
    median = 100.0 * strain * 1.1
    found = life(**STILL_SPECIMENS, elongation_at_0=median, elongation_at_25=10.0 * median)
    exact = norm.cdf(np.log(1.0 / 1.1) / TRUTH["elongation_scatter"])
    np.testing.assert_allclose(found.burst, exact, rtol=1e-4)


def test_ruptures_come_later_where_the_limit_falls_faster_than_the_strain():
    found = life(**STILL_SPECIMENS, elongation_at_0=210.0, elongation_at_25=2.0)
    rate = LIMIT * -np.expm1(-HOURS / TIME_CONSTANT)
    limit = np.exp(np.log(210.0) + rate / 25.0 * np.log(2.0 / 210.0)) / 100.0
    strain = PRESSURE / (1e3 * c1_after(HOURS))
    now = norm.cdf(np.log(strain / limit) / TRUTH["elongation_scatter"])
    exact = np.maximum.accumulate(now)
    assert exact[0] < 1e-6
    assert exact[-1] > 0.5
    np.testing.assert_allclose(found.burst[0], exact, atol=1e-4)


def test_the_pressure_that_keeps_a_curvature_follows_the_stiffness():
    found = life(**STILL_SPECIMENS)
    exact = WANTED * 1e3 * c1_after(HOURS) * SCALE / 40.0
    np.testing.assert_allclose(np.median(found.needed, axis=0), exact, rtol=1e-5)


def test_a_curvature_is_out_of_reach_once_it_needs_more_than_is_allowed():
    ceiling = 100.0
    found = life(**STILL_SPECIMENS, ceiling=ceiling)
    exact = brentq(lambda t: curvature_after(t, ceiling)[0] - WANTED, 0.0, 24.0)
    np.testing.assert_allclose(found.allowed, ceiling)
    np.testing.assert_allclose(found.last_reachable, exact, atol=HOURS[1])
    assert np.all(found.last_reachable > found.time_to_failure)
    assert np.all(np.isinf(life(**STILL_SPECIMENS).last_reachable))


def test_fresh_specimens_do_not_differ_in_degradation():
    found = life(scatter=0.4)
    assert not found.degradation[:, 0].any()
    assert np.all(np.diff(found.degradation, axis=1) >= 0.0)
    assert np.std(found.degradation[:, -1]) > 0.5


@given(
    st.lists(st.floats(0.0, 1.0), min_size=2, max_size=8),
    st.lists(st.floats(0.001, 1.0), min_size=1, max_size=4),
)
def test_passing_a_share_is_the_inverse_of_reading_it(steps, quantiles):
    share = np.maximum.accumulate(np.array(steps))
    hours = np.linspace(0.0, 10.0, len(share))
    asked = np.sort(quantiles)
    found = passed_at(hours, share, asked)
    assert np.all(np.diff(found[np.isfinite(found)]) >= -1e-9)
    assert np.array_equal(np.isinf(found), asked > share[-1])
    for q, time in zip(asked, found, strict=True):
        if np.isfinite(time) and q > share[0]:
            assert np.interp(time, hours, share) == pytest.approx(q, abs=1e-6)
