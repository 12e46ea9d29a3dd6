"""Degradation rates by a time in the soil, draw by draw."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayesdeg.prediction.soil import Level, Soil, known_levels

COUNT = 400


def soil(seed=1):
    generator = np.random.default_rng(seed)
    return Soil(
        {
            "degradation_limit": 30.0 + generator.standard_normal(COUNT),
            "degradation_time_constant": 10.0 * np.exp(0.1 * generator.standard_normal(COUNT)),
            "fresh_moisture": np.full(COUNT, 20.0),
            "moisture_scatter": np.full(COUNT, 0.5),
        }
    )


@given(st.lists(st.floats(0.0, 500.0), min_size=2, max_size=5))
def test_degradation_never_falls_with_time_in_any_draw(hours):
    rates = soil().rates(np.sort(hours))
    assert np.all(np.diff(rates, axis=1) >= 0.0)
    assert np.all((rates >= 0.0) & (rates <= soil().values["degradation_limit"][:, None]))


def test_levels_are_the_rates_of_each_draw():
    found = soil().levels(np.array([0.0, 10.0]))
    assert [level.hours for level in found] == [0.0, 10.0]
    assert not found[0].rates.any()
    limit, constant = (soil().values[f"degradation_{n}"] for n in ("limit", "time_constant"))
    np.testing.assert_allclose(found[1].rates, limit * (1.0 - np.exp(-10.0 / constant)))
    np.testing.assert_allclose(found[1].interval, np.quantile(found[1].rates, [0.05, 0.5, 0.95]))
    assert found[1].column(7).shape == (7, 1)
    assert found[1].of_draws(7).tolist() == found[1].rates[:7].tolist()
    with pytest.raises(ValueError, match="400 draws"):
        found[1].of_draws(COUNT + 1)


def test_a_known_rate_is_one_number_for_all_draws():
    [level] = known_levels([12.5])
    assert level.is_known
    assert level.of_draws(1000) == 12.5
    assert level.column(1000).tolist() == [12.5]
    assert level.interval.tolist() == [12.5, 12.5, 12.5]
    assert str(level).endswith(" by 12.5 %")  # in progress a bare 12.5 % reads as a share
    assert str(Level(np.ones(3), 8.0)).startswith("8 h ")


def test_draws_keep_their_parameters_together():
    drawn = soil().drawn(np.random.default_rng(3), 1000)
    pairs = set(zip(*(v.tolist() for v in soil().values.values()), strict=True))
    assert set(zip(*(v.tolist() for v in drawn.values.values()), strict=True)) <= pairs
    np.testing.assert_allclose(drawn.film_scatter, 2.5)
