import numpy as np
import pandas as pd
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.data.moisture import (
    degradation_of_films,
    degradation_rate,
    mass_loss,
    mass_loss_from_degradation,
    mass_loss_slope,
    moisture_content,
    moisture_content_dry_basis,
    to_dry_basis,
)

RATES = st.floats(-5.0, 99.0)
MOISTURES = st.floats(1.0, 90.0)


@given(rate=RATES, moisture=MOISTURES)
def test_a_rate_on_the_dry_basis_leads_back_to_the_wet_one(rate: float, moisture: float) -> None:
    dry = to_dry_basis(rate, moisture_initial_pct=moisture)
    share = moisture / 100.0
    water = share / (1.0 - share) * (1.0 - dry / 100.0)  # over the dry mass, after degradation
    wet = 100.0 * (1.0 - water / (1.0 + water) / share)
    np.testing.assert_allclose(wet, rate, rtol=1e-9, atol=1e-9)


@given(
    dry_before=st.floats(0.1, 10.0),
    dry_after=st.floats(0.1, 10.0),
    before=MOISTURES,
    after=MOISTURES,
)
def test_conversion_agrees_with_the_masses(
    dry_before: float, dry_after: float, before: float, after: float
) -> None:
    moist_before = dry_before / (1 - before / 100)
    moist_after = dry_after / (1 - after / 100)
    wet = degradation_rate(
        moisture_content(moist_after, dry_after), moisture_content(moist_before, dry_before)
    )
    dry = degradation_rate(
        moisture_content_dry_basis(moist_after, dry_after),
        moisture_content_dry_basis(moist_before, dry_before),
    )
    np.testing.assert_allclose(
        to_dry_basis(wet, moisture_initial_pct=before), dry, rtol=1e-8, atol=1e-8
    )


def test_bases_agree_for_nearly_dry_films_and_at_the_ends() -> None:
    np.testing.assert_allclose(to_dry_basis(25.0, moisture_initial_pct=1e-9), 25.0)
    np.testing.assert_allclose(to_dry_basis([0.0, 100.0], moisture_initial_pct=20.0), [0, 100])


def test_mass_loss_uses_the_dry_basis() -> None:
    by_hand = 0.8574 * 100 * (1 - (0.15 / 0.85) / (0.20 / 0.80))
    got = mass_loss_from_degradation([25.0, 0.0], moisture_initial_pct=20.0)
    np.testing.assert_allclose(got, [by_hand, 0.0], atol=1e-12)


def test_functions_are_vectorised() -> None:
    moist = np.array([[1.0, 1.2], [1.1, 1.3]])
    assert moisture_content(moist, 0.8).shape == (2, 2)
    assert mass_loss([0.4, 0.5, 0.6], 0.6).shape == (3,)
    assert degradation_rate(np.ones((3, 1)), np.ones(4)).shape == (3, 4)


def test_covariance_of_rates_is_the_delta_method_derived_by_sympy() -> None:
    time = np.repeat([0.0, 4.0, 12.0], [4, 3, 5])
    moisture = np.array([20.1, 19.7, 20.6, 19.9, 17.0, 16.4, 16.9, 15.2, 14.8, 15.6, 15.0, 15.3])
    films = degradation_of_films(time, moisture)
    groups = [moisture[time == t] for t in (0.0, 4.0, 12.0)]
    pooled = sum(((g - g.mean()) ** 2).sum() for g in groups) / (12 - 3)
    m = sympy.symbols("m0:3")
    rates = sympy.Matrix([-(mi - m[0]) / m[0] * 100 for mi in m])
    values = {symbol: g.mean() for symbol, g in zip(m, groups, strict=True)}
    jacobian = np.array(rates.jacobian(m).subs(values), float)
    expected = jacobian @ np.diag([pooled / len(g) for g in groups]) @ jacobian.T
    np.testing.assert_allclose(films.covariance, expected, rtol=1e-12, atol=1e-15)
    assert films.covariance[1, 2] > 0
    assert films.films.tolist() == [4, 3, 5]


def test_standard_errors_of_rates_are_those_of_repeated_experiments() -> None:
    rng = np.random.default_rng(20211124)
    time = np.repeat([0.0, 6.0, 24.0], 9)
    truth = np.repeat([20.0, 17.0, 14.0], 9)
    found = [degradation_of_films(time, truth + rng.normal(0, 0.8, 27)) for _ in range(2000)]
    rates = np.array([films.degradation_pct for films in found])
    stated = np.sqrt(np.mean([films.standard_error**2 for films in found], axis=0))
    np.testing.assert_allclose(rates.std(axis=0)[1:], stated[1:], rtol=0.06)
    assert np.corrcoef(rates[:, 1], rates[:, 2])[0, 1] > 0.3


def test_films_without_reference_or_replicates_are_refused() -> None:
    with pytest.raises(ValueError, match="time 0"):
        degradation_of_films([1.0, 1.0], [20.0, 19.0])
    with pytest.raises(ValueError, match="two films"):
        degradation_of_films([0.0, 1.0], [20.0, 19.0])


def control(slope: float, noise: float, samples: int = 21) -> pd.DataFrame:
    """Samples weighed before and after, whose mass loss follows Eq. 6 but for noise of weighing."""
    generator = np.random.default_rng(5)
    rate = np.linspace(2.0, 40.0, samples)
    before = generator.uniform(0.4, 0.6, samples)
    moisture = generator.uniform(20.0, 30.0, samples)
    lost = slope * rate + noise * generator.standard_normal(samples)
    after = before * (1.0 - lost / 100.0)
    return pd.DataFrame(
        {
            "mass_dry_before_g": before,
            "mass_dry_after_g": after,
            "mass_equilibrated_before_g": before * (1.0 + moisture / 100.0),
            "mass_equilibrated_after_g": after * (1.0 + moisture * (1.0 - rate / 100.0) / 100.0),
        }
    )


def test_the_slope_of_eq_6_comes_back_on_the_dry_basis_alone() -> None:
    found = mass_loss_slope(control(0.8574, 0.0))
    assert found.dry == pytest.approx(0.8574, abs=1e-12)
    assert found.dry_se < 1e-9
    # a rate on the wet basis is the smaller one, so the slope is the larger
    assert found.wet > 0.95
    assert found.samples == 21


def test_the_error_of_the_slope_is_that_of_least_squares() -> None:
    table = control(0.8574, 1.5)
    found = mass_loss_slope(table)
    rate = np.linspace(2.0, 40.0, 21)[:, None]
    lost = mass_loss(table["mass_dry_after_g"], table["mass_dry_before_g"])
    (slope,), (squares,), *_ = np.linalg.lstsq(rate, lost)
    assert found.dry == pytest.approx(slope)
    assert found.dry_se == pytest.approx(np.sqrt(squares / 20 / np.sum(rate**2)))
    assert abs(found.dry - 0.8574) < 3.0 * found.dry_se


def test_a_control_in_which_nothing_changed_has_no_slope() -> None:
    still = control(0.8574, 0.0).assign(
        mass_dry_after_g=lambda table: table["mass_dry_before_g"],
        mass_equilibrated_after_g=lambda table: table["mass_equilibrated_before_g"],
    )
    with pytest.raises(ValueError, match="no sample's moisture"):
        mass_loss_slope(still)
    scattered = control(0.8574, 1.5)
    both = mass_loss_slope(pd.concat([scattered, still]))
    assert both.dry_se == pytest.approx(mass_loss_slope(scattered).dry_se)
    assert np.isnan(mass_loss_slope(control(0.8574, 0.0, samples=1)).dry_se)
