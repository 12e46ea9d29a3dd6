"""Whether ruptures are expected: p-values on data of the model, and where all burst early."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest, norm

from bayesdeg.criticism.checks import count_misfit as module
from bayesdeg.criticism.checks.count_misfit import rupture_misfit
from bayesdeg.inference.model import replicate
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.rupture import data_of_actuators, strength_of
from tests.criticism.linear_case import tight_model
from tests.inference.small_study import TRUTH, altered, values_of

# the actuators demand about as much as these films bear, so that some burst and some do not
WEAK = TRUTH | {"elongation_at_0": 60.0, "elongation_at_25": 10.0, "elongation_scatter": 0.15}


def draws_of(model, truth, count):
    return np.repeat(model.table.vectors(values_of(truth)), count, axis=0)


@pytest.fixture(scope="module")
def model():
    """Readings as predicted, so that specimens are nearly of mean stiffness."""
    model = altered(tight_model(), tensile=None)
    return model.with_observations(
        *data_of_actuators(
            model.data_of(Curvature).tests.with_readings(
                model.data_of(Curvature).predicted(model.tests(values_of())).mean[0]
            ),
            model.base,
        )
    )


def test_nothing_is_compared_without_actuators_or_a_limit(model):
    vectors, generator = draws_of(model, WEAK, 2), np.random.default_rng(1)
    assert rupture_misfit(altered(model, actuator=None), vectors, generator) is None
    parameters = tuple(p for p in model.base if "elongation" not in p.name)
    unlimited = altered(
        model,
        base=parameters,
        breaks=None,
        statistics=tuple(
            s for s in model.data_of(Means).statistics if "elongation" not in s.quantity
        ),
    )
    short = np.zeros((2, len(unlimited.table)))
    assert rupture_misfit(unlimited, short, generator) is None


def test_deviance_is_that_of_the_law_of_the_limit(model):
    """By hand: five survive all that they demand, one bursts between its last two pressures."""
    data = model.data_of(Curvature).tests
    burst = np.zeros(data.ruptured.shape, bool)
    burst[1, -1] = True
    one_burst = altered(model, actuator=replace(data, ruptured=burst, mask=data.mask & ~burst))
    vectors = draws_of(model, WEAK, 3)
    found = rupture_misfit(one_burst, vectors, np.random.default_rng(2))
    values = model.table.named(vectors[:1])
    stretch = model.data_of(Curvature).predicted(model.tests(values)).prediction.peak_stretch[0]
    strength = strength_of(model.tests(values), model.data_of(Curvature).tests)
    z = np.log((stretch - 1.0) / strength.median[0][:, None]) / strength.scatter[0][:, None]
    chance = norm.sf(z[:, -1])
    chance[1] = norm.cdf(z[1, -1]) - norm.cdf(z[1, -2])
    assert found.burst == 1
    assert found.deviance == pytest.approx(-2.0 * np.sum(np.log(chance)), rel=1e-3)


def test_p_values_are_uniform_on_data_of_the_model(model):
    generator = np.random.default_rng(3)
    values = values_of(WEAK)
    found = []
    for _ in range(40):
        data = replicate(model, values, generator)
        found.append(rupture_misfit(data, draws_of(model, WEAK, 19), generator))
    p_values = np.array([one.p_value for one in found])
    bursts = np.array([one.burst for one in found])
    assert 0 < bursts.mean() < 6
    # data sets without ruptures are alike, so that large p-values are shared; small ones are rare
    assert kstest(p_values, "uniform", alternative="greater").pvalue > 0.01
    assert np.mean(p_values <= 0.2) == pytest.approx(0.2, abs=3.0 * np.sqrt(0.16 / 40))
    expected = np.mean([one.expected for one in found])
    assert bursts.mean() == pytest.approx(expected, abs=3.0 * bursts.std() / np.sqrt(40))


def test_ruptures_far_below_the_limit_are_no_chance(model):
    """Strong films, and yet every actuator bursts at its third pressure."""
    data = model.data_of(Curvature).tests
    burst = np.zeros(data.ruptured.shape, bool)
    burst[:, 2] = True
    before = np.arange(data.mask.shape[1]) < 2
    early = replace(
        data,
        ruptured=burst,
        mask=data.mask & before,
        angle_mask=data.angle_mask & before,
        recorded=data.recorded & (np.arange(data.mask.shape[1]) < 3),
    )
    vectors = draws_of(model, TRUTH, 49)
    found = rupture_misfit(altered(model, actuator=early), vectors, np.random.default_rng(4))
    assert found.burst == 6
    assert found.expected < 3.0
    assert found.p_value == pytest.approx(1 / 50)


def test_survival_that_is_expected_is_no_misfit(model):
    found = rupture_misfit(model, draws_of(model, TRUTH, 49), np.random.default_rng(5))
    assert found.burst == 0
    assert found.p_value > 0.1


def test_the_same_seed_gives_the_same_p_value(model):
    vectors = draws_of(model, WEAK, 19)
    one, two = (rupture_misfit(model, vectors, np.random.default_rng(6)) for _ in range(2))
    assert one == two


def test_too_few_simulated_data_sets_have_no_p_value(model):
    found = rupture_misfit(model, draws_of(model, WEAK, 18), np.random.default_rng(6))
    assert np.isnan(found.p_value)
    assert (found.known, found.drawn) == (18, 18)


def test_data_sets_without_a_probability_count_neither_for_nor_against(model, monkeypatch):
    """A nan is no ruptures more improbable than the data, and none less."""
    vectors = draws_of(model, TRUTH, 49)
    whole = rupture_misfit(model, vectors, np.random.default_rng(5))
    real = module._deviances
    calls = iter(range(100))

    def broken(one, points):
        found = real(one, points)
        return np.full_like(found, np.nan) if next(calls) in (1, 2, 3) else found

    monkeypatch.setattr(module, "_deviances", broken)
    found = rupture_misfit(model, vectors, np.random.default_rng(5))
    assert (found.known, found.drawn) == (46, 49)
    assert found.p_value == pytest.approx(whole.p_value, abs=3 / 47)
