"""Shares of a variance against closed forms, another library, and brute force."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm, sobol_indices

from bayesdeg.causes.catalogue import find
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.prediction.predictive import at_conditions
from bayesdeg.prediction.shares import (
    Quadratic,
    curvature_shares,
    fit_quadratic,
    group_indices,
    known_variance,
)
from bayesdeg.surrogate.trained import default_surrogate
from tests.inference.small_study import TRUTH, altered, small_model, values_of

CLOSE = 0.02
LEVELS, PRESSURES = np.array([0.0, 25.0]), np.array([60.0, 140.0])


def linear(*weights):
    size = len(weights)
    return Quadratic(np.array([weights], dtype=float), np.zeros((1, size, size)), np.ones(1))


def singles(count):
    return {f"x{i}": np.array([i]) for i in range(count)}


def column(indices):
    return indices.first[:, 0], indices.total[:, 0], indices.share[:, 0]


def test_independent_terms_have_their_own_variances():
    first, total, share = column(group_indices(linear(1, 2, 3), np.eye(3), singles(3)))
    for found in (first, total, share):
        assert found == pytest.approx(np.array([1, 4, 9]) / 14, abs=1e-6)


@given(
    rho=st.floats(-0.95, 0.95),
    weights=st.tuples(*[st.floats(0.2, 3.0)] * 3),
)
@settings(max_examples=50, deadline=None)
def test_of_correlated_terms_shapley_effects_are_the_published_closed_form(rho, weights):
    """Iooss and Prieur (2019), doi:10.1615/Int.J.UncertaintyQuantification.2019028372.

    Of y = a x + b y + c z with corr(b y, c z) = ρ.
    """
    a, b, c = weights
    correlation = np.eye(3)
    correlation[1, 2] = correlation[2, 1] = rho
    whole = a**2 + b**2 + c**2 + 2 * rho * b * c
    common = 0.5 * rho**2 * (b**2 - c**2)
    expected = [a**2, b**2 + rho * b * c - common, c**2 + rho * b * c + common]
    first, total, share = column(group_indices(linear(a, b, c), correlation, singles(3)))
    assert share == pytest.approx(np.array(expected) / whole, abs=1e-5)
    assert first[1] == pytest.approx((b + rho * c) ** 2 / whole, abs=1e-5)
    assert total[1] == pytest.approx(b**2 * (1 - rho**2) / whole, abs=1e-5)


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(2, 6), outputs=st.integers(1, 3))
@settings(max_examples=50, deadline=None)
def test_sum_rules(seed, count, outputs):
    """Shares add up to 1, lie between both indices where inputs are independent."""
    generator = np.random.default_rng(seed)
    square = generator.standard_normal((outputs, count, count))
    fit = Quadratic(
        generator.standard_normal((outputs, count)), square + square.mT, np.ones(outputs)
    )
    draws = generator.standard_normal((3 * count, count))
    for correlation in (np.eye(count), np.corrcoef(draws, rowvar=False)):
        found = group_indices(fit, correlation, singles(count))
        assert found.share.sum(axis=0) == pytest.approx(1.0, abs=1e-9)
        assert np.all(found.first > -1e-6)
        assert np.all(found.total > -1e-6)
        assert np.all(found.share > -1e-6)
    found = group_indices(fit, np.eye(count), singles(count))
    assert np.all(found.first <= found.share + 1e-6)
    assert np.all(found.share <= found.total + 1e-6)
    assert np.all(found.first.sum(axis=0) <= 1.0 + 1e-6)
    assert np.all(found.total.sum(axis=0) >= 1.0 - 1e-6)


def test_an_error_whose_size_is_uncertain_belongs_to_its_group():
    """Y = x + s z with s = 2 + 0.5 t: V = 1 + 4 + 0.25, of which the error has all but 1."""
    fit, size = linear(1.0, 0.0), linear(0.0, 0.5)
    groups = {"x": np.array([0]), "error": np.array([1])}
    found = group_indices(fit, np.eye(2), groups, {"error": (size, np.array([2.0]))})
    first, total, share = column(found)
    for one in (first, total, share):
        assert one == pytest.approx([1 / 5.25, 4.25 / 5.25], abs=1e-6)


def test_another_library_finds_the_same_indices():
    """Y = x0 + x1 x2 + x2², fitted to draws, against scipy's sampling of the function."""

    def function(x):
        return x[0] + x[1] * x[2] + x[2] ** 2

    x = np.random.default_rng(0).standard_normal((2000, 3))
    fit = fit_quadratic(x, function(x.T)[:, None], np.eye(3))
    first, total, _ = column(group_indices(fit, np.eye(3), singles(3)))
    drawn = sobol_indices(func=function, n=2**14, dists=[norm()] * 3, rng=1)
    assert first == pytest.approx(drawn.first_order, abs=CLOSE)
    assert total == pytest.approx(drawn.total_order, abs=CLOSE)
    assert first == pytest.approx([1 / 4, 0.0, 2 / 4], abs=1e-6)
    assert total == pytest.approx([1 / 4, 1 / 4, 3 / 4], abs=1e-6)


def test_what_is_known_of_a_quadratic_is_that_of_conditional_draws():
    generator = np.random.default_rng(4)
    factor = np.array([[1.0, 0, 0], [0.6, 0.8, 0], [-0.3, 0.5, np.sqrt(1 - 0.34)]])
    correlation = factor @ factor.T
    b, square = np.array([1.0, -0.5, 0.7]), np.array([[0.4, 0.1, 0], [0.1, 0, 0.3], [0, 0.3, -0.2]])
    fit = Quadratic(b[None], square[None], np.ones(1))
    # given the first two, the third is normal about a mean
    known = generator.standard_normal((4000, 2)) @ factor[:2, :2].T
    gain = correlation[2, :2] @ np.linalg.inv(correlation[:2, :2])
    width = np.sqrt(correlation[2, 2] - gain @ correlation[:2, 2])
    rest = known @ gain + width * generator.standard_normal((2000, 1))
    x = np.stack([*np.broadcast_arrays(known[:, 0], known[:, 1], rest)], axis=-1)
    means = (x @ b + np.einsum("...i,ij,...j", x, square, x)).mean(axis=0)
    found = known_variance(fit, correlation, np.array([0, 1]))[0]
    assert found == pytest.approx(np.var(means), rel=0.06)


@pytest.fixture(scope="module")
def model():
    return altered(small_model(), forward=default_surrogate()).extended(find("pressure_offset"))


def chain_of(model, widths, count=4000):
    """Independent normal draws about the truth, on the unconstrained scale."""
    truth = TRUTH | {"pressure_offset.offset": 5.0}
    vector = model.table.vectors(values_of(truth))[0]
    generator = np.random.default_rng(3)
    width = np.array([widths.get(name, 0.0) for name in model.table.names])
    vectors = vector + width * generator.standard_normal((count, len(vector)))
    return Chain(vectors.reshape(1, count, 1, -1), np.zeros((1, count, 1)), np.ones(1))


def shares_of(model, chain, seed=0):
    return curvature_shares(
        model, chain, np.random.default_rng(seed), degradation=LEVELS, pressure=PRESSURES
    )


def test_shares_of_predictions_add_up_at_every_place(model):
    widths = dict.fromkeys(model.table.names, 0.05)
    table = shares_of(model, chain_of(model, widths))
    assert len(table.groupby(["degradation_pct", "pressure_kPa"])) == 4
    sums = table.groupby(["degradation_pct", "pressure_kPa"])["share"].sum()
    assert sums.to_numpy() == pytest.approx(1.0, abs=1e-9)
    assert np.all(table["explained"] > 0.99)
    assert np.all(table["sd_per_m"] > 0.0)


def test_shares_are_those_of_brute_force_with_each_source_alone(model):
    """Of independent draws the first order is the variance with all else as it is on average."""
    widths = {"paper_stiffness": 0.3, "pressure_offset.offset": 2.0, "volume_ratio": 0.05}
    table = shares_of(model, chain_of(model, widths)).query("pressure_kPa == 140")
    grid = at_conditions(model, LEVELS, PRESSURES[1:])

    def variance(kept, *, scattered):
        chain = chain_of(model, {n: w for n, w in widths.items() if n in kept})
        values = model.table.named(chain.vectors.reshape(-1, len(model.table)))
        scatter = grid.data_of(Curvature).deviation_sd(grid.tests(values))
        own = np.random.default_rng(8).standard_normal((len(scatter), 1, 1))
        return (
            grid.data_of(Curvature)
            .predicted(grid.tests(values), scattered * scatter * own)
            .prediction.curvature[..., 0]
            .var(axis=0)
        )

    alone = {
        "paper": variance(["paper_stiffness"], scattered=0.0),
        "causes": variance(["pressure_offset.offset"], scattered=0.0),
        "scale": variance(["volume_ratio"], scattered=0.0),
        "scatter": variance([], scattered=1.0),
    }
    whole = table.groupby("degradation_pct")["sd_per_m"].first().to_numpy() ** 2
    for source, expected in alone.items():
        found = table.loc[table["source"] == source, "first_order"].to_numpy()
        assert found == pytest.approx(expected / whole, abs=CLOSE), source


def test_the_error_of_reading_has_its_closed_share(model):
    """Where nothing else is uncertain but the specimen's stiffness."""
    table = shares_of(model, chain_of(model, {}))
    grid = at_conditions(model, LEVELS, PRESSURES)
    chain = chain_of(model, {}, count=1)
    curvature = (
        grid.data_of(Curvature)
        .predicted(grid.tests(model.table.named(chain.vectors[0, 0])))
        .prediction.curvature[0]
    )
    truth = values_of(TRUTH)
    sd = np.hypot(truth["curvature_noise_floor"], truth["curvature_noise"] * curvature).ravel()
    reading = table[table["source"] == "reading"]
    assert reading["share"].to_numpy() == pytest.approx(
        sd**2 / reading["sd_per_m"].to_numpy() ** 2, abs=CLOSE
    )
    others = table[~table["source"].isin(["reading", "scatter", "degradation"])]
    assert np.all(np.abs(others["share"]) < 1e-6)


def test_a_rate_that_is_known_exactly_has_no_share(model):
    curves = model.data_of(Curvature).tests
    exact = model.with_observations(
        *data_of_actuators(replace(curves, degradation_sd=0.0 * curves.degradation_sd), model.base)
    )
    table = shares_of(exact, chain_of(exact, {"stiffness_scatter": 0.1}))
    assert np.all(np.abs(table.loc[table["source"] == "degradation", "share"]) < 1e-5)


def test_places_beyond_the_forward_map_are_left_out(model):
    chain = chain_of(model, dict.fromkeys(model.table.names, 0.02))
    table = curvature_shares(
        model,
        chain,
        np.random.default_rng(0),
        degradation=np.array([0.0]),
        pressure=np.array([60.0, 5000.0]),
    )
    assert table["pressure_kPa"].unique().tolist() == [60.0]
