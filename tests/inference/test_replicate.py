"""Replicates have the law of the likelihood: one kind of data after the other, by many draws."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import stats

from bayesdeg.inference.model import replicate
from bayesdeg.observations import noise as likelihood
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.means import Means, Statistic
from bayesdeg.observations.specimens import stiffness_spread
from bayesdeg.observations.tensile import Tensile
from tests.inference.small_study import altered, small_model, values_of

COUNT = 400


@cache
def replicates():
    generator = np.random.default_rng(7)
    return [replicate(small_model(), values_of(), generator) for _ in range(COUNT)]


def squared_distances(linearised, replicas):
    """Squared whitened distance of each specimen's readings, (COUNT, n_specimens)."""
    found = []
    for replica in replicas:
        curves = linearised(replica)
        density = likelihood.sequential(curves)
        factor = np.linalg.cholesky(likelihood.covariance(curves))
        scale = np.log(np.diagonal(factor, axis1=-2, axis2=-1))
        mask = curves.paths.mask
        constant = np.where(mask, scale + 0.5 * likelihood.LOG_TWO_PI, 0.0)
        found.append(-2.0 * np.sum(density + constant, axis=-1)[0])
    return np.array(found)


def is_uniform(probability):
    return stats.kstest(probability, "uniform").pvalue > 1e-3


def small_scatter():
    """Deviations so small that the linearisation of the likelihood is exact to a percent."""
    return values_of() | {"stiffness_scatter": np.array([0.01])}


def with_exact_degradation(model):
    films, actuators = model.data_of(Tensile).tests, model.data_of(Curvature).tests
    return altered(
        model,
        tensile=replace(films, degradation_sd=0.1 * films.degradation_sd),
        actuator=replace(actuators, degradation_sd=0.1 * actuators.degradation_sd),
    )


@pytest.mark.parametrize("kind", [Tensile, Curvature])
def test_whole_curves_are_at_the_distances_of_a_normal_law(kind):
    """The sum of squares of a specimen's whitened readings is χ² with as many degrees."""
    model, values = with_exact_degradation(small_model()), small_scatter()
    model = altered(
        model,
        base=tuple(p for p in model.base if not p.name.startswith("elong")),
        breaks=None,
        statistics=(),
    )
    generator = np.random.default_rng(3)
    replicas = [replicate(model, values, generator) for _ in range(COUNT)]
    distances = squared_distances(lambda m: m.data_of(kind).linearised(m.state(values)), replicas)
    degrees = model.data_of(kind).tests.paths.mask.sum(axis=-1)
    for s, degree in enumerate(degrees):
        assert is_uniform(stats.chi2(degree).cdf(distances[:, s])), s


def test_curves_of_one_specimen_deviate_together_as_far_as_specimens_scatter():
    """ln of the stress at the stiffest end, less noise, has the scatter's standard deviation."""
    quiet = values_of() | {
        name: np.array([1e-9]) for name in ("tensile_noise", "tensile_noise_floor")
    }
    generator = np.random.default_rng(5)
    model = small_model()
    logs = np.array(
        [
            np.log(replicate(model, quiet, generator).data_of(Tensile).tests.stress[:, :3])
            for _ in range(COUNT)
        ]
    )
    sd = logs.std(axis=0)
    values = values_of()
    material = model.world.material(values, model.data_of(Tensile).tests.degradation)
    # the first film's degradation rate is exact: its curves are multiples of one another
    np.testing.assert_allclose(sd[0], 0.05, rtol=0.12)
    spread = stiffness_spread(values, material, model.data_of(Tensile).tests.degradation_sd)[0]
    assert np.all(np.ptp(logs[:, 0] - logs[0, 0], axis=1) < 1e-6)
    np.testing.assert_allclose(sd[:, 0], np.sqrt(spread), rtol=0.15)


def test_elongations_at_break_have_the_log_normal_law():
    data = small_model().data_of(Breaks).table
    drawn = np.log([r.data_of(Breaks).table.elongation for r in replicates()])
    slope = (np.log(52.0) - np.log(210.0)) / 25.0
    for k, degradation in enumerate(data.degradation):
        median = np.log(210.0) + slope * degradation
        sd = np.hypot(0.1, slope * data.degradation_sd[k])
        assert is_uniform(stats.norm(median, sd).cdf(drawn[:, k])), k


@pytest.mark.parametrize(
    ("k", "law"),
    [
        (0, stats.t(2.0, loc=1.8, scale=0.15 / np.sqrt(3.0))),
        (1, stats.norm(9.0, 1.0)),
        (2, stats.norm(52.0, 5.0)),
        (3, stats.norm(0.62, 0.035)),
    ],
)
def test_statistics_have_the_law_of_their_replicates(k, law):
    assert is_uniform(law.cdf([r.data_of(Means).statistics[k].value for r in replicates()]))


def weak():
    """Elongation at break so low that some actuators burst at every pressure."""
    return values_of() | {
        "elongation_at_0": np.array([25.0]),
        "elongation_at_25": np.array([9.0]),
        "elongation_scatter": np.array([0.4]),
        "stiffness_scatter": np.array([1e-6]),
    }


def test_actuators_burst_as_often_as_the_likelihood_says():
    """With no scatter of stiffness the probability of each pressure is known exactly."""
    model = small_model()
    exact = altered(
        model,
        actuator=replace(
            model.data_of(Curvature).tests,
            degradation_sd=0.0 * model.data_of(Curvature).tests.degradation_sd,
        ),
    )
    generator = np.random.default_rng(11)
    replicas = [replicate(exact, weak(), generator).data_of(Curvature).tests for _ in range(COUNT)]
    points = exact.data_of(Curvature).tests.pressure.shape[1]
    seen = np.array([np.where(r.ruptures.burst < 0, points, r.ruptures.burst) for r in replicas])
    for s in range(len(exact.data_of(Curvature).tests.specimens)):
        observed, expected = [], []
        last = int(np.sum(exact.data_of(Curvature).tests.recorded[s]))
        for row in [*range(last), points]:
            burst = np.zeros((len(seen[0]), points), bool)
            recorded = exact.data_of(Curvature).tests.recorded.copy()
            if row < points:
                burst[s, row] = True
                recorded[s, row + 1 :] = False
            data = replace(exact.data_of(Curvature).tests, ruptured=burst, recorded=recorded)
            block = altered(exact, actuator=data).log_likelihood(weak())["rupture"]
            observed.append(int(np.sum(seen[:, s] == row)))
            expected.append(COUNT * float(np.exp(block[0, s])))
        assert sum(observed) == COUNT
        assert sum(expected) == pytest.approx(COUNT, rel=1e-6)
        likely = np.array(expected) > 5.0
        assert likely.sum() >= 2
        rest = (np.array(observed) - expected)[likely] / np.sqrt(np.array(expected)[likely])
        assert stats.chi2(likely.sum() - 1).sf(np.sum(rest**2)) > 1e-3, s


def test_a_burst_actuator_has_no_reading_there_nor_after():
    generator = np.random.default_rng(1)
    data = replicate(small_model(), weak(), generator).data_of(Curvature).tests
    burst = data.ruptured.any(axis=1)
    assert burst.any()
    for s in np.nonzero(burst)[0]:
        row = int(np.argmax(data.ruptured[s]))
        assert data.recorded[s, : row + 1].all()
        assert not data.recorded[s, row + 1 :].any()
        assert not data.mask[s, row:].any()
        assert not data.angle_mask[s, row:].any()
        np.testing.assert_array_equal(
            data.mask[s, :row], small_model().data_of(Curvature).tests.mask[s, :row]
        )


def test_replicates_are_possible_and_differ_and_the_tests_stay():
    model, values = small_model(), values_of()
    vector = model.table.vectors(values)
    first, second = replicates()[:2]
    assert np.all(np.isfinite([m.log_prob(vector)[0] for m in replicates()[:20]]))
    assert not np.any(
        first.data_of(Tensile).tests.stress[model.data_of(Tensile).tests.mask]
        == second.data_of(Tensile).tests.stress[model.data_of(Tensile).tests.mask]
    )
    assert first.table == model.table
    np.testing.assert_array_equal(
        first.data_of(Curvature).tests.pressure, model.data_of(Curvature).tests.pressure
    )
    again = replicate(model, values, np.random.default_rng(7))
    np.testing.assert_array_equal(
        again.data_of(Curvature).tests.readings, first.data_of(Curvature).tests.readings
    )


def test_where_the_forward_map_has_no_answer_actuators_burst_or_readings_are_nan():
    model = small_model()
    limited = altered(model, forward=Limited(model.world.forward, 90.0))
    generator = np.random.default_rng(2)
    data = replicate(limited, values_of(), generator).data_of(Curvature).tests
    assert np.all(data.pressure[data.ruptured] == 100.0)
    assert np.all(np.isfinite(data.readings[np.tile(data.mask, 2)]))
    silent = altered(
        limited,
        base=tuple(p for p in model.base if not p.name.startswith("elong")),
        breaks=None,
        statistics=(Statistic("volume_ratio", 0.0, 0.62, 0.035, "published"),),
    )
    curvature = replicate(silent, values_of(), generator).data_of(Curvature).tests.curvature
    refused = model.data_of(Curvature).tests.mask & (model.data_of(Curvature).tests.pressure > 90.0)
    np.testing.assert_array_equal(np.isnan(curvature), refused)


class Limited:
    """A forward map that answers up to some pressure."""

    def __init__(self, forward, largest):
        self.forward, self.largest = forward, largest

    def __call__(self, inputs):
        found = self.forward(inputs)
        beyond = np.broadcast_to(inputs.pressure, found.curvature.shape) > self.largest
        names = ("curvature", "bend_angle", "peak_stretch", "slope")
        silenced = {name: np.where(beyond, np.nan, getattr(found, name)) for name in names}
        return replace(found, **silenced)
