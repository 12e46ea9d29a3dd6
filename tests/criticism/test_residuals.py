from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import linregress

from bayesdeg.criticism.checks.residuals import (
    CurvatureFit,
    level_table,
    predict_readings,
    r_squared,
    where,
    where_films,
)
from bayesdeg.criticism.fit.linear import linearise
from bayesdeg.data.levels import levels
from bayesdeg.observations.curvature import CURVATURE, Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.tensile import Tensile, median_stresses
from tests.criticism.linear_case import constant_chain, known_linear, tight_model
from tests.inference.small_study import TRUTH, altered, small_model, values_of


def test_r_squared_of_a_regression_line_is_the_squared_correlation():
    generator = np.random.default_rng(1)
    x = np.arange(20.0)
    y = 2.0 * x + 3.0 * generator.standard_normal(20)
    line = linregress(x, y)
    assert r_squared(y, line.intercept + line.slope * x) == pytest.approx(line.rvalue**2)


def test_r_squared_of_the_mean_is_zero_and_of_the_truth_is_one():
    y = np.array([1.0, 4.0, 2.0])
    assert r_squared(y, np.full(3, y.mean())) == pytest.approx(0.0)
    assert r_squared(y, y) == 1.0
    assert r_squared(y, -10.0 * y) < 0.0


def test_r_squared_is_not_defined_without_a_spread():
    assert np.isnan(r_squared(np.array([]), np.array([])))
    assert np.isnan(r_squared(np.array([2.0]), np.array([1.0])))
    assert np.isnan(r_squared(np.array([2.0, 2.0]), np.array([1.0, 3.0])))


@given(st.lists(st.floats(0.0, 30.0), min_size=1, max_size=20))
def test_levels_are_ordered_and_hold_their_members(rates):
    degradation = np.array(rates)
    centres, member = levels(degradation)
    assert np.all(np.diff(centres) > 0.0)
    for k, centre in enumerate(centres):
        own = degradation[member == k]
        assert own.min() - 1e-9 <= centre <= own.max() + 1e-9
    for i in range(len(rates)):
        for j in range(len(rates)):
            if abs(rates[i] - rates[j]) <= 2.0:
                assert member[i] == member[j]


def test_levels_do_not_depend_on_the_order_of_the_specimens():
    rates = np.array([20.3, 0.0, 5.1, 19.7, 4.8])
    centres, member = levels(rates)
    assert centres == pytest.approx([0.0, 4.95, 20.0])
    assert member.tolist() == [2, 0, 1, 2, 1]


@pytest.fixture(scope="module")
def model():
    """Readings that are 12 % below the prediction at the third of highest pressures, at 24 %."""
    base = tight_model()
    truth = base.data_of(Curvature).predicted(base.tests(values_of())).prediction.curvature[0]
    low = (base.data_of(Curvature).tests.pressure > 115.0) & (
        base.data_of(Curvature).tests.degradation > 20.0
    )
    return base.with_observations(
        *data_of_actuators(
            base.data_of(Curvature).tests.with_readings(np.where(low, 0.88 * truth, truth)),
            base.base,
        )
    ), truth


def test_levels_table_gives_r_squared_beside_the_published(model):
    study, truth = model
    fit = CurvatureFit(truth, truth, truth)
    table = level_table(study, fit, {0.0: 0.984, 25.0: 0.861}).set_index("degradation_pct")
    assert list(table.index) == ["0", "10", "24", "all"]
    assert table["n"].tolist() == [16, 16, 16, 48]
    assert table.loc["0", "r_squared"] == 1.0
    assert table.loc["0", "published_r_squared"] == 0.984
    assert table.loc["24", "published_r_squared"] == 0.861
    assert np.isnan(table.loc["10", "published_r_squared"])
    measured = study.data_of(Curvature).tests.curvature[4:]
    residual = measured - truth[4:]
    assert table.loc["24", "rms_per_m"] == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert table.loc["24", "r_squared"] == pytest.approx(
        1.0 - np.sum(residual**2) / np.sum((measured - measured.mean()) ** 2)
    )


def test_where_names_pressures_rates_and_specimens(model):
    study, truth = model
    found = where(study, study.data_of(Curvature).tests.curvature - truth, 0.01)
    assert found.excess == pytest.approx(-0.04)
    assert found.pressures == (140.0, 160.0)
    assert found.levels == pytest.approx((24.0,), abs=0.5)
    assert not found.everywhere
    assert (found.agreeing, found.specimens) == (2, 6)


def test_where_says_above_and_every_rate(model):
    study, truth = model
    found = where(
        study.with_observations(
            *data_of_actuators(
                study.data_of(Curvature).tests.with_readings(1.1 * truth), study.base
            )
        ),
        0.1 * truth,
        0.01,
    )
    assert found.excess == pytest.approx(0.1)
    assert found.everywhere
    assert len(found.levels) == 3
    assert (found.agreeing, found.specimens) == (6, 6)


def test_small_curvatures_do_not_make_large_percentages(model):
    """Residuals of the size of the noise are set in proportion to the noise at least."""
    study, truth = model
    tiny = altered(
        study,
        actuator=replace(study.data_of(Curvature).tests, curvature=np.full(truth.shape, 1e-9)),
    )
    assert where(tiny, np.full(truth.shape, 1e-9), 1.0).excess == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("with_angle", [False, True])
def test_predicted_readings_hold_nine_tenths_of_further_specimens(with_angle):
    linear = known_linear(with_angle=with_angle)
    model = linear.subject
    chain = constant_chain(model, linear.mode)
    generator = np.random.default_rng(2)
    fit = predict_readings(model, chain, generator, draws=2000)
    curvatures = linear.mean[linear.subject.places.kind == CURVATURE]
    np.testing.assert_allclose(fit.mean.ravel(), curvatures, rtol=1e-9)
    further = model.data_of(Curvature).drawn(model.tests(values_of(TRUTH, 2000)), generator)[
        ..., : model.data_of(Curvature).tests.pressure.shape[1]
    ]
    inside = np.mean((further >= fit.low) & (further <= fit.high))
    assert inside == pytest.approx(0.9, abs=0.02)


def test_a_reading_that_no_draw_answers_has_no_prediction():
    """Where the actuator of every draw balloons, say: without a warning, and beside others."""
    drawn = np.ones((3, 1, 2))
    drawn[:, :, 1] = np.nan
    curves = SimpleNamespace(
        tests=SimpleNamespace(pressure=np.zeros((1, 2))),
        predicted=lambda state: SimpleNamespace(prediction=SimpleNamespace(curvature=drawn)),
        drawn=lambda state, generator: 2.0 * drawn,
    )
    model = SimpleNamespace(
        table=SimpleNamespace(named=lambda vectors: vectors),
        tests=lambda values: values,
        data_of=lambda kind: curves,
    )
    chain = SimpleNamespace(vectors=np.zeros((1, 1, 1)))
    fit = predict_readings(model, chain, np.random.default_rng(1), draws=3)
    for found, known in ((fit.mean, 1.0), (fit.low, 2.0), (fit.high, 2.0)):
        np.testing.assert_array_equal(found, [[known, np.nan]])


def off_by(**modes):
    """Films whose stresses are these amounts [MPa] off what the law gives."""
    model = altered(small_model(), actuator=None, forward=None)
    mode = model.table.vectors(values_of())[0]
    stress = median_stresses(
        model.tests(model.table.named(mode[None])), model.data_of(Tensile).tests
    ).at_rest[0]
    off = np.array([modes.get(name, 0.0) for name in model.data_of(Tensile).tests.modes])
    curves = replace(model.data_of(Tensile).tests, stress=stress + off[:, None])
    return linearise(altered(model, tensile=curves), mode)


def test_where_leaves_out_what_cannot_be_predicted(model):
    study, truth = model
    residual = study.data_of(Curvature).tests.curvature - truth
    beyond = residual.copy()
    beyond[0] = np.nan
    known = replace(where(study, residual, 0.01), excess=-0.04 * 6 / 5)  # of a specimen less
    assert where(study, beyond, 0.01) == replace(known, excess=pytest.approx(known.excess))
    assert where(study, np.full_like(residual, np.nan), 0.01) is None


def test_where_of_films_names_the_worst_mode_and_by_how_much():
    found = where_films(off_by(equibiaxial=0.3, planar=-0.1))
    assert found.modes[0] == ("equibiaxial", pytest.approx(0.3))
    assert dict(found.modes)["planar"] == pytest.approx(0.1)
    assert found.above
    low = where_films(off_by(planar=-0.25))
    assert low.modes[0] == ("planar", pytest.approx(0.25))
    assert not low.above


def test_where_of_films_of_one_mode_compares_with_nothing():
    linear = off_by(uniaxial=0.2)
    one = linear.subject.only(np.array([0]))
    assert one.groups == ("uniaxial",)
    found = where_films(linearise(one, linear.mode))
    assert [mode for mode, _ in found.modes] == ["uniaxial"]
