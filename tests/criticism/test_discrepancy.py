from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.stats import kstest, multivariate_normal

from bayesdeg.criticism.discrepancy import (
    ALIKE,
    AMPLITUDES,
    LENGTHS,
    Misfit,
    explained,
    measure,
    replicate,
    statistic_of,
)
from tests.criticism.linear_case import constant_chain, known_linear, with_readings


@pytest.fixture(scope="module", params=[False, True], ids=["curvature", "with bend angle"])
def linear(request):
    return known_linear(with_angle=request.param)


@pytest.fixture(scope="module")
def chain(linear):
    return constant_chain(linear.model, linear.mode)


def drawn(linear, generator):
    """Readings that the linear model itself makes."""
    noise = linear.factor @ generator.standard_normal(len(linear.mean))
    return (linear.mean + noise).reshape(linear.read.shape)


def pressures(linear):
    """Pressure of each reading, (n_specimens, n_readings)."""
    pressure = linear.model.actuator.pressure
    return np.tile(pressure, linear.read.shape[1] // pressure.shape[1])


def bump(linear, size, *, angle=1.0):
    """A smooth excess at middle pressures, growing with degradation."""
    data = linear.model.actuator
    mean = linear.mean.reshape(linear.read.shape)
    shape = np.exp(-(((pressures(linear) - 90.0) / 40.0) ** 2)) * (1.0 + data.degradation / 24.0)
    is_angle = (linear.output == 1).reshape(linear.read.shape)
    return size * mean * shape * np.where(is_angle, angle, 1.0)


def covariances(linear, alike=ALIKE):
    """Every discrepancy that is tried, written out from the kernel's definition."""
    data = linear.model.actuator
    p = pressures(linear).ravel()
    d = np.broadcast_to(data.degradation, linear.read.shape).ravel()
    envelope = np.abs(linear.mean)
    is_angle = linear.output == 1
    envelope[~is_angle] += 0.1 * np.max(envelope[~is_angle])
    if is_angle.any():
        envelope[is_angle] += 0.1 * np.max(envelope[is_angle])
    for (along, across), of_angle in product(LENGTHS, alike):
        square = ((p[:, None] - p) / along) ** 2 + ((d[:, None] - d) / across) ** 2
        own = envelope * np.where(is_angle, of_angle, 1.0)
        kernel = np.exp(-0.5 * square) * np.outer(own, own)
        for amplitude in AMPLITUDES:
            yield amplitude**2 * kernel


def largest_ratio(linear, readings, **which):
    """The misfit statistic from densities of scipy."""
    residual = readings.ravel() - linear.mean
    covariance = linear.factor @ linear.factor.T
    none = multivariate_normal(np.zeros(len(residual)), covariance).logpdf(residual)
    return max(
        multivariate_normal(np.zeros(len(residual)), covariance + extra).logpdf(residual) - none
        for extra in covariances(linear, **which)
    )


def test_statistic_is_the_largest_ratio_of_normal_densities(linear):
    with_bump = linear.mean.reshape(linear.read.shape) + bump(linear, 0.1)
    case = with_readings(linear, with_bump)
    assert statistic_of(case) == pytest.approx(largest_ratio(linear, with_bump), rel=1e-6)


@pytest.mark.parametrize(("angle", "better"), [(1.0, 1.0), (0.0, 0.0)])
def test_a_discrepancy_is_in_both_readings_or_in_the_curvature_alone(angle, better):
    known = known_linear(with_angle=True)
    readings = known.mean.reshape(known.read.shape) + bump(known, 0.1, angle=angle)
    found = statistic_of(with_readings(known, readings))
    by_kind = {of: largest_ratio(known, readings, alike=(of,)) for of in ALIKE}
    assert max(by_kind, key=by_kind.get) == better
    assert found == pytest.approx(by_kind[better], rel=1e-6)
    assert by_kind[better] > by_kind[1.0 - better] + np.log(20.0)


def test_the_measured_discrepancy_is_that_of_the_curvatures():
    """A misfit of the bend angle alone is none of theirs."""
    known = known_linear(with_angle=True)
    data, chain = known.model.actuator, constant_chain(known.model, known.mode)
    exact = known.mean.reshape(known.read.shape)
    rms = []
    for angle in (0.0, 1.0):
        case = with_readings(known, exact + bump(known, 0.15, angle=angle))
        misfit = measure(case, chain, np.random.default_rng(20), replicates=9)
        assert misfit.discrepancy.shape == (data.mask.sum(),)
        planted = bump(known, 0.15)[:, : data.mask.shape[1]]
        assert np.corrcoef(misfit.discrepancy, planted.ravel())[0, 1] > 0.9
        rms.append(misfit.rms)
    assert rms[0] == pytest.approx(rms[1])
    assert rms[0] == pytest.approx(np.sqrt(np.mean(planted**2)))


def test_statistic_is_zero_where_the_model_is_exact(linear):
    exact = linear.mean.reshape(linear.read.shape)
    assert statistic_of(with_readings(linear, exact)) == 0.0


def test_p_values_are_uniform_on_data_of_the_model(linear, chain):
    generator = np.random.default_rng(11)
    null = measure(linear, chain, generator, replicates=400).null
    cases = [with_readings(linear, drawn(linear, generator)) for _ in range(40)]
    statistics = np.array([statistic_of(case) for case in cases])
    p_values = (1.0 + np.sum(null >= statistics[:, None], axis=1)) / (1.0 + len(null))
    # many statistics are 0, where p is 1: below that p is uniform, above it larger; twice as many
    # discrepancies are tried where there are bend angles, so that fewer are
    share = 0.29 if linear.model.actuator.with_angle else 0.48
    assert np.mean(null == 0.0) == pytest.approx(share, abs=0.08)
    assert kstest(p_values, "uniform", alternative="greater").pvalue > 0.01
    assert np.mean(p_values <= 0.4) == pytest.approx(0.4, abs=3.0 * np.sqrt(0.24 / 40))


def test_the_p_value_counts_simulated_data_that_misfit_as_much(linear, chain):
    generator = np.random.default_rng(18)
    readings = drawn(linear, generator) + bump(linear, 0.03)
    misfit = measure(with_readings(linear, readings), chain, generator, replicates=99)
    larger = np.sum(misfit.null >= misfit.statistic)
    assert misfit.p_value == pytest.approx((1 + larger) / 100)
    exact = with_readings(linear, linear.mean.reshape(readings.shape))
    assert measure(exact, chain, generator, replicates=9).p_value == 1.0


def test_a_planted_discrepancy_is_measured(linear, chain):
    generator = np.random.default_rng(12)
    planted = bump(linear, 0.15)
    case = with_readings(linear, drawn(linear, generator) + planted)
    misfit = measure(case, chain, generator, replicates=99)
    assert misfit.p_value == pytest.approx(0.01)
    assert misfit.statistic > 5.0 * misfit.null.max()
    curvatures = planted[:, : linear.model.actuator.mask.shape[1]]
    assert np.corrcoef(misfit.discrepancy, curvatures.ravel())[0, 1] > 0.9
    assert misfit.noise < 0.5 * misfit.rms


def test_misfit_grows_with_what_is_planted(linear):
    readings = drawn(linear, np.random.default_rng(13))
    sizes = [
        statistic_of(with_readings(linear, readings + bump(linear, s))) for s in (0.1, 0.2, 0.4)
    ]
    assert sizes == sorted(sizes)
    assert sizes[0] > 0.0


def test_a_stiff_specimen_is_scatter_and_no_misfit(linear):
    """One specimen along its own slope, by one sd of specimens: the model expects that."""
    model = linear.model
    values = model.table.named(linear.mode[None])
    slope = model.predict(values).slope[0]
    readings = linear.mean.reshape(slope.shape).copy()
    readings[2] += float(model.deviation_sd(values)[0, 2, 0]) * slope[2]
    assert statistic_of(with_readings(linear, readings)) < 1.0


def test_rms_is_that_of_the_residuals(linear, chain):
    generator = np.random.default_rng(14)
    readings = drawn(linear, generator)
    misfit = measure(with_readings(linear, readings), chain, generator, replicates=5)
    residual = (readings.ravel() - linear.mean)[linear.output == 0]
    assert misfit.rms == pytest.approx(np.sqrt(np.mean(residual**2)))
    assert 0.0 < misfit.noise <= misfit.rms


def test_replicates_have_the_readings_mean_and_scatter(linear, chain):
    drawn_sets = replicate(linear, chain, np.random.default_rng(15), 3000)
    z = linear.whiten(drawn_sets)
    assert drawn_sets.shape == (3000, *linear.read.shape)
    # specimens deviate in ln stiffness, so that the sets are skewed by a little
    assert np.max(np.abs(z.mean(axis=0))) < 0.15
    assert np.std(z) == pytest.approx(1.0, abs=0.05)


def test_the_same_seed_gives_the_same_misfit(linear, chain):
    case = with_readings(linear, drawn(linear, np.random.default_rng(16)))
    one, two = (measure(case, chain, np.random.default_rng(17), replicates=20) for _ in range(2))
    assert one.p_value == two.p_value
    np.testing.assert_array_equal(one.null, two.null)


def misfit_of(statistic, null=(1.0, 3.0)):
    return Misfit(statistic, np.array(null), 0.01, np.zeros(1), 0.0, 1.0, 0.1)


def test_explained_counts_from_what_chance_gives():
    assert explained(misfit_of(22.0), misfit_of(12.0)) == pytest.approx(0.5)
    assert explained(misfit_of(22.0), misfit_of(2.0)) == 1.0
    assert explained(misfit_of(22.0), misfit_of(0.0)) == 1.0


def test_explained_is_no_share_where_there_is_nothing_to_explain():
    assert np.isnan(explained(misfit_of(2.0), misfit_of(1.0)))
    assert np.isnan(explained(misfit_of(1.0), misfit_of(1.0)))


def test_what_makes_the_misfit_worse_explains_nothing():
    before = misfit_of(22.0)
    assert explained(before, replace(before, statistic=40.0)) == 0.0
