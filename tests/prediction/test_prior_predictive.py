from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.tensile import Tensile
from bayesdeg.prediction.prior_predictive import PriorPredictive, prior_predictive
from bayesdeg.priors import HalfNormal, LogNormal, TruncatedNormal, with_priors
from tests.inference.small_study import altered, small_model

Z = norm.ppf(0.95)


class StiffOnly:
    """Answers where C1 is large enough."""

    def __init__(self, forward, least):
        self.forward, self.least = forward, least

    def __call__(self, inputs):
        prediction = self.forward(inputs)
        known = np.broadcast_to(inputs.c1 >= self.least, prediction.curvature.shape)
        return replace(prediction, curvature=np.where(known, prediction.curvature, np.nan))


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def found(model):
    return predicted(model)


def predicted(model, seed=0):
    return prior_predictive(model, np.random.default_rng(seed))


def at_zero(model, **laws):
    """The model with priors at 0 %, and films at 0 % alone."""
    tensile = replace(
        model.data_of(Tensile).tests,
        modes=("uniaxial",) * 4,
        degradation=np.zeros(4),
        degradation_sd=np.zeros(4),
    )
    return altered(model, base=with_priors(model.base, laws), tensile=tensile, actuator=None)


def test_stress_of_a_neo_hookean_prior_is_the_closed_form(model):
    """P = 2 C1 (λ − λ⁻²) of a log-normal C1 is log-normal with the same scatter."""
    neo_hookean = at_zero(
        model,
        c1_at_0=LogNormal(0.3, 0.4),
        c2_ratio_at_0=TruncatedNormal(0.0, 1e-6, -0.1, 0.1),
        c3_at_0=LogNormal(1e-12, 0.1),
        stiffness_scatter=HalfNormal(1e-9),
    )
    table = predicted(neo_hookean).table
    assert set(table["mode"]) == {"uniaxial"}
    assert np.isnan(table["pressure_kPa"]).all()
    stretch = table["stretch"].to_numpy()
    middle = 2.0 * 0.3 * (stretch - stretch**-2)
    np.testing.assert_allclose(table["q50"], middle, rtol=0.06)
    above = table[table["stretch"] > 1.1]
    np.testing.assert_allclose(np.log(above["q95"] / above["q50"]), 0.4 * Z, rtol=0.1)
    np.testing.assert_allclose(np.log(above["q50"] / above["q05"]), 0.4 * Z, rtol=0.1)


def test_specimens_scatter_about_the_median_material(model):
    laws = {
        "c1_at_0": LogNormal(0.3, 1e-6),
        "c2_ratio_at_0": TruncatedNormal(0.0, 1e-6, -0.1, 0.1),
        "c3_at_0": LogNormal(1e-12, 0.1),
        "stiffness_scatter": TruncatedNormal(0.2, 1e-6, 0.0),
    }
    row = predicted(at_zero(model, **laws)).table.iloc[-1]
    assert np.log(row["q95"] / row["q50"]) == pytest.approx(0.2 * Z, rel=0.15)


def test_the_share_of_answers_is_the_prior_probability_of_what_is_answered(model):
    """Only C1 ≥ 0.3 is answered, the median of its prior without degradation."""
    laws = {"c1_at_0": LogNormal(0.3, 0.4), "stiffness_scatter": HalfNormal(1e-9)}
    refusing = altered(
        model,
        base=with_priors(model.base, laws),
        forward=StiffOnly(model.world.forward, 0.3),
    )
    everywhere = predicted(model).table
    found = predicted(refusing)
    fresh = found.table[(found.table["quantity"] == "curvature")].query("pressure_kPa == 20")
    before = everywhere.query("quantity == 'curvature' and pressure_kPa == 20")
    share = fresh["answered"].iloc[0] / before["answered"].iloc[0]
    assert share == pytest.approx(0.5, abs=0.06)
    assert found.answered <= fresh["answered"].min()


def test_a_quantile_of_few_answers_is_left_out(model):
    refusing = altered(model, forward=StiffOnly(model.world.forward, 1e3))
    table = predicted(refusing).table.query("quantity == 'curvature'")
    assert (table["answered"] == 0.0).all()
    assert table[["q05", "q50", "q95"]].isna().all(axis=None)


def test_curves_are_at_the_studys_conditions(model, found):
    table = found.table
    curvature = table[table["quantity"] == "curvature"]
    assert curvature["pressure_kPa"].max() == 140.0
    assert np.isnan(curvature["stretch"]).all()
    np.testing.assert_allclose(np.unique(curvature["degradation_pct"]), [0.0, 5.2, 14.0, 24.0])
    stress = table[table["quantity"] == "nominal_stress"]
    longest = stress.groupby(["mode", "degradation_pct"])["stretch"].max()
    assert longest["uniaxial", 0.0] == pytest.approx(2.8)
    assert longest["uniaxial", 22.0] == pytest.approx(1.6)
    assert longest["equibiaxial", 0.3] == pytest.approx(1.7)
    bands = table[["q05", "q25", "q50", "q75", "q95"]].dropna().to_numpy()
    assert np.all(np.diff(bands, axis=1) >= 0.0)


def test_the_same_generator_gives_the_same_draws(model, found):
    again = predicted(model)
    assert again.table.equals(found.table)
    assert (again.answered, again.inside_stress) == (found.answered, found.inside_stress)


def test_readings_that_the_priors_exclude_are_said_to_be_outside(model, found):
    assert found.inside_curvature > 0.5
    assert found.inside_stress > 0.5
    assert not found.contradicted
    absurd = altered(
        model,
        tensile=replace(
            model.data_of(Tensile).tests,
            stress=np.where(model.data_of(Tensile).tests.mask, 1e3, 0.0),
        ),
        actuator=replace(
            model.data_of(Curvature).tests,
            curvature=np.where(model.data_of(Curvature).tests.mask, -500.0, 0.0),
        ),
    )
    outside = predicted(absurd)
    assert (outside.inside_curvature, outside.inside_stress) == (0.0, 0.0)
    assert outside.contradicted


def test_without_curves_there_is_nothing_to_draw(model):
    bare = altered(model, tensile=None, actuator=None)
    found = predicted(bare)
    assert found.table.empty
    assert {"quantity", "answered", "q50"} <= set(found.table.columns)
    assert np.isnan(found.answered)
    assert found.shares == {}
    assert not found.contradicted


def test_what_was_not_read_has_no_share(found):
    films = PriorPredictive(found.table, 0.48, np.nan, 1.0)
    assert films.shares == {"stress": 1.0}
    assert replace(films, inside_stress=0.4).contradicted
