from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from bayesdeg.causes.catalogue import find
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.prediction.predictive import (
    QUANTILES,
    at_conditions,
    curvature_bands,
    draw_values,
    rupture_table,
)
from bayesdeg.surrogate.trained import default_surrogate
from tests.inference.small_study import TRUTH, altered, small_model, values_of
from tests.surrogate.closed_form import ClosedFormMap

LEVELS = np.array([0.0, 12.5, 25.0])
PRESSURES = np.array([0.0, 20.0, 60.0, 100.0, 140.0])
NAMES = [f"q{round(100 * q):02d}" for q in QUANTILES]


@pytest.fixture(scope="module")
def model():
    return altered(small_model(), forward=default_surrogate())


def chain_at(model, **changes):
    """A posterior without width, at the truth but for what is changed."""
    vector = model.table.vectors(values_of(TRUTH | changes))[0]
    vectors = np.broadcast_to(vector, (1, 10, 2, len(vector))).copy()
    return Chain(vectors, np.zeros((1, 10, 2)), np.array([0.4]))


def bands_of(model, chain, **changes):
    options = {"degradation": LEVELS, "pressure": PRESSURES, "draws": 400} | changes
    return curvature_bands(model, chain, np.random.default_rng(1), **options)


def rupture_of(model, chain, **changes):
    options = {"degradation": LEVELS, "pressure": PRESSURES, "draws": 20} | changes
    return rupture_table(model, chain, np.random.default_rng(1), **options)


def test_conditions_are_one_specimen_a_level_with_known_degradation(model):
    grid = at_conditions(model, LEVELS, PRESSURES)
    assert grid.data_of(Curvature).tests.mask.shape == (3, 5)
    assert grid.data_of(Curvature).tests.mask.all()
    assert not grid.data_of(Curvature).tests.degradation_sd.any()
    assert grid.data_of(Curvature).tests.degradation[:, 0].tolist() == LEVELS.tolist()
    assert grid.base == model.base


def test_draws_come_from_the_chain(model):
    generator = np.random.default_rng(2)
    vectors = generator.standard_normal((2, 5, 3, len(model.table)))
    chain = Chain(vectors, np.zeros((2, 5, 3)), np.full(2, 0.4))
    drawn = draw_values(model, chain, generator, 200)["c1_at_0"]
    every = model.table.named(vectors.reshape(30, -1))["c1_at_0"]
    assert set(drawn) <= set(every)
    assert len(set(drawn)) > 20


def test_bands_are_ordered_and_zero_at_zero_pressure(model):
    bands = bands_of(model, chain_at(model))
    assert list(bands.columns) == ["degradation_pct", "pressure_kPa", *NAMES]
    assert len(bands) == 15
    quantiles = bands[NAMES].to_numpy()
    assert np.all(np.diff(quantiles, axis=1) >= 0.0)
    assert np.all(quantiles[bands["pressure_kPa"] == 0.0] == 0.0)


def test_curvature_rises_with_pressure_and_falls_with_degradation(model):
    middle = bands_of(model, chain_at(model))["q50"].to_numpy().reshape(3, 5)
    assert np.all(np.diff(middle, axis=1) > 0.0)
    assert np.all(np.diff(middle[:, 1:], axis=0) < 0.0)


def test_bands_collapse_on_the_forward_map_without_scatter_and_posterior_width(model):
    chain = chain_at(model, stiffness_scatter=1e-9)
    bands = bands_of(model, chain)
    exact = (
        at_conditions(model, LEVELS, PRESSURES)
        .data_of(Curvature)
        .predicted(at_conditions(model, LEVELS, PRESSURES).tests(values_of()))
        .prediction.curvature[0]
    )
    for name in NAMES:
        np.testing.assert_allclose(bands[name], exact.ravel(), rtol=1e-6)


def test_width_of_the_band_is_that_of_the_scatter_of_stiffness(model):
    """At small load κ ∝ p/C1 to first order of the log: sd(κ) = slope · τ."""
    bands = bands_of(
        model, chain_at(model, stiffness_scatter=0.02), draws=8000, pressure=np.array([60.0])
    )
    grid = at_conditions(model, LEVELS, np.array([60.0]))
    slope = grid.data_of(Curvature).predicted(grid.tests(values_of())).prediction.slope[0, :, 0]
    width = (bands["q95"] - bands["q05"]).to_numpy()
    np.testing.assert_allclose(width, 2.0 * norm.ppf(0.95) * 0.02 * slope, rtol=0.06)


def raw_prediction(model, grid):
    """What the emulator itself answers at the truth, without its common error."""
    base = tuple(p for p in model.base if not p.name.startswith("emulator_error"))
    truth = {k: v for k, v in TRUTH.items() if not k.startswith("emulator_error")}
    raw = replace(grid, base=base)
    return raw.data_of(Curvature).predicted(raw.tests(values_of(truth))).prediction


def test_bands_are_shifted_by_the_common_error_of_the_emulator(model):
    """κ + g sd, g = u₀/√3 + u₁ (2 p/p_max − 1) + u₂ (2 D/D_max − 1)."""
    error = {
        "emulator_error_level": 1.5,
        "emulator_error_pressure": -0.7,
        "emulator_error_degradation": 0.4,
    }
    bands = bands_of(model, chain_at(model, stiffness_scatter=1e-9, **error))
    raw = raw_prediction(model, at_conditions(model, LEVELS, PRESSURES))
    along = 2.0 * PRESSURES / model.world.largest_pressure - 1.0
    across = 2.0 * LEVELS[:, None] / 25.0 - 1.0
    g = 1.5 / np.sqrt(3.0) - 0.7 * along + 0.4 * across
    expected = raw.curvature[0] + g * raw.sd[0]
    np.testing.assert_allclose(bands["q50"], expected.ravel(), rtol=1e-6)


def test_without_knowledge_of_the_common_error_the_band_is_as_wide_as_the_emulator_is_wrong(model):
    """Its variance is that of g: 1/3 + (2 p/p_max − 1)² + (2 D/D_max − 1)² of the emulator's own.

    The posterior here is the prior of the error, and has no other width.
    """
    generator = np.random.default_rng(6)
    vectors = model.table.vectors(values_of(TRUTH | {"stiffness_scatter": 1e-9}, 6000))
    rows = [i for i, n in enumerate(model.table.names) if n.startswith("emulator_error")]
    vectors[:, rows] = generator.standard_normal((6000, 3))
    chain = Chain(vectors[None, :, None], np.zeros((1, 6000, 1)), np.array([0.4]))
    bands = bands_of(model, chain, draws=6000, pressure=PRESSURES[1:])
    raw = raw_prediction(model, at_conditions(model, LEVELS, PRESSURES[1:]))
    along = 2.0 * PRESSURES[1:] / model.world.largest_pressure - 1.0
    across = 2.0 * LEVELS[:, None] / 25.0 - 1.0
    sd = np.sqrt(1.0 / 3.0 + along**2 + across**2) * raw.sd[0]
    width = (bands["q95"] - bands["q05"]).to_numpy()
    np.testing.assert_allclose(width, 2.0 * norm.ppf(0.95) * sd.ravel(), rtol=0.06)


def without_error(inputs):
    """The closed form as a map that is exact."""
    prediction = ClosedFormMap()(inputs)
    nothing = np.zeros_like(prediction.sd)
    return replace(prediction, sd=nothing, bend_angle_sd=nothing, peak_stretch_sd=nothing)


def test_a_map_without_an_error_of_its_own_has_none_in_the_bands(model):
    exact = altered(model, forward=without_error)
    still, moved = (
        bands_of(exact, chain_at(exact, stiffness_scatter=1e-9, emulator_error_level=u))
        for u in (0.0, 3.0)
    )
    assert still.equals(moved)


def test_bands_of_curvature_do_not_need_bend_angles(model):
    """They are those of the calibrated model, whether angles were read or not."""
    without = replace(
        model.data_of(Curvature).tests,
        angle_mask=np.zeros_like(model.data_of(Curvature).tests.angle_mask),
    )
    chain = chain_at(model)
    assert bands_of(altered(model, actuator=without), chain).equals(bands_of(model, chain))


def test_bands_end_where_the_map_ends(model):
    bands = bands_of(model, chain_at(model), pressure=np.array([100.0, 2000.0]))
    fresh = bands[bands["degradation_pct"] == 0.0].set_index("pressure_kPa")
    assert np.isfinite(fresh.loc[100.0, "q50"])
    assert fresh.loc[2000.0, NAMES].isna().all()


def test_an_active_cause_moves_the_bands(model):
    extended = model.extended(find("pressure_offset"))
    late = bands_of(extended, chain_at(extended, **{"pressure_offset.offset": 20.0}))
    prompt = bands_of(model, chain_at(model))
    later, earlier = (b["q50"].to_numpy().reshape(3, 5) for b in (late, prompt))
    assert np.all(later[:, 1] == 0.0)  # 20 kPa read, nothing in the chambers
    assert np.all(later[:, 2:] < earlier[:, 2:])


def test_rupture_is_impossible_without_pressure_and_rises_with_it(model):
    table = rupture_of(model, chain_at(model, elongation_at_0=60.0, elongation_at_25=15.0))
    probability = table["probability"].to_numpy().reshape(3, 5)
    assert np.all(probability[:, 0] == 0.0)
    assert np.all(np.diff(probability, axis=1) >= 0.0)
    assert 0.0 < probability.max() <= 1.0


def test_a_weaker_material_ruptures_sooner(model):
    strong, weak = (
        rupture_of(model, chain_at(model, elongation_at_0=e, elongation_at_25=0.3 * e))
        for e in (200.0, 30.0)
    )
    assert np.all(weak["probability"] >= strong["probability"])
    assert weak["probability"].max() > strong["probability"].max() + 0.05


def test_rupture_is_that_of_a_lognormal_limit(model):
    """One stiffness: P = Φ(ln((λ − 1)/(λ_b − 1))/s), with the map's own error of the strain."""
    changes = {
        "stiffness_scatter": 1e-9,
        "elongation_at_0": 60.0,
        "elongation_at_25": 15.0,
        "elongation_scatter": 0.3,
    }
    table = rupture_of(model, chain_at(model, **changes), degradation=np.array([0.0]))
    grid = at_conditions(model, np.array([0.0]), PRESSURES)
    prediction = grid.data_of(Curvature).predicted(grid.tests(values_of())).prediction
    stretch = prediction.peak_stretch[0, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.nan_to_num(prediction.peak_stretch_sd[0, 0] / (stretch - 1.0))
        scatter = np.hypot(0.3, error)
        expected = norm.cdf(np.log((stretch - 1.0) / 0.6) / scatter)
    known = np.where(PRESSURES > 0.0, np.maximum(expected, 1.0 / 20), expected)  # draws
    np.testing.assert_allclose(table["probability"], known, atol=1e-6)
    # without a posterior width there is one probability
    np.testing.assert_allclose(table["probability_q05"], table["probability_q95"], atol=1e-12)


def test_scatter_of_stiffness_is_averaged_as_many_draws_would(model):
    changes = {"stiffness_scatter": 0.1, "elongation_at_0": 22.0, "elongation_scatter": 0.2}
    chain = chain_at(model, **changes)
    level, pressure = np.array([0.0]), np.array([100.0])
    table = rupture_of(model, chain, degradation=level, pressure=pressure)
    grid = at_conditions(model, level, pressure)
    count = 20_000
    values = values_of(TRUTH | changes, count)
    generator = np.random.default_rng(3)
    stretch = (
        grid.data_of(Curvature)
        .predicted(
            grid.tests(values),
            grid.data_of(Curvature).drawn_deviations(grid.tests(values), generator),
        )
        .prediction.peak_stretch[:, 0, 0]
    )
    limit = 0.22 * np.exp(0.2 * generator.standard_normal(count))
    assert table["probability"][0] == pytest.approx(np.mean(stretch - 1.0 > limit), abs=0.015)
    assert 0.02 < table["probability"][0] < 0.98


def test_rupture_is_not_extrapolated(model):
    table = rupture_of(model, chain_at(model), pressure=np.array([100.0, 2000.0]))
    fresh = table[table["degradation_pct"] == 0.0].set_index("pressure_kPa")
    assert np.isfinite(fresh.loc[100.0, "probability"])
    assert fresh.loc[2000.0, ["probability", "probability_q05", "probability_q95"]].isna().all()


def test_the_same_generator_gives_the_same_tables(model):
    chain = chain_at(model)
    assert bands_of(model, chain).equals(bands_of(model, chain))
    assert rupture_of(model, chain).equals(rupture_of(model, chain))
